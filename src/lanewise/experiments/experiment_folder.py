"""Whose a folder of runs and reports is: that of one experiment. Imports no JAX."""

import json
import os
from pathlib import Path

from lanewise.errors import RunError, brief
from lanewise.experiments.experiment import Experiment
from lanewise.runs.run_folder import require_empty
from lanewise.system import safe_io
from lanewise.system.folder_io import OpenFolder, write_atomically

NAME = "experiment.json"
"""The file that names the experiment, written before anything else."""
RUNS = "runs"
"""Holds a folder for each arm, and in it one for each seed."""
_FORMAT = "lanewise-experiment"
_LARGEST = 10_000


def check(out: Path, experiment: Experiment) -> None:
    """Refuse a folder that is neither new, nor empty, nor one of this experiment."""
    if not os.path.lexists(out / NAME):
        require_empty(out)
        return
    other = _name_in(out / NAME)
    if other != experiment.name:
        raise RunError(
            f'{out} holds experiment "{brief(other)}", not "{brief(experiment.name)}"; '
            "choose another folder"
        )


def mark(out: OpenFolder, experiment: Experiment) -> None:
    """Name the experiment in its folder; an existing file stays as it is."""
    if not os.path.lexists(out.path / NAME):
        text = json.dumps({"format": _FORMAT, "experiment": experiment.name}, indent=2) + "\n"
        write_atomically(out, {NAME: text.encode()})


def _name_in(file: Path) -> str:
    try:
        found = safe_io.parse_json(safe_io.read_bytes(file, _LARGEST, links=False))
        if other := safe_io.format_mismatch(found, _FORMAT, 1):
            raise RunError(f"{file} {other}")
        if not isinstance(found, dict) or not isinstance(found.get("experiment"), str):
            raise ValueError("it has other fields")
    except (ValueError, safe_io.UnreadableError) as error:
        raise RunError(
            f"{file} does not name an experiment: {error}\n"
            "  choose another folder, or delete it if the runs are of this experiment"
        ) from error
    name: str = found["experiment"]
    return name
