"""Which code this is: its version, its commit, and what its training computes. Imports no JAX."""

import hashlib
import json
import subprocess
from functools import cache
from pathlib import Path
from typing import Any

__version__ = "0.1.0"

PACKAGE = Path(__file__).parent
BUILT_FROM = "commit.json"
"""File that a build leaves in the installed package (`hatch_build.py`)."""
FIRST_UPDATES = PACKAGE / "first_updates.json"
"""What the first 200 updates of each training compute (`tests/training/first_updates.py`)."""


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
    except OSError:
        return {"commit": None, "clean_tree": None}
    return found


def of_checkout(root: Path) -> dict[str, Any]:
    """As `commit`, of the checkout in a folder."""
    try:
        head, changes = (
            subprocess.run(
                ["git", "-C", str(root), *words], capture_output=True, text=True, check=True
            ).stdout
            for words in (["rev-parse", "HEAD"], ["status", "--porcelain"])
        )
    except (OSError, subprocess.CalledProcessError):
        return {"commit": None, "clean_tree": None}
    return {"commit": head.strip(), "clean_tree": not changes}


@cache
def training() -> str:
    """Name of what training computes: it changes when the stored first updates do.

    Two results of one name were trained by code that agrees in its first updates.
    """
    return hashlib.sha256(FIRST_UPDATES.read_bytes()).hexdigest()[:12]
