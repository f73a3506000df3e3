"""Conditions on disk: `robust.json` with every cell, the map, and a page about both."""

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from lanewise.evaluation.conditions import (
    DENSITIES,
    EMPTY,
    HORIZONS,
    JUDGED,
    KINDS,
    Condition,
    ConditionCell,
    HorizonCounts,
    pooled,
)
from lanewise.evaluation.grid import Reach
from lanewise.report import robust_map, robust_tables
from lanewise.report.figure_style import save
from lanewise.report.markup import cell as plain
from lanewise.report.markup import code, finite
from lanewise.report.output_files import write_text
from lanewise.report.provenance import origin
from lanewise.report.robust_tables import RobustResult as RobustResult
from lanewise.report.robust_tables import fold
from lanewise.report.robust_tables import summary as summary

COLUMNS = (
    *Condition._fields,
    *("sort", "winnable", "episodes"),
    *(
        f"{name}_{seconds}"
        for seconds in HORIZONS
        for name in ("escapes", "successes", "first_accident", *KINDS)
    ),
)
"""Of the table of cells in `robust.json`."""


def write_robust(directory: Path | str, result: RobustResult) -> Path:
    """Write `robust.json`, the map as PNG and SVG, and last `robust.md`, whose path is returned."""
    directory = Path(directory)
    document = to_json(result)
    # A line for each cell.
    rows = [json.dumps(finite(row), allow_nan=False) for row in document["cells"]]
    head = json.dumps(finite({**document, "cells": []}), indent=2, allow_nan=False)
    cells = '"cells": [\n    ' + ",\n    ".join(rows) + "\n  ]"
    write_text(directory / "robust.json", head.replace('"cells": []', cells) + "\n")
    save(robust_map.draw(result), directory / "robust")
    write_text(directory / "robust.md", _page(result, document))
    return directory / "robust.md"


def to_json(result: RobustResult) -> dict[str, Any]:
    """Everything known of it as plain values, the cells as rows under `columns`."""
    sorts = {**result.sorts(), "all": list(result.cells)}
    by_population = {name: own for (name,), own in fold(result.cells, "population").items()}
    return {
        "controller": result.controller,
        "training_seed": result.training_seed,
        "trained_by": dict(result.trained_by),
        "command": result.command,
        **origin(),
        "episodes_per_cell": result.episodes,
        "seed": result.seed,
        "clearance": result.clearance,
        "horizons": list(HORIZONS),
        "axes": {name: list(values) for name, values in vars(result.grid).items()},
        "densities": {name: density._asdict() for name, density in DENSITIES.items()},
        "seen_in_training": list(result.seen),
        "totals": {name: _totals(cells) for name, cells in sorts.items()},
        "totals_by_population": {name: _totals(own) for name, own in by_population.items()},
        "reach": [_reach(place, reach) for place, reach in result.reached.items()],
        "settings": dict(result.settings),
        "trained_on": result.trained_on,
        "columns": list(COLUMNS),
        "cells": [_row(result, cell) for cell in result.cells],
    }


def _row(result: RobustResult, cell: ConditionCell) -> list[Any]:
    found = cell.outcome
    counts = zip(found.escapes, found.successes, found.first_accident, found.kinds, strict=True)
    by_horizon = [value for *three, kinds in counts for value in (*three, *kinds)]
    return [*cell.condition, result.sort(cell), cell.winnable, found.episodes, *by_horizon]


def _reach(place: tuple[float, float, int], reach: Reach) -> dict[str, Any]:
    return dict(zip(("ego_speed", "trap_speed", "lanes"), place, strict=True)) | vars(reach)


def _totals(cells: list[ConditionCell]) -> dict[str, Any]:
    """Counts and rates by horizon, over all cells and over the winnable ones."""
    return {
        str(seconds): {
            over: _counts(pooled(cells, horizon, winnable=over == "winnable"))
            for over in ("all", "winnable")
        }
        for horizon, seconds in enumerate(HORIZONS)
    }


def _counts(counts: HorizonCounts) -> dict[str, Any]:
    stored: dict[str, Any] = vars(counts) | {"kinds": dict(zip(KINDS, counts.kinds, strict=True))}
    for name in ("accidents", "escapes", "successes"):
        rate, interval = counts.rate(name), counts.interval(name)
        stored |= {name: getattr(counts, name), f"{name}_rate": rate, f"{name}_interval": interval}
    return stored


def _page(result: RobustResult, document: Mapping[str, Any]) -> str:
    judged, test = HORIZONS[JUDGED], HORIZONS[0]
    seen = ", ".join(result.seen) or "none of these populations"
    parts = [
        f"# {plain(result.controller)} over conditions it may meet",
        f"{code(result.command)}, {document['date']}",
        summary(result),
        f"Seen in training: {plain(seen)}. In parentheses exact 95 % intervals of the pooled "
        "episodes. All cells share their starts: cells compare well, and an interval over many of "
        "them is too narrow. Without traffic all episodes of a cell are alike. The worst cell is "
        "the worst of all, its interval that of a cell chosen beforehand.",
        f"Each drive lasts {HORIZONS[-1]} s and is judged at {', '.join(map(str, HORIZONS))} s. "
        "Success is to be past the trap by then without an accident by then; the paper's success "
        "forgives a later accident. Shares of success count winnable cells alone: some sequence of "
        f"the nine actions escapes within {test} s without an accident, other traffic, noise and "
        "latency left out. In two lanes the right drive is to follow: such cells count for "
        "accidents alone.",
        f"![Accidents by {judged} s and success by {test} s](robust.png)",
        "## By population",
        "Outcomes in these tables are percentages.",
        robust_tables.by_axes(result, ["population", ""], "population"),
        *_by("density", result, ["density"], "density"),
        *_by("lanes", result, ["lanes"], "lanes"),
        *_by("speeds", result, ["ego, m/s", "trap, m/s"], "ego_speed", "trap_speed"),
        *_by("noise and latency", result, ["noise", "latency, s"], "noise", "latency"),
        "## Accidents by kind",
        robust_tables.by_kind(result),
        "## Where it does worst",
        robust_tables.worst(result),
        "## What can be won",
        robust_tables.winnable(result),
        "## The world",
        _world(result),
    ]
    return "\n\n".join(parts) + "\n"


def _by(title: str, result: RobustResult, heads: list[str], *axes: str) -> list[str]:
    return [f"## By {title}", robust_tables.by_axes(result, heads, *axes)]


def _world(result: RobustResult) -> str:
    of = result.settings
    crowds = [
        f"{name} {d.vehicles_ahead} ahead and {d.vehicles_behind} behind"
        + ("" if name == EMPTY else f", one every {d.spacing:g} m")
        for name, d in DENSITIES.items()
        if name in result.grid.density
    ]
    lines = [
        f"- {result.episodes} greedy episodes of each cell, the same starts of seed {result.seed} "
        f"in all; D1 {of['scenario.test_front_distance']:g} m, "
        f"D2 {of['scenario.test_side_distance']:g} m.",
        f"- Traffic: {'; '.join(crowds)}. It starts at {of['scenario.traffic.speed']:g} m/s.",
        f"- Controller: {plain(result.controller)}, training seed {result.training_seed}; its "
        "settings are in `robust.json`.",
    ]
    if result.trained_on:
        lines.append(f"- It was {plain(result.trained_on)}.")
    return "\n".join(lines)
