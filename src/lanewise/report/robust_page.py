"""Conditions on disk: `robust.json` with every cell, the map, and a page about both."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from lanewise.evaluation.cells import fold
from lanewise.evaluation.conditions import DENSITIES, EMPTY, HORIZONS, JUDGED, Condition
from lanewise.report import robust_map, robust_tables
from lanewise.report.figure_style import save
from lanewise.report.markup import cell as plain
from lanewise.report.markup import code
from lanewise.report.output_files import write_text
from lanewise.report.robust_tables import sorts
from lanewise.report.robust_tables import summary as summary
from lanewise.report.sweep_result import SweepResult, write_json


def write(directory: Path | str, result: SweepResult[Condition]) -> Path:
    """Write `robust.json`, the map as PNG and SVG, and last `robust.md`, whose path is returned."""
    directory = Path(directory)
    document = to_json(result)
    write_json(directory / "robust.json", document)
    save(robust_map.draw(result), directory / "robust")
    write_text(directory / "robust.md", _page(result, document))
    return directory / "robust.md"


def to_json(result: SweepResult[Condition]) -> dict[str, Any]:
    """`SweepResult.to_json`, with what the densities are, and totals by sort and by population."""
    by_population = {name: own for (name,), own in fold(result.cells, "population").items()}
    return result.to_json() | {
        "densities": {name: density._asdict() for name, density in DENSITIES.items()},
        "totals_by_sort": {name: result.totals(own) for name, own in sorts(result).items()},
        "totals_by_population": {name: result.totals(own) for name, own in by_population.items()},
    }


def _page(result: SweepResult[Condition], document: Mapping[str, Any]) -> str:
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


def _by(title: str, result: SweepResult[Condition], heads: list[str], *axes: str) -> list[str]:
    return [f"## By {title}", robust_tables.by_axes(result, heads, *axes)]


def _world(result: SweepResult[Condition]) -> str:
    of = result.settings
    crowds = [
        f"{name} {d.vehicles_ahead} ahead and {d.vehicles_behind} behind"
        + ("" if name == EMPTY else f", one every {d.spacing:g} m")
        for name, d in DENSITIES.items()
        if name in result.axes["density"]
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
