"""A sweep of starts on disk: `map.json`, the maps drawn from it, and a page about both."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from lanewise.evaluation.cells import OUTCOMES, Cell, fold, pool
from lanewise.evaluation.grid import Point
from lanewise.report import sweep_map, tables
from lanewise.report.figure_style import save
from lanewise.report.markup import cell as plain
from lanewise.report.markup import code
from lanewise.report.output_files import write_text
from lanewise.report.sweep_map import MapAxes
from lanewise.report.sweep_result import TITLES, SweepResult, figure_of, share, write_json

OVER = {
    "all": "all starts",
    "winnable": "winnable starts",
    "winnable_with_clearance": "winnable with clearance",
}
"""Denominators, and their titles."""
MAPS = {
    "map": (MapAxes(), "ego speed and trap speed, by lanes"),
    "map-distances": (MapAxes("side_distance", "front_distance"), "D2 and D1, by lanes"),
    "map-traffic": (MapAxes("spacing", "vehicles_behind"), "spacing and behind, by lanes"),
}
"""File names of the maps, what they show, and their captions."""
HEADS = [TITLES[name] for name in OUTCOMES]
WORST = 8
"""Fields of the map that the page lists as the worst."""


def write(directory: Path | str, sweep: SweepResult[Point]) -> Path:
    """Write `map.json`, the maps as PNG and SVG, and last `map.md`, whose path is returned."""
    directory = Path(directory)
    document = sweep.to_json()
    write_json(directory / "map.json", document)
    captions = {}
    for name, (axes, caption) in MAPS.items():
        sizes = (len(sweep.axes[axis]) for axis in (axes.x, axes.y))
        if name == "map" or max(sizes) > 1:
            captions[name] = caption
            save(sweep_map.draw(sweep.cells, axes), directory / name)
    write_text(directory / "map.md", _page(sweep, document, captions))
    return directory / "map.md"


def summary(sweep: SweepResult[Point]) -> str:
    """Both successes and accidents over each denominator, as Markdown."""
    rows = []
    for over, title in OVER.items():
        counts = pool(sweep.cells, 0, over)
        shares = (share(counts, name) for name in OUTCOMES)
        rows.append([title, str(counts.cells), str(counts.episodes), *shares])
    return tables.markdown(["over", "starts", "episodes", *HEADS], rows)


def _page(
    sweep: SweepResult[Point], document: Mapping[str, Any], captions: Mapping[str, str]
) -> str:
    parts = [
        f"# {plain(sweep.controller)} over a grid of starts",
        f"{code(sweep.command)}, {document['date']}",
        summary(sweep),
        "In parentheses exact 95 % intervals of the pooled episodes. Success is to get past the "
        "trap without an accident, not even later; the paper's success forgives a later accident. "
        "A start is winnable if some sequence of the nine actions escapes without an accident "
        "within the test, other traffic left out. It is winnable with clearance if one of them "
        f"also stays {sweep.clearance:g} m away from the trap cars. Starts for which this is "
        f"undecided: {document['undecided']}; they count as winnable.",
        *(f"![Success and accidents, {caption}]({name}.png)" for name, caption in captions.items()),
        "## Where it does worst",
        _worst(sweep.cells),
        "## The world",
        _world(sweep),
    ]
    return "\n\n".join(parts) + "\n"


def _worst(cells: Sequence[Cell[Point]]) -> str:
    """The fields of the map with the least success over their winnable starts."""
    places = fold(cells, "ego_speed", "trap_speed", "lanes").items()
    pooled = [(place, pool(own, 0, "winnable")) for place, own in places]
    known = [(place, counts) for place, counts in pooled if counts.episodes]
    known.sort(key=lambda item: item[1].rate("successes"))
    rows = []
    for place, counts in known[:WORST]:
        rates = (f"{figure_of(100.0 * counts.rate(name))} %" for name in OUTCOMES)
        rows.append([*(f"{value:g}" for value in place), str(counts.cells), *rates])
    heads = ["ego, m/s", "trap, m/s", "lanes", "winnable starts", *HEADS]
    return tables.markdown(heads, rows, texts=0)


def _world(sweep: SweepResult[Point]) -> str:
    """What every start had in common, and what the axes were."""
    of, axes = sweep.settings, sweep.axes
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
