"""The tests of a run on disk: ``tests/WORLD.csv``, the episodes, and ``tests/WORLD.json``.

A test remembers the seed, the settings and the weights it was made with, so that it counts for its
own run alone.
"""

import hashlib
import os
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from lanewise.errors import CheckpointError, RunError
from lanewise.evaluation import metrics
from lanewise.evaluation.episodes import Episodes
from lanewise.evaluation.metrics import Summary
from lanewise.report import provenance
from lanewise.runs import checkpoint
from lanewise.runs.run_folder import LARGEST_SETTINGS
from lanewise.system import safe_io
from lanewise.system.folder_io import OpenFolder, write_atomically

SETTINGS = "settings.toml"
"""What a run was made with; of a reference driver, what it was tested with."""
TESTS = "tests"
"""Folder of a run that holds its tests."""
_LARGEST_TABLE, _LARGEST_SUMMARY = 64_000_000, 100_000
"""Bytes of a test's episodes and of its summary."""
_FORMAT, _VERSION = "lanewise-test", 1
_REMEDY = "; delete it, and the test is driven again"


@dataclass(frozen=True)
class StoredTest:
    """A test in one world."""

    summary: Summary
    episodes: Episodes
    seconds: float
    """Wall time of the test."""


def store(
    place: OpenFolder,
    controller: str,
    world: str,
    episodes: Episodes,
    seconds: float,
    seed: int,
    weights: str | None,
) -> None:
    """Keep a test, which took so many seconds, in the folder of its run; the rest is as of `read`.

    Raises:
        LanewiseError: the run's settings or weights are missing or damaged.
    """
    table = metrics.to_csv(episodes).encode()
    stored: dict[str, Any] = {
        "summary": metrics.summarise(episodes, controller=controller, world=world).to_json(),
        "seconds": round(seconds, 2),
        "run": _identity(place.path, seed, weights),
        **provenance.source(),
        "versions": provenance.versions(),
        "machine": provenance.machine(),
        "episodes_sha256": _sha256(table),
    }
    text = safe_io.document(_FORMAT, _VERSION, stored)
    with place.inside(TESTS) as folder:
        write_atomically(folder, {f"{world}.csv": table, f"{world}.json": text})


def read(
    path: Path, controller: str, world: str, seed: int, weights: str | None
) -> StoredTest | None:
    """A stored test; None if it was not run yet.

    Args:
        path: the run folder.
        controller: its name.
        world: where it was tested.
        seed: of the run.
        weights: file name of its controller; None for a reference driver.

    Raises:
        RunError: the test is damaged or of another run.
    """
    file, table = path / TESTS / f"{world}.json", path / TESTS / f"{world}.csv"
    if not os.path.lexists(file):
        return None
    try:
        stored = safe_io.read_document(file, _FORMAT, _VERSION, _LARGEST_SUMMARY)
        content = safe_io.read_bytes(table, _LARGEST_TABLE, links=False)
    except safe_io.UnreadableError as error:
        raise RunError(f"{error}{_REMEDY}") from error
    try:
        run = _identity(path, seed, weights)
    except (CheckpointError, safe_io.UnreadableError) as error:
        raise RunError(f"{file} cannot be matched to its run: {error}{_REMEDY}") from error
    tested = (stored["summary"]["controller"], stored["summary"]["world"], stored["run"])
    if tested != (controller, world, run):
        raise RunError(f"{file} is a test of another run{_REMEDY}")
    if _sha256(content) != stored["episodes_sha256"]:
        raise RunError(f"{table} was altered{_REMEDY}")
    episodes = metrics.from_csv(content.decode("utf-8"))
    summary = metrics.summarise(episodes, controller=controller, world=world)
    return StoredTest(summary, episodes, stored["seconds"])


def _identity(path: Path, seed: int, weights: str | None) -> dict[str, Any]:
    """What a test remembers of its run."""
    text = safe_io.read_bytes(path / SETTINGS, LARGEST_SETTINGS, links=False)
    return {
        "seed": seed,
        "settings_sha256": _sha256(text),
        "weights_sha256": checkpoint.read_manifest(path, weights)["sha256"] if weights else None,
    }


def _sha256(content: bytes) -> str:
    return hashlib.sha256(content).hexdigest()
