"""A sweep on disk: `map.json` with every start, the maps drawn from it, and a page about both."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import astuple, dataclass, fields
from pathlib import Path
from typing import Any

from lanewise.evaluation.grid import DENOMINATORS, Cell, Grid, Point, PointResult, Reach, fold, pool
from lanewise.report import sweep_map, tables
from lanewise.report.figure_style import save
from lanewise.report.markup import cell as plain
from lanewise.report.markup import code, finite
from lanewise.report.output_files import write_text
from lanewise.report.provenance import origin
from lanewise.report.sweep_map import MapAxes, figure_of

TITLES = {
    "all": "all starts",
    "winnable": "winnable starts",
    "winnable_with_clearance": "winnable with clearance",
}
COLUMNS = (*Point._fields, *(f.name for f in fields(Reach)), *(f.name for f in fields(PointResult)))
"""Of the table of starts in `map.json`."""
MAPS = {
    "map": (MapAxes(), "ego speed and trap speed, by lanes"),
    "map-distances": (MapAxes("side_distance", "front_distance"), "D2 and D1, by lanes"),
    "map-traffic": (MapAxes("spacing", "vehicles_behind"), "spacing and behind, by lanes"),
}
"""File names of the maps, what they show, and their captions."""
RATES = {"escape": "success (paper)", "success": "success", "accident": "accidents"}
"""Outcomes of a `Share`, and their titles."""
WORST = 8
"""Fields of the map that the page lists as the worst."""


@dataclass(frozen=True)
class SweepResult:
    """A controller over a grid."""

    controller: str
    training_seed: int
    trained_by: Mapping[str, Any]
    """The code its run was made with (`version.source`)."""
    settings: Mapping[str, Any]
    """With which it was tested, by dotted name."""
    grid: Grid
    episodes: int
    """Of each start."""
    seed: int
    """Of the traffic."""
    clearance: float
    """m."""
    command: str
    cells: Sequence[Cell]
    """All starts, in the grid's order."""
    trained_on: str = ""
    """Which of these settings its training had otherwise, in words; empty where none."""


def write_sweep(directory: Path | str, sweep: SweepResult) -> Path:
    """Write `map.json`, the maps as PNG and SVG, and last `map.md`, whose path is returned."""
    directory = Path(directory)
    document = to_json(sweep)
    # A line for each start.
    rows = [json.dumps(finite(row), allow_nan=False) for row in document["starts"]]
    head = json.dumps(finite({**document, "starts": []}), indent=2, allow_nan=False)
    starts = '"starts": [\n    ' + ",\n    ".join(rows) + "\n  ]"
    write_text(directory / "map.json", head.replace('"starts": []', starts) + "\n")
    captions = {}
    for name, (axes, caption) in MAPS.items():
        sizes = (len(getattr(sweep.grid, axis)) for axis in (axes.x, axes.y))
        if name == "map" or max(sizes) > 1:
            captions[name] = caption
            save(sweep_map.draw(sweep.cells, axes), directory / name)
    write_text(directory / "map.md", _page(sweep, document, captions))
    return directory / "map.md"


def to_json(sweep: SweepResult) -> dict[str, Any]:
    """Everything known of a sweep as plain values, the starts as rows under `columns`."""
    return {
        "controller": sweep.controller,
        "training_seed": sweep.training_seed,
        "trained_by": dict(sweep.trained_by),
        "command": sweep.command,
        **origin(),
        "episodes_per_start": sweep.episodes,
        "seed": sweep.seed,
        "clearance": sweep.clearance,
        "axes": {name: list(values) for name, values in vars(sweep.grid).items()},
        "totals": {name: pool(sweep.cells, name).to_json() for name in DENOMINATORS},
        "undecided_starts": sum(not c.reach.decided for c in sweep.cells),
        "settings": dict(sweep.settings),
        "trained_on": sweep.trained_on,
        "columns": list(COLUMNS),
        "starts": [[*c.point, *astuple(c.reach), *astuple(c.outcome)] for c in sweep.cells],
    }


