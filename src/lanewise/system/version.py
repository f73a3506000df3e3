"""The version of this code, its commit, and a digest of its training. Imports no JAX."""

import hashlib
import json
import subprocess
from collections.abc import Mapping
from functools import cache
from pathlib import Path
from typing import Any

__version__ = "0.1.0"

PACKAGE = Path(__file__).parents[1]
BUILT_FROM = "commit.json"
"""File that a build leaves in the installed package (`hatch_build.py`)."""
FIRST_UPDATES = PACKAGE / "first_updates.json"
"""What the first 200 updates of each training compute (`tests/training/first_updates.py`)."""
SOURCE = ("commit", "clean_tree", "training")
"""Fields by which a result says which code made it (`source`)."""


@cache
def commit() -> dict[str, Any]:
    """The commit of this code, and whether its tree was clean; both None where unknown.

    In a checkout git tells; an installed package has a file that its build left.
    """
    root = PACKAGE.parents[1]
    if (root / ".git").exists() and (root / "src" / PACKAGE.name) == PACKAGE:
        return checkout_commit(root)
    try:
        found: dict[str, Any] = json.loads((PACKAGE / BUILT_FROM).read_text("utf-8"))
    except (OSError, ValueError):
        return {"commit": None, "clean_tree": None}
    return found


def checkout_commit(root: Path) -> dict[str, Any]:
    """The commit of the checkout in a folder, as `commit`."""
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
    """Digest of what training computes: it changes when the stored first updates do.

    Two results with the same digest were trained by code that agrees in its first updates.
    """
    return hashlib.sha256(FIRST_UPDATES.read_bytes()).hexdigest()[:12]


def source() -> dict[str, Any]:
    """The commit, whether its tree was clean, and the digest of what training computes."""
    return commit() | {"training": training()}


def commit_of(source: Mapping[str, Any]) -> str:
    """A short commit for people; says if its tree had changes, or if the commit is unknown."""
    if not source.get("commit"):
        return "no commit recorded"
    changed = "" if source["clean_tree"] else " with changes"
    return f"commit {source['commit'][:7]}{changed}"


def recorded(stored: Mapping[str, Any]) -> dict[str, Any]:
    """The code that made a stored result, as `source`; absent fields are None."""
    return {name: stored.get(name) for name in SOURCE}
