"""Which code this is: its version, its commit, and what its training computes. Imports no JAX."""

import hashlib
import json
import re
import subprocess
from collections.abc import Mapping
from functools import cache
from pathlib import Path
from typing import Any

__version__ = "0.1.0"

PACKAGE = Path(__file__).parent
BUILT_FROM = "commit.json"
"""File that a build leaves in the installed package (`hatch_build.py`)."""
FIRST_UPDATES = PACKAGE / "first_updates.json"
"""What the first 200 updates of each training compute (`tests/training/first_updates.py`)."""
SOURCE = ("commit", "clean_tree", "training")
"""Fields by which a result says which code made it (`source`)."""
_COMMIT, _TRAINING = re.compile("[0-9a-f]{40,64}"), re.compile("[0-9a-f]{12}")


@cache
def commit() -> dict[str, Any]:
    """The commit this code is of, and whether its tree was clean; both None where unknown.

    A checkout is asked through git, an installed package has a file of its build.
    """
    root = PACKAGE.parents[1]
    if (root / ".git").exists() and (root / "src" / PACKAGE.name) == PACKAGE:
        return of_checkout(root)
    try:
        found: dict[str, Any] = json.loads((PACKAGE / BUILT_FROM).read_text("utf-8"))
    except (OSError, ValueError):
        return {"commit": None, "clean_tree": None}
    return found


def of_checkout(root: Path) -> dict[str, Any]:
    """As `commit`, of the checkout in a folder."""
    # Without its lock on the index, git does not disturb a commit that is made meanwhile.
    git = ["git", "--no-optional-locks", "-C", str(root)]
    try:
        head, changes = (
            subprocess.run([*git, *words], capture_output=True, check=True).stdout
            for words in (["rev-parse", "HEAD"], ["status", "--porcelain"])
        )
    except (OSError, subprocess.CalledProcessError):
        return {"commit": None, "clean_tree": None}
    return {"commit": head.decode("ascii").strip(), "clean_tree": not changes}


@cache
def training() -> str:
    """Name of what training computes: it changes when the stored first updates do.

    Two results of one name were trained by code that agrees in its first updates.
    """
    return hashlib.sha256(FIRST_UPDATES.read_bytes()).hexdigest()[:12]


def source() -> dict[str, Any]:
    """The commit, whether its tree was clean, and the name of what its training computes."""
    return commit() | {"training": training()}


def commit_of(source: Mapping[str, Any]) -> str:
    """The short name of a commit; says if its tree had changes, or if it is unknown."""
    if not source.get("commit"):
        return "no commit recorded"
    changed = "" if source["clean_tree"] else " with changes"
    return f"commit {source['commit'][:7]}{changed}"


def remembered(stored: Mapping[str, Any]) -> dict[str, Any]:
    """What a stored result says of the code that made it, as `source`; empty where it says nothing.

    Raises:
        ValueError: it says what no code could.
    """
    found = {name: stored[name] for name in SOURCE if name in stored}
    if not found:
        return {}
    commit, clean, training = (found.get(name, "") for name in SOURCE)
    if not (
        (commit is None or _named(_COMMIT, commit))
        and (clean is None or isinstance(clean, bool))
        and _named(_TRAINING, training)
    ):
        raise ValueError("it does not say which code made it")
    return found


def _named(pattern: re.Pattern[str], name: Any) -> bool:
    return isinstance(name, str) and pattern.fullmatch(name) is not None
