"""Where the trap cars start: D1 and D2 in training, drawn from ranges, and in tests, fixed."""

from pathlib import Path

from lanewise.extras import needed_for
from lanewise.report import dimensions, road, style
from lanewise.report.dimensions import number
from lanewise.report.road import Place
from lanewise.report.style import Look
from lanewise.report.trap_schematic import lane_arrays
from lanewise.scenario.settings import TrapSettings

with needed_for("the schematic of the starts"):
    from matplotlib.artist import Artist
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

MARGIN, ABOVE, BELOW = 0.1, 1.08, 0.68
"""Inches beside, above and below the road."""
LANES = 2
"""The trap's; the others look the same."""


def write(settings: TrapSettings, path: Path | str) -> None:
    """Draw the ranges of D1 and D2 on the road into a PNG or SVG file.

    To scale: solid trap cars at the test start, dashed outlines at the ends of the training
    ranges, which are uniform; all distances from the ego's centre to theirs.

    Args:
        settings: of the trap; every number in the figure is theirs.
        path: ending in .png or .svg.

    Raises:
        LanewiseError: if the file cannot be written.
    """
    style.write(path, lambda: draw(settings))


@style.look()
def draw(settings: TrapSettings) -> Figure:
    """The figure of `write`."""
    ends = (
        *settings.training_front_distance,
        *settings.training_side_distance,
        settings.test_front_distance,
        settings.test_side_distance,
    )
    start, end = min(0.0, *ends) - 4.5, max(*ends) + 4.5
    centre, width = (values[:LANES] for values in lane_arrays(settings))
    figure, axes = road.page(centre, width, (start, end), (MARGIN, ABOVE, BELOW))
    metre = (style.WIDTH - 2.0 * MARGIN) / (end - start)
    road.vehicle(axes, Place(0.0, centre[0]), 0, "E")
    for car, test, spread in (
        (1, settings.test_front_distance, settings.training_front_distance),
        (2, settings.test_side_distance, settings.training_side_distance),
    ):
        _trap_car(axes, (car, centre[car - 1]), test, spread, 1.0 / metre)
    figure.legend(handles=_key(), loc="upper center", ncols=4, frameon=False)
    return figure


def _trap_car(
    axes: Axes, which: tuple[int, float], test: float, spread: tuple[float, float], inch: float
) -> None:
    """One trap car with its dimension line and its range, above the road or below it."""
    car, lane = which
    for x in spread:
        road.vehicle(axes, Place(x, lane), 1, ghost=True)
    road.vehicle(axes, Place(test, lane), 1, str(car))
    bottom, top = axes.get_ylim()
    away = -inch if car == 1 else inch
    edge = top if car == 1 else bottom
    single, ranged = edge + 0.14 * away, edge + 0.52 * away
    side = -1.0 if car == 1 else 1.0
    for x, y in ((0.0, 0.0), (test, lane)):
        dimensions.reach(axes, x, y + side, single)
    dimensions.measure(axes, 0.0, test, single, f"$D_{car}$ = {number(test)} m in tests")
    for x in spread:
        dimensions.reach(axes, x, lane + side, ranged)
    dimensions.spread(axes, *spread, ranged, 0.1 * inch)
    words = f"$D_{car}$ in training: {number(spread[0])} to {number(spread[1])} m"
    gap = 0.1 * inch
    # Towards the side with more room.
    if (spread[0] + spread[1]) / 2.0 > sum(axes.get_xlim()) / 2.0:
        axes.text(spread[0] - gap, ranged, words, ha="right", va="center")
    else:
        axes.text(spread[1] + gap, ranged, words, ha="left", va="center")


def _key() -> list[Artist]:
    outline: Look = {"edgecolor": "0.35", "linestyle": (0, (3, 2)), "linewidth": 0.9}
    return [
        *road.key((0, 1)),
        Patch(facecolor="none", label="ends of the training range", **outline),
        Line2D([], [], color="0.75", linewidth=5.0, label="range, uniform"),
    ]
