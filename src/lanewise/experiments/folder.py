"""Whose a folder of runs and reports is: that of one experiment. Imports no JAX."""

import json
import os
import re
from collections.abc import Iterator
from pathlib import Path

from lanewise.errors import RunError, brief
from lanewise.experiments.experiment import Experiment
from lanewise.runs.files import OpenFolder, write_atomically
from lanewise.runs.folder import require_empty
from lanewise.system import safe_io

NAME = "experiment.json"
"""The file that names the experiment, written before anything else."""
RUNS = "runs"
"""Holds a folder for each arm, and in it one for each seed."""
_FORMAT = "lanewise-experiment"
_LARGEST = 10_000
_SEED = re.compile(r"seed-[0-9]+")


def check(out: Path, experiment: Experiment) -> None:
    """Refuses a folder that is neither new, nor empty, nor one of this experiment.

    Raises:
        RunError: says what it holds.
    """
    if os.path.lexists(out / NAME):
        other = _named(out / NAME)
        if other != experiment.name:
            raise RunError(
                f'{out} holds experiment "{brief(other)}", not "{brief(experiment.name)}"; '
                "choose another folder"
            )
    elif not _from_before(out, experiment):
        require_empty(out)


def mark(out: OpenFolder, experiment: Experiment) -> None:
    """Name the experiment in its folder; nothing that is there already is written anew."""
    if not os.path.lexists(out.path / NAME):
        text = json.dumps({"format": _FORMAT, "experiment": experiment.name}, indent=2) + "\n"
        write_atomically(out, {NAME: text.encode()})


def _named(file: Path) -> str:
    """The experiment that a folder's file names."""
    try:
        found = safe_io.parse_json(safe_io.read_bytes(file, _LARGEST, links=False))
        if other := safe_io.format_mismatch(found, _FORMAT, 1):
            raise RunError(f"{file} {other}")
        if not isinstance(found, dict) or found.keys() != {"format", "experiment"}:
            raise ValueError("it has other fields")
        if not isinstance(found["experiment"], str):
            raise ValueError("it is of something else")
    except (ValueError, safe_io.UnreadableError) as error:
        raise RunError(
            f"{file} does not name an experiment: {error}\n"
            "  choose another folder, or delete it if the runs are of this experiment"
        ) from error
    name: str = found["experiment"]
    return name


def _from_before(out: Path, experiment: Experiment) -> bool:
    """Whether a folder that names no experiment holds runs, which are then all of this one.

    Folders made before they were named hold nothing else under ``runs``.

    Raises:
        RunError: it holds something else besides.
    """
    strange = list(_strange(out / RUNS, {arm.name for arm in experiment.arms}))
    # A report is written after its data.
    if (out / "report.md").exists() and not (out / "report.json").exists():
        strange.append(out / "report.md")
    found = any((out / RUNS).glob("*/seed-*"))
    if found and strange:
        raise RunError(f"{strange[0]} is not of this experiment; choose another folder")
    return found


def _strange(runs: Path, arms: set[str]) -> Iterator[Path]:
    """What lies among the runs and is none of these arms'."""
    for arm in _members(runs):
        if arm.name not in arms or not arm.is_dir():
            yield arm
            continue
        for seed in _members(arm):
            if not _SEED.fullmatch(seed.name) or not seed.is_dir():
                yield seed


def _members(folder: Path) -> list[Path]:
    return sorted(folder.iterdir()) if folder.is_dir() else []
