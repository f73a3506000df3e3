"""A straight road from above in a matplotlib figure: lanes, and vehicles told apart by role."""

from collections.abc import Sequence
from math import cos, sin
from typing import NamedTuple

import numpy as np

from lanewise.extras import needed_for
from lanewise.report.style import WIDTH, Floats, Look
from lanewise.world.settings import CAR_LENGTH, CAR_WIDTH

with needed_for("a picture of the road"):
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch, Polygon, Rectangle

SHOULDER = 1.0
"""Paved width outside the outer lanes, m."""
DASH, DASH_PERIOD = 3.0, 9.0
"""Lane markings, m."""
ASPHALT, MARKING, EDGE = "0.93", "0.55", "0.25"
GOAL = "#00664B"
"""Colour of the chevrons that point along the goal's lane."""
TINT = "#CBE3D8"
"""Colour of the goal's lane."""

# Red, yellow and blue of clearly different lightness, with letters on two of them.
BODIES = ("#B3202A", "#F2C230", "#5B9BD5")
"""Colours by role: ego, trap, traffic."""
INKS = ("white", "black", "black")
NAMES = ("ego (E)", "trap cars (1, 2)", "traffic")
"""In a legend, by role, of the paper's two trap cars."""


class Place(NamedTuple):
    """Where a vehicle is, and how large."""

    x: float
    """m."""
    y: float
    """m, positive to the right."""
    heading: float = 0.0
    """rad, positive to the right."""
    length: float = CAR_LENGTH
    """m."""
    width: float = CAR_WIDTH
    """m."""


def page(
    centre: Floats, width: Floats, seen: tuple[float, float], room: tuple[float, float, float]
) -> tuple[Figure, Axes]:
    """A figure as wide as a page with a paved road in it, to scale.

    Args:
        centre: [M] lane centres, m.
        width: [M] lane widths, m.
        seen: where the road begins and ends, m.
        room: inches beside, above and below the road.

    Returns:
        The figure, and the road's axes in m.
    """
    beside, above, below = room
    paved = float(width.sum()) + 2.0 * SHOULDER
    tall = (WIDTH - 2.0 * beside) * paved / (seen[1] - seen[0])
    height = above + tall + below
    figure = Figure(figsize=(WIDTH, height))
    axes = figure.add_axes(
        (beside / WIDTH, below / height, 1.0 - 2.0 * beside / WIDTH, tall / height)
    )
    axes.set_xticks([])
    lanes(axes, centre, width, seen)
    return figure, axes


def lanes(axes: Axes, centre: Floats, width: Floats, seen: tuple[float, float]) -> None:
    """Pave an axes from `seen[0]` to `seen[1]` m; the left of the road is up, scales are equal."""
    left = float((centre - width / 2.0).min())
    right = float((centre + width / 2.0).max())
    start, end = seen
    axes.set_xlim(start, end)
    axes.set_ylim(right + SHOULDER, left - SHOULDER)
    axes.set_aspect("equal")
    axes.set_yticks([])
    axes.spines[:].set_visible(False)
    paved = right - left + 2.0 * SHOULDER
    axes.add_patch(
        Rectangle((start, left - SHOULDER), end - start, paved, facecolor=ASPHALT, linewidth=0.0)
    )
    for edge in (left, right):
        axes.plot(seen, (edge, edge), color=EDGE, linewidth=0.9, solid_capstyle="butt")
    first = np.floor(start / DASH_PERIOD) * DASH_PERIOD
    for y in np.sort(centre + width / 2.0)[:-1]:
        for x in np.arange(first, end, DASH_PERIOD):
            dash = (max(float(x), start), min(float(x) + DASH, end))
            if dash[0] < dash[1]:
                axes.plot(dash, (y, y), color=MARKING, linewidth=0.9, solid_capstyle="butt")


def vehicle(axes: Axes, place: Place, role: int, letter: str = "", *, ghost: bool = False) -> None:
    """A vehicle with its windscreen in front; a ghost is only an outline."""
    body, screen = _outline(place, -0.5, 0.5, 0.5), _outline(place, 0.12, 0.26, 0.38)
    if ghost:
        axes.add_patch(
            Polygon(body, facecolor="none", edgecolor="0.35", linestyle=(0, (3, 2)), linewidth=0.9)
        )
        return
    axes.add_patch(
        Polygon(body, facecolor=BODIES[role], edgecolor="black", linewidth=0.7, zorder=3)
    )
    axes.add_patch(Polygon(screen, facecolor="0.15", linewidth=0.0, zorder=3))
    if letter:
        middle = _outline(place, -0.17, -0.17, 0.0)[0]
        axes.text(
            *middle,
            letter,
            color=INKS[role],
            fontsize=letter_size(axes, place.width),
            fontweight="bold",
            ha="center",
            va="center_baseline",
            zorder=4,
        )


def crash(axes: Axes, place: Place) -> None:
    """Cross a vehicle out."""
    body = _outline(place, -0.5, 0.5, 0.5)
    for one, other in ((0, 2), (1, 3)):
        ends = np.array([body[one], body[other]])
        axes.plot(ends[:, 0], ends[:, 1], color="black", linewidth=1.6, zorder=5)


def goal_lane(axes: Axes, centre: float, width: float) -> None:
    """Tint a lane, with three chevrons at its far end, where vehicles seldom hide them."""
    start, end = axes.get_xlim()
    axes.add_patch(
        Rectangle((start, centre - width / 2.0), end - start, width, facecolor=TINT, linewidth=0.0)
    )
    side = 0.28 * width
    for tip in (end - 5.8, end - 3.6, end - 1.4):
        ends = (tip - 1.2, tip, tip - 1.2), (centre - side, centre, centre + side)
        axes.plot(*ends, color=GOAL, linewidth=1.3)


def letter_size(axes: Axes, height: float) -> float:
    """Font size, points, of a capital that fills two thirds of `height` m, but no giant."""
    box = axes.get_position()
    low, high = axes.get_ylim()
    inches = axes.get_figure(root=True).get_figheight() * box.height  # type: ignore[union-attr]
    # A capital of DejaVu Sans is 0.73 of the font size tall.
    return min(72.0 * inches * height / abs(high - low) * 0.66 / 0.73, 15.0)


def key(roles: Sequence[int], traps: int = 2) -> list[Patch]:
    """Legend entries of roles.

    Args:
        roles: which.
        traps: number of trap cars.
    """
    several = {1: "trap car (1)", 2: NAMES[1]}.get(traps, f"trap cars (1 to {traps})")
    names = (NAMES[0], several, NAMES[2])
    return [
        Patch(facecolor=BODIES[role], edgecolor="black", linewidth=0.7, label=names[role])
        for role in roles
    ]


def goal_key() -> Line2D:
    """Legend entry of the chevrons."""
    more: Look = {"linestyle": "", "markersize": 14.0, "markeredgewidth": 0.4}
    return Line2D([], [], color=GOAL, marker="$>>>$", label="lane of the goal", **more)


def _outline(place: Place, back: float, front: float, side: float) -> list[tuple[float, float]]:
    """Corners of a part of a vehicle; shares of its length and width from its centre."""
    along, across = cos(place.heading), sin(place.heading)
    corners = ((back, -side), (front, -side), (front, side), (back, side))
    return [
        (
            place.x + a * place.length * along - b * place.width * across,
            place.y + a * place.length * across + b * place.width * along,
        )
        for a, b in corners
    ]
