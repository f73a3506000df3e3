"""What a stored test is of: its run, told by seed, settings and weights. Imports no JAX."""

import hashlib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from lanewise.runs import checkpoint
from lanewise.runs.folder import LARGEST_SETTINGS
from lanewise.system import safe_io


def of(path: Path, settings: str, seed: int, controller: str | None) -> dict[str, Any]:
    """What a test remembers of its run.

    Args:
        path: the run folder.
        settings: name of the file with its settings.
        seed: of the run.
        controller: name of the files with its weights; None where it has none.

    Raises:
        UnreadableError: the settings cannot be read.
        CheckpointError: there are no weights, or they are damaged.
    """
    text = safe_io.read_bytes(path / settings, LARGEST_SETTINGS, links=False)
    return {
        "seed": seed,
        "settings_sha256": hashlib.sha256(text).hexdigest(),
        "weights_sha256": checkpoint.read_digest(path, controller) if controller else None,
    }


def fits(
    stored: Mapping[str, Any], run: Mapping[str, Any] | None, controller: str, world: str
) -> bool:
    """Whether a stored test is that of a run in a world.

    Args:
        stored: what the test left, with its ``summary``.
        run: what it must remember of its run; None where it remembers nothing.
        controller: of the run.
        world: where it drove.
    """
    summary = stored["summary"]
    same = summary["controller"] == controller and summary["world"] == world
    return bool(same and stored.get("run") == run)
