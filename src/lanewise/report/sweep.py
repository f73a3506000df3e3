"""A sweep on disk: `map.json` with every start, the maps drawn from it, and a page about both."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import astuple, dataclass, fields
from datetime import UTC, datetime
from math import isfinite
from pathlib import Path
from typing import Any

from lanewise.evaluation.grid import DENOMINATORS, Cell, Grid, Outcome, Point, Reach, fold, pool
from lanewise.evaluation.statistics import Interval
from lanewise.report.escape import cell as plain
from lanewise.report.escape import code, finite
from lanewise.report.files import write_text
from lanewise.report.map import View, figure_of, write_map
from lanewise.report.provenance import machine, source, versions

TITLES = {
    "all": "all starts",
    "winnable": "winnable starts",
    "winnable_with_clearance": "winnable with clearance",
}
COLUMNS = (*Point._fields, *(f.name for f in fields(Reach)), *(f.name for f in fields(Outcome)))
"""Of the table of starts in `map.json`."""
VIEWS = {
    "map": (View(), "ego speed and trap speed, by lanes"),
    "map-distances": (View("side_distance", "front_distance", "lanes"), "D2 and D1, by lanes"),
    "map-traffic": (View("spacing", "vehicles_behind", "lanes"), "spacing and behind, by lanes"),
}
"""File names of the maps, what they show, and their captions."""
WORST = 8
"""Fields of the map that the page lists as the worst."""


@dataclass(frozen=True)
class Sweep:
    """A controller over a grid."""

    controller: str
    """Its name."""
    training_seed: int
    """Of its run."""
    trained_by: Mapping[str, Any]
    """The code its run was made with (`version.source`)."""
    settings: Mapping[str, Any]
    """Of its run, by dotted name."""
    grid: Grid
    episodes: int
    """Of each start."""
    seed: int
    """Of the traffic."""
    clearance: float
    """m."""
    command: str
    """The command that made it."""
    cells: Sequence[Cell]
    """All starts, in the grid's order."""


def write_sweep(directory: Path | str, sweep: Sweep) -> Path:
    """Write `map.json`, the maps as PNG and SVG, and `map.md`.

    Returns:
        The path of `map.md`, written last: where it is, the rest is complete.

    Raises:
        LanewiseError: if a file cannot be written.
    """
    directory = Path(directory)
    document = to_json(sweep)
    write_text(directory / "map.json", _dump(document))
    drawn = {name: VIEWS[name] for name in VIEWS if name == "map" or _varies(sweep.grid, name)}
    for name, (view, _) in drawn.items():
        for suffix in (".png", ".svg"):
            write_map(sweep.cells, directory / f"{name}{suffix}", view)
    page = _page(sweep, document, {name: caption for name, (_, caption) in drawn.items()})
    write_text(directory / "map.md", page)
    return directory / "map.md"


def _varies(grid: Grid, name: str) -> bool:
    view = VIEWS[name][0]
    return len(getattr(grid, view.x)) > 1 or len(getattr(grid, view.y)) > 1


def to_json(sweep: Sweep) -> dict[str, Any]:
    """Everything known of a sweep as plain values, the starts as rows under `columns`."""
    return {
        "controller": sweep.controller,
        "training_seed": sweep.training_seed,
        "trained_by": dict(sweep.trained_by),
        "date": datetime.now(UTC).isoformat(timespec="seconds"),
        "command": sweep.command,
        **source(),
        "versions": versions(),
        "machine": machine(),
        "episodes_per_start": sweep.episodes,
        "seed": sweep.seed,
        "clearance": sweep.clearance,
        "axes": {name: list(values) for name, values in vars(sweep.grid).items()},
        "totals": {name: pool(sweep.cells, name).to_json() for name in DENOMINATORS},
        "undecided_starts": sum(not c.reach.decided for c in sweep.cells),
        "settings": dict(sweep.settings),
        "columns": list(COLUMNS),
        "starts": [[*c.point, *astuple(c.reach), *astuple(c.outcome)] for c in sweep.cells],
    }


def cells_of(document: Mapping[str, Any]) -> list[Cell]:
    """The starts of a `map.json`, to draw or to count them anew."""
    rows = [dict(zip(document["columns"], row, strict=True)) for row in document["starts"]]
    return [
        Cell(
            Point(**{name: row[name] for name in Point._fields}),
            Reach(**{f.name: row[f.name] for f in fields(Reach)}),
            # Older maps lack the paper's success.
            Outcome(**{f.name: row[f.name] for f in fields(Outcome) if f.name in row}),
        )
        for row in rows
    ]


