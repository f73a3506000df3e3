"""What a sweep found, whatever its grid, and how every page about one writes it."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any, Generic

from lanewise.evaluation.cells import DENOMINATORS, KINDS, Cell, Counts, PlaceType, Reach, pool
from lanewise.report import tables
from lanewise.report.markup import finite
from lanewise.report.output_files import write_text
from lanewise.report.provenance import origin

TITLES = {"accidents": "accidents", "escapes": "success (paper)", "successes": "success"}
"""Outcomes of `Counts`, as tables call them."""


@dataclass(frozen=True, kw_only=True)
class SweepResult(Generic[PlaceType]):
    """A controller over a grid."""

    controller: str
    training_seed: int
    trained_by: Mapping[str, Any]
    """The code its run was made with (`version.source`)."""
    trained_on: str = ""
    """Which of the settings its training had otherwise, in words; empty where none."""
    seen: tuple[str, ...]
    """Populations it has met in training."""
    settings: Mapping[str, Any]
    """With which it was tested, by dotted name."""
    changes: Mapping[str, Any]
    """Those of them that the user asked for."""
    run: str
    """As the user named it."""
    command: str
    episodes: int
    """Of each cell."""
    seed: int
    """Of the starts and the traffic."""
    clearance: float
    """m, see `Reach`."""
    horizons: Sequence[int]
    """Times at which the drives are judged, s."""
    axes: Mapping[str, Sequence[Any]]
    """Of the grid."""
    cells: Sequence[Cell[PlaceType]]
    """All of them, in the grid's order."""

    def to_json(self) -> dict[str, Any]:
        """Everything known of it as plain values, the cells as rows under `columns`."""
        return {
            "controller": self.controller,
            "training_seed": self.training_seed,
            "trained_by": dict(self.trained_by),
            "trained_on": self.trained_on,
            "seen_in_training": list(self.seen),
            "command": self.command,
            **origin(),
            "episodes_per_cell": self.episodes,
            "seed": self.seed,
            "clearance": self.clearance,
            "horizons": list(self.horizons),
            "axes": {name: list(values) for name, values in self.axes.items()},
            "totals": self.totals(self.cells),
            "undecided": sum(c.reach is not None and not c.reach.decided for c in self.cells),
            "settings": dict(self.settings),
            "columns": list(_row(self.cells[0], self.horizons)),
            "cells": [list(_row(cell, self.horizons).values()) for cell in self.cells],
        }

    def totals(self, cells: Sequence[Cell[PlaceType]]) -> dict[str, Any]:
        """Counts and rates of some cells, by horizon and denominator."""
        return {
            str(seconds): {over: pool(cells, horizon, over).to_json() for over in DENOMINATORS}
            for horizon, seconds in enumerate(self.horizons)
        }


def _row(cell: Cell[Any], horizons: Sequence[int]) -> dict[str, Any]:
    """A cell by column: its values on the axes, whether it can be won, and what came of it."""
    found, reach = cell.outcome, cell.reach
    row: dict[str, Any] = cell.place._asdict()
    row |= {each.name: getattr(reach, each.name, None) for each in fields(Reach)}
    row |= {"episodes": found.episodes, "speed": found.speed, "reward": found.reward}
    for horizon, seconds in enumerate(horizons):
        counts = {
            "escapes": found.escapes[horizon],
            "successes": found.successes[horizon],
            "first_accident": found.first_accident[horizon],
            **dict(zip(KINDS, found.kinds[horizon], strict=True)),
        }
        row |= {f"{name}_{seconds}": count for name, count in counts.items()}
    return row


def write_json(path: Path, document: Mapping[str, Any]) -> None:
    """Write a document of `SweepResult`, with a line for each cell."""
    rows = [json.dumps(finite(row), allow_nan=False) for row in document["cells"]]
    head = json.dumps(finite({**document, "cells": []}), indent=2, allow_nan=False)
    cells = '"cells": [\n    ' + ",\n    ".join(rows) + "\n  ]"
    write_text(path, head.replace('"cells": []', cells) + "\n")


def share(counts: Counts, name: str) -> str:
    """How often an outcome came, %, with its interval."""
    interval = counts.interval(name)
    if interval is None:
        return tables.UNKNOWN
    low, high = (100.0 * end for end in interval)
    return f"{100.0 * counts.rate(name):.2f} % ({low:.2f}, {high:.2f})"


def figure_of(percent: float) -> str:
    """A percentage in four characters at most; 100 and 0 only where they are exact."""
    if percent in (0.0, 100.0):
        return f"{percent:.0f}"
    return f"{min(max(percent, 0.1), 99.9):.1f}"
