"""The map of a sweep: success and accidents over two axes of a grid, in panels for a third.

A field counts winnable starts; a corner is hatched where some cannot be won, all where none can.
"""

from collections.abc import Sequence
from typing import NamedTuple

from lanewise.evaluation.cells import Cell, fold, pool
from lanewise.evaluation.grid import Point
from lanewise.report import figure_style as style
from lanewise.report.figure_style import (
    Axes,
    Figure,
    Look,
    Normalize,
    Patch,
    Polygon,
    ScalarMappable,
)
from lanewise.report.sweep_result import figure_of

LABELS = {
    "ego_speed": ("ego speed, m/s", "ego"),
    "trap_speed": ("trap speed, m/s", "trap"),
    "lanes": ("lanes", "lanes"),
    "front_distance": ("D1, m", "D1"),
    "side_distance": ("D2, m", "D2"),
    "spacing": ("traffic spacing, m", "spacing"),
    "vehicles_behind": ("vehicles behind", "behind"),
}
"""An axis' label with its unit, and its short name."""

# cividis looks the same to every kind of colour vision and rises evenly in grey. Bright is good in
# both rows, so accidents run the other way.
ROWS = (
    ("success, % of winnable", "successes", "cividis"),
    ("accidents, % of winnable", "accidents", "cividis_r"),
)
"""Label, outcome and colours of the rows of panels."""
UNWINNABLE = "0.85"
"""Grey of a field in which no start can be won."""
HATCH = "////"
CORNER = 0.45
"""Size of the hatched corner of a field in which some starts cannot be won."""


class MapAxes(NamedTuple):
    """Which axes of a grid a map shows: along its own two, and one column of panels a value."""

    x: str = "ego_speed"
    y: str = "trap_speed"
    panel: str = "lanes"


@style.look()
def draw(cells: Sequence[Cell[Point]], view: MapAxes) -> Figure:
    """The map of a whole grid's cells."""
    values = {axis: sorted({getattr(c.place, axis) for c in cells}) for axis in LABELS}
    columns = values[view.panel]
    across, down = values[view.x], values[view.y]
    width = 1.6 + len(columns) * (0.5 + 0.5 * len(across))
    height = 1.3 + 2 * (0.6 + 0.42 * len(down))
    figure = Figure(figsize=(width, height), layout="constrained")
    panels = figure.subplots(2, len(columns), sharex=True, sharey=True, squeeze=False)
    for row, (label, outcome, colours) in enumerate(ROWS):
        scale = ScalarMappable(Normalize(0.0, 100.0), style.colormaps[colours])
        for column, value in enumerate(columns):
            axes = panels[row, column]
            own = [cell for cell in cells if getattr(cell.place, view.panel) == value]
            for (x, y), field in fold(own, view.x, view.y).items():
                _field(axes, (across.index(x), down.index(y)), field, (outcome, scale))
            axes.set(xlim=(-0.5, len(across) - 0.5), ylim=(-0.5, len(down) - 0.5))
            axes.set_xticks(range(len(across)), [f"{value:g}" for value in across])
            axes.set_yticks(range(len(down)), [f"{value:g}" for value in down])
            axes.tick_params(length=0.0)
            if row == 0:
                axes.set_title(f"{value:g} {LABELS[view.panel][1]}", fontsize="medium")
        panels[row, 0].set_ylabel(LABELS[view.y][0])
        figure.colorbar(scale, ax=list(panels[row]), label=label, aspect=14, pad=0.02)
    for axes in panels[1]:
        axes.set_xlabel(LABELS[view.x][0])
    key = _key(cells, view)
    if key:
        figure.legend(handles=key, loc="outside lower center", ncols=2, frameon=False)
    return figure


def _key(cells: Sequence[Cell[Point]], view: MapAxes) -> list[Patch]:
    """What hatching means, as far as it occurs."""
    fields = fold(cells, view.panel, view.x, view.y).values()
    won = [(pool(own, 0, "winnable").cells, len(own)) for own in fields]
    some, none = any(0 < part < whole for part, whole in won), any(part == 0 for part, _ in won)
    look: Look = {"edgecolor": "0.3", "hatch": HATCH}
    partly = Patch(facecolor="white", label="some cannot be won (winnable/all)", **look)
    not_at_all = Patch(facecolor=UNWINNABLE, label="none can be won", **look)
    return [partly] * some + [not_at_all] * none


def _field(
    axes: Axes,
    place: tuple[int, int],
    cells: Sequence[Cell[Point]],
    shown: tuple[str, ScalarMappable],
) -> None:
    outcome, scale = shown
    counts = pool(cells, 0, "winnable")
    lost = len(cells) - counts.cells
    percent = 100.0 * counts.rate(outcome) if counts.cells else 0.0
    x, y = place
    colour = scale.cmap(percent / 100.0) if counts.cells else UNWINNABLE
    box, ink = style.field(axes, x, y, y, colour)
    if lost:
        # All of a lost field is hatched, of others a corner that leaves room for their numbers.
        size, right, top = CORNER if counts.cells else 2.0, x + 0.5, y + 0.5
        corners = [(right, top), (right - size, top), (right, top - size)]
        corner = Polygon(corners, fill=False, edgecolor=ink, linewidth=0.0, hatch=HATCH)
        axes.add_patch(corner)
        corner.set_clip_path(box)
    if counts.cells:
        axes.text(x, y, figure_of(percent), color=ink, ha="center", va="center", fontsize=8.0)
    if lost and counts.cells:
        won = f"{counts.cells}/{len(cells)}"
        axes.text(x, y - 0.3, won, color=ink, ha="center", va="center", fontsize=6.0)
