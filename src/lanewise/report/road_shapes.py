"""The road from above as coloured polygons: one drawing for clips, environments and figures."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from math import cos, hypot, sin
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lanewise.evaluation.episodes import Recording

Point = tuple[float, float]

GRASS, ASPHALT, MARKING = "#E2E6DE", "#5C6065", "#F0F0EC"
GOAL_LANE, CHEVRON = "#527C62", "#B0D8BC"
CRASH = "#1C1E21"
BODIES = ("#D62828", "#F5C518", "#3A80CD")
"""By role: ego red, trap yellow, traffic blue."""
WINDOWS = ("#751616", "#866C0D", "#1F4670")
"""Of the bodies above."""
COLOURS = (GRASS, ASPHALT, GOAL_LANE, MARKING, CHEVRON, *BODIES)
"""The largest areas."""

DASH, DASH_PERIOD, LINE_WIDTH = 3.0, 9.0, 0.18
"""Lane markings, m."""
SHOULDER = 1.2
"""Paved width outside the outer lanes, m."""


@dataclass(frozen=True)
class Moment:
    """A recording at one time: places between two decisions, facts as of the last decision."""

    x: NDArray[np.float64]
    y: NDArray[np.float64]
    heading: NDArray[np.float64]
    ego_speed: float
    time: float
    index: int
    """Frame of the last decision's end."""


class Shape(NamedTuple):
    """A filled polygon."""

    corners: Sequence[Point]
    """Along the road and across it, m; y is positive to the right."""
    colour: str


def moment(recording: Recording, t: float) -> Moment:
    """The recording at `t` seconds; before the start or after the end, the nearest frame."""
    time = recording.time
    t = float(np.clip(t, time[0], time[-1]))
    index = max(int(np.searchsorted(time, t + 1e-9, side="right")) - 1, 0)
    following = min(index + 1, len(time) - 1)
    step = time[following] - time[index]
    share = (t - time[index]) / step if step > 0.0 else 0.0

    x, y, heading, speed = (
        (1.0 - share) * values[index] + share * values[following]
        for values in (recording.x, recording.y, recording.heading, recording.speed)
    )
    return Moment(x, y, heading, float(speed[0]), t, index)


def edges(recording: Recording) -> tuple[float, float]:
    """Left and right edge of the outer lanes, m."""
    half = recording.lane_width / 2.0
    left, right = recording.lane_centre - half, recording.lane_centre + half
    return float(left.min()), float(right.max())


def pavement(recording: Recording) -> tuple[float, float]:
    """Left and right end of the pavement, m."""
    left, right = edges(recording)
    return left - SHOULDER, right + SHOULDER


def shapes(recording: Recording, now: Moment, start: float, end: float) -> Iterator[Shape]:
    """The road from x = `start` to `end`, m, and a little beyond; later shapes above earlier."""
    left, right = edges(recording)
    yield _box(start, end, *pavement(recording), ASPHALT)
    lane = int(recording.goal_lane[now.index])
    if lane >= 0:
        centre, half = recording.lane_centre[lane], recording.lane_width[lane] / 2.0
        yield _box(start, end, centre - half, centre + half, GOAL_LANE)
        for step in range(3):  # chevrons ahead of the ego
            tip = (float(now.x[0]) + 9.0 + 2.2 * step, float(centre))
            for side in (-1.1, 1.1):
                yield _bar(tip, (tip[0] - 1.2, tip[1] + side), 0.4, CHEVRON)
    for edge in (left, right):
        yield _box(start, end, edge - LINE_WIDTH / 2.0, edge + LINE_WIDTH / 2.0, MARKING)
    first = np.floor(start / DASH_PERIOD)
    for y in np.sort(recording.lane_centre + recording.lane_width / 2.0)[:-1]:
        for x in np.arange(first, np.ceil(end / DASH_PERIOD)) * DASH_PERIOD:
            yield _box(x, x + DASH, y - LINE_WIDTH / 2.0, y + LINE_WIDTH / 2.0, MARKING)
    for number in np.flatnonzero(recording.present)[::-1]:  # the ego last, on top
        yield from _vehicle(recording, now, int(number))


def _vehicle(recording: Recording, now: Moment, number: int) -> Iterator[Shape]:
    length, width = float(recording.length[number]), float(recording.width[number])
    x, y, heading = float(now.x[number]), float(now.y[number]), float(now.heading[number])
    along, across = cos(heading), sin(heading)

    def outline(back: float, front: float, share: float) -> list[Point]:
        side = share * width / 2.0
        corners = ((back, -side), (front, -side), (front, side), (back, side))
        placed = ((a * length, b) for a, b in corners)
        return [(x + a * along - b * across, y + a * across + b * along) for a, b in placed]

    role = int(recording.role[number])
    body = outline(-0.5, 0.5, 1.0)
    yield Shape(body, BODIES[role])
    # Windscreen and rear window tell front from back.
    yield Shape(outline(0.10, 0.24, 0.76), WINDOWS[role])
    yield Shape(outline(-0.38, -0.30, 0.70), WINDOWS[role])
    if recording.crashed[now.index, number]:
        for one, other in ((0, 1), (1, 2), (2, 3), (3, 0), (0, 2), (1, 3)):
            yield _bar(body[one], body[other], 0.35, CRASH)


def _box(start: float, end: float, left: float, right: float, colour: str) -> Shape:
    return Shape(((start, left), (end, left), (end, right), (start, right)), colour)


def _bar(start: Point, end: Point, width: float, colour: str) -> Shape:
    """A line as a polygon, with square ends that reach beyond both points."""
    half = width / 2.0 / max(hypot(end[0] - start[0], end[1] - start[1]), 1e-9)
    a, b = half * (end[0] - start[0]), half * (end[1] - start[1])
    corners = (
        (start[0] - a + b, start[1] - b - a),
        (end[0] + a + b, end[1] + b - a),
        (end[0] + a - b, end[1] + b + a),
        (start[0] - a - b, start[1] - b + a),
    )
    return Shape(corners, colour)