def totals(cells: Sequence[Cell]) -> str:
    """Both successes and accidents over each denominator, as Markdown."""
    rows = []
    for name, title in TITLES.items():
        share = pool(cells, name).to_json()
        row = [title, str(share["starts"]), str(share["episodes"])]
        for outcome in RATES:
            rate, interval = share[f"{outcome}_rate"], share[f"{outcome}_interval"]
            if interval is None:
                row.append(tables.UNKNOWN)
            else:
                low, high = interval
                row.append(f"{100.0 * rate:.2f} % ({100.0 * low:.2f}, {100.0 * high:.2f})")
        rows.append(row)
    return tables.markdown(["over", "starts", "episodes", *RATES.values()], rows)


def _page(sweep: SweepResult, document: Mapping[str, Any], captions: Mapping[str, str]) -> str:
    parts = [
        f"# {plain(sweep.controller)} over a grid of starts",
        f"{code(sweep.command)}, {document['date']}",
        totals(sweep.cells),
        "In parentheses exact 95 % intervals of the pooled episodes. Success is to get past the "
        "trap without an accident, not even later; the paper's success forgives a later accident. "
        "A start is winnable if some sequence of the nine actions escapes without an accident "
        "within the test, other traffic left out. It is winnable with clearance if one of them "
        f"also stays {sweep.clearance:g} m away from the trap cars. Starts for which this is "
        f"undecided: {document['undecided_starts']}; they count as winnable.",
        *(f"![Success and accidents, {caption}]({name}.png)" for name, caption in captions.items()),
        "## Where it does worst",
        _worst(sweep.cells),
        "## The world",
        _world(sweep),
    ]
    return "\n\n".join(parts) + "\n"


def _worst(cells: Sequence[Cell]) -> str:
    """The fields of the map with the least success over their winnable starts."""
    places = fold(cells, "ego_speed", "trap_speed", "lanes").items()
    shares = [(place, pool(own, "winnable")) for place, own in places]
    known = [(place, share) for place, share in shares if share.episodes]
    known.sort(key=lambda item: item[1].rate("success"))
    rows = []
    for place, share in known[:WORST]:
        rates = (f"{figure_of(100.0 * share.rate(outcome))} %" for outcome in RATES)
        rows.append([*(f"{value:g}" for value in place), str(share.starts), *rates])
    heads = ["ego, m/s", "trap, m/s", "lanes", "winnable starts", *RATES.values()]
    return tables.markdown(heads, rows, texts=0)


def _world(sweep: SweepResult) -> str:
    """What every start had in common, and what the axes were."""
    of, axes = sweep.settings, vars(sweep.grid)
    names = ("vehicles_ahead", "speed", "first_gap", "spacing_jitter", "gap_behind")
    traffic = {name: of[f"scenario.traffic.{name}"] for name in names}
    model = {"idm": "IDM", "linear": "the linear model"}[of["scenario.traffic.driver.model"]]
    lines = [
        f"- {sweep.episodes} greedy episodes of {of['evaluation.duration']} s from each start, "
        f"traffic from seed {sweep.seed}; lanes {of['scenario.lane_width']:g} m wide.",
        *(f"- {name}: {', '.join(f'{v:g}' for v in values)}" for name, values in axes.items()),
        f"- {traffic['vehicles_ahead']} vehicles ahead at {traffic['speed']:g} m/s, the first "
        f"{traffic['first_gap']:g} m beyond the trap, each distance ± "
        f"{traffic['spacing_jitter']:g} m, lanes at random; vehicles behind from "
        f"{traffic['gap_behind']:g} m behind the ego. All drive by {model} and MOBIL.",
        f"- Controller: {plain(sweep.controller)}, training seed {sweep.training_seed}; the "
        "settings of the test are in `map.json`.",
    ]
    if sweep.trained_on:
        lines.append(f"- It was {plain(sweep.trained_on)}.")
    return "\n".join(lines)