def _dump(document: Mapping[str, Any]) -> str:
    """JSON with a line for each start."""
    rows = [json.dumps(finite(row), allow_nan=False) for row in document["starts"]]
    head = json.dumps(finite({**document, "starts": []}), indent=2, allow_nan=False)
    return head.replace('"starts": []', '"starts": [\n    ' + ",\n    ".join(rows) + "\n  ]") + "\n"


def table(cells: Sequence[Cell]) -> str:
    """Both successes and accidents over each denominator, as Markdown."""
    lines = [
        "| over | starts | episodes | success (paper) | success | accidents |",
        "|---|---:|---:|---:|---:|---:|",
    ]
    for name, title in TITLES.items():
        share = pool(cells, name)
        counts = f"| {title} | {share.starts} | {share.episodes} |"
        if not share.episodes:
            lines.append(f"{counts} - | - | - |")
            continue
        numbers = share.to_json()
        rates = (
            _rate(numbers[f"{name}_rate"], numbers[f"{name}_interval"])
            for name in ("escape", "success", "accident")
        )
        lines.append(f"{counts} {' | '.join(rates)} |")
    return "\n".join(lines)


def _rate(value: float, interval: Interval | None) -> str:
    if interval is None:
        return "-"
    low, high = (f"{100.0 * end:.2f}" for end in interval)
    return f"{100.0 * value:.2f} % ({low}, {high})"


def _page(sweep: Sweep, document: Mapping[str, Any], captions: Mapping[str, str]) -> str:
    parts = [
        f"# {plain(sweep.controller)} over a grid of starts",
        f"{code(sweep.command)}, {document['date']}",
        table(sweep.cells),
        "In parentheses exact 95 % intervals of the pooled episodes. Success is to get past the "
        "trap without an accident, not even later; the paper's success forgives a later accident. "
        "A start is winnable unless no sequence of the nine actions, without other traffic, is an "
        "escape without an accident within the test; with clearance, unless none of them stays "
        f"{sweep.clearance:g} m away from the trap cars. Starts for which that is undecided: "
        f"{document['undecided_starts']}; they count as winnable.",
        *(f"![Success and accidents, {caption}]({name}.png)" for name, caption in captions.items()),
        "## Where it does worst",
        _worst(sweep.cells),
        "## The world",
        _world(sweep),
    ]
    return "\n\n".join(parts) + "\n"


def _worst(cells: Sequence[Cell]) -> str:
    """The fields of the map with the least success over their winnable starts."""
    shares = {
        place: pool(own, "winnable")
        for place, own in fold(cells, "ego_speed", "trap_speed", "lanes").items()
    }
    known = [(place, share) for place, share in shares.items() if share.episodes]
    known.sort(key=lambda item: item[1].success_rate)
    lines = [
        "| ego, m/s | trap, m/s | lanes | winnable starts "
        "| success (paper) | success | accidents |",
        "|---:|---:|---:|---:|---:|---:|---:|",
    ]
    for (ego, trap, lanes), share in known[:WORST]:
        rates = " | ".join(
            f"{figure_of(100.0 * rate)} %" if isfinite(rate) else "-"
            for rate in (share.escape_rate, share.success_rate, share.accident_rate)
        )
        lines.append(f"| {ego:g} | {trap:g} | {lanes} | {share.starts} | {rates} |")
    return "\n".join(lines)


def _world(sweep: Sweep) -> str:
    """What every start had in common, and what the axes were."""
    of, axes = sweep.settings, vars(sweep.grid)
    traffic = {name: of[f"scenario.traffic.{name}"] for name in _TRAFFIC}
    lines = [
        f"- {sweep.episodes} greedy episodes of {of['evaluation.duration']} s from each start, "
        f"traffic from seed {sweep.seed}; lanes {of['scenario.lane_width']:g} m wide.",
        *(f"- {name}: {', '.join(f'{v:g}' for v in values)}" for name, values in axes.items()),
        f"- {traffic['vehicles_ahead']} vehicles ahead at {traffic['speed']:g} m/s, the first "
        f"{traffic['first_gap']:g} m beyond the trap, each distance ± "
        f"{traffic['spacing_jitter']:g} m, lanes at random; vehicles behind from "
        f"{traffic['gap_behind']:g} m behind the ego. All drive by IDM and MOBIL.",
        f"- Controller: {plain(sweep.controller)}, training seed {sweep.training_seed}; its "
        "settings are in `map.json`.",
    ]
    return "\n".join(lines)


_TRAFFIC = ("vehicles_ahead", "speed", "first_gap", "spacing_jitter", "gap_behind")
