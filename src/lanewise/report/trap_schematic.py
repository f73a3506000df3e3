"""The trap at its start, to scale, with D1 and D2 measured and the way out of it."""

from pathlib import Path

import numpy as np

from lanewise.extras import needed_for
from lanewise.report import dimensions, road, style
from lanewise.report.dimensions import number
from lanewise.report.road import Place
from lanewise.report.style import Floats, Look
from lanewise.scenario.settings import TrapSettings

with needed_for("the schematic of the trap"):
    from matplotlib.artist import Artist
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from matplotlib.lines import Line2D
    from matplotlib.patches import FancyArrowPatch
    from matplotlib.path import Path as Curve

MARGIN, ABOVE, BELOW = 0.1, 0.98, 0.4
"""Inches beside, above (legend and dimensions) and below (dimensions) the road."""
TRAFFIC_SHOWN = 2
"""Vehicles of the traffic ahead that are drawn; more would make all of them small."""


def write(settings: TrapSettings, path: Path | str) -> None:
    """Draw the trap's test start into a PNG or SVG file.

    Distances are centre to centre. Traffic stands at its mean places, in lanes that the drawing
    chose: in the scenario they are drawn at random. The way out is a sketch, as seen from the
    moving trap cars.

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
    places = traffic_places(settings)
    trap = settings.test_front_distance, settings.test_side_distance
    start = min(0.0, *places, *trap) - 10.0
    end = max(*places, *trap) + 14.0
    centre, width = lane_arrays(settings)
    figure, axes = road.page(centre, width, (start, end), (MARGIN, ABOVE, BELOW))
    _vehicles(axes, settings, centre, places)
    _dimensions(axes, settings, centre, places)
    handles = _key(settings)
    if settings.lanes > 2:
        handles.append(_way_out(axes, settings, centre))
    figure.legend(handles=handles, loc="upper center", ncols=2, frameon=False)
    return figure


def lane_arrays(settings: TrapSettings) -> tuple[Floats, Floats]:
    """(centre, width) of every lane, m, the far-left first."""
    number_from_left = np.arange(settings.lanes, dtype=np.float64)
    return settings.lane_width * number_from_left, np.full(settings.lanes, settings.lane_width)


def traffic_places(settings: TrapSettings) -> list[float]:
    """Mean places along the road of the traffic drawn, m: ahead, then one vehicle behind."""
    traffic = settings.traffic
    beyond = max(settings.test_front_distance, settings.test_side_distance) + traffic.first_gap
    shown = min(traffic.vehicles_ahead, TRAFFIC_SHOWN)
    ahead = [beyond + place * traffic.spacing for place in range(shown)]
    return ahead + ([-traffic.gap_behind] if traffic.vehicles_behind else [])


def _vehicles(axes: Axes, settings: TrapSettings, centre: Floats, places: list[float]) -> None:
    road.vehicle(axes, Place(0.0, centre[0]), 0, "E")
    road.vehicle(axes, Place(settings.test_front_distance, centre[0]), 1, "1")
    road.vehicle(axes, Place(settings.test_side_distance, centre[1]), 1, "2")
    for place, x in enumerate(places):
        road.vehicle(axes, Place(x, centre[place % len(centre)]), 2)


def _dimensions(axes: Axes, settings: TrapSettings, centre: Floats, places: list[float]) -> None:
    """D1 and the traffic's distances above the road, D2 below it."""
    traffic = settings.traffic
    bottom, top = axes.get_ylim()
    above, below = top - 1.6, bottom + 1.6
    front, side = settings.test_front_distance, settings.test_side_distance
    for x in (0.0, front):
        dimensions.reach(axes, x, centre[0] - 1.0, above)
    dimensions.measure(axes, 0.0, front, above, f"$D_1$ = {number(front)} m")
    for x, y in ((0.0, centre[0]), (side, centre[1])):
        dimensions.reach(axes, x, y + 1.0, below)
    dimensions.measure(axes, 0.0, side, below, f"$D_2$ = {number(side)} m")
    jitter = f" ± {number(traffic.spacing_jitter)}" if traffic.spacing_jitter else ""
    before = max(front, side)
    for place, x in enumerate(places):
        dimensions.reach(axes, x, centre[place % len(centre)] - 1.0, above)
        if x < 0.0:
            mean, before = traffic.gap_behind, 0.0
        else:
            mean = traffic.spacing if place else traffic.first_gap
        dimensions.measure(axes, before, x, above, f"{number(mean)}{jitter} m")
        before = x


def _way_out(axes: Axes, settings: TrapSettings, centre: Floats) -> Line2D:
    """Fall back behind trap car 2, change lane twice, overtake both; the arrow's legend entry."""
    behind = min(0.0, settings.test_side_distance - 8.0)
    past = max(settings.test_front_distance, settings.test_side_distance) + 10.0
    over = behind + 9.0
    corners = [
        (-2.8, centre[0]),
        (behind - 6.0, centre[0]),
        (behind - 4.0, centre[1]),
        (behind + 1.0, (centre[1] + centre[2]) / 2.0),
        (behind + 4.0, centre[2]),
        (over, centre[2]),
        (over + 2.0, centre[2]),
        (past, centre[2]),
    ]
    codes = [Curve.MOVETO, *[Curve.CURVE4] * 6, Curve.LINETO]
    look: Look = {"color": road.GOAL, "linewidth": 1.4, "linestyle": (0, (4, 1.5))}
    axes.add_patch(
        FancyArrowPatch(
            path=Curve(corners, codes), arrowstyle="-|>", mutation_scale=10.0, zorder=2, **look
        )
    )
    words = "way out, seen from the trap: fall back, cross, overtake"
    return Line2D([], [], label=words, **look)


def _key(settings: TrapSettings) -> list[Artist]:
    traffic = settings.traffic
    roles = (0, 1) if not traffic.vehicles_ahead + traffic.vehicles_behind else (0, 1, 2)
    handles = road.key(roles)
    words = [
        f"{road.NAMES[0]}, {number(settings.ego_speed)} m/s at the start",
        f"{road.NAMES[1]}, {number(settings.trap_speed)} m/s throughout",
        f"{road.NAMES[2]}, {traffic.speed:g} m/s at the start, "
        f"{traffic.vehicles_ahead + traffic.vehicles_behind} vehicles",
    ]
    for handle, label in zip(handles, words, strict=False):
        handle.set_label(label)
    return list(handles)
