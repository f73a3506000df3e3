"""One moment of a recording as a picture from above."""

from dataclasses import dataclass
from math import cos, isnan, sin

import numpy as np
from numpy.typing import NDArray

from lanewise.evaluation.episodes import ACCIDENTS, Recording
from lanewise.extras import needed_for

with needed_for("drawing a recording"):
    from PIL import Image, ImageDraw, ImageFont

Colour = tuple[int, int, int]
Point = tuple[float, float]

SIZE = (960, 240)
"""Width and height of a frame, pixels."""
VISIBLE_ROAD = 120.0
"""Length of road across the picture, m."""
EGO_PLACE = 0.42
"""Where the ego stands, as a share of the width."""
SUPERSAMPLING = 3
"""Shapes are drawn this much larger and scaled down, for smooth edges."""
PANEL = 0.36
"""Share of the height for the figures above the road."""

PLACES = (0.0, 0.15, 0.42, 0.60, 0.79)
"""Where the figures above the road begin, as shares of the width."""

GRASS: Colour = (226, 230, 222)
ASPHALT: Colour = (92, 96, 101)
TARGET_LANE: Colour = (82, 124, 98)
MARKING: Colour = (240, 240, 236)
CHEVRON: Colour = (176, 216, 188)
PAPER: Colour = (255, 255, 255)
INK: Colour = (28, 30, 33)
FAINT: Colour = (110, 114, 120)
GREEN: Colour = (26, 122, 64)
ALARM: Colour = (176, 20, 30)
BODY: tuple[Colour, ...] = ((214, 40, 40), (245, 197, 24), (58, 128, 205))
"""By role: ego red, trap yellow, traffic blue."""

COLOURS = (GRASS, ASPHALT, TARGET_LANE, MARKING, CHEVRON, PAPER, INK, FAINT, GREEN, ALARM, *BODY)
"""Every colour a frame holds but for the shades between them."""

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


def moment(recording: Recording, t: float) -> Moment:
    """The recording at `t` seconds; before the start or after the end, the nearest frame."""
    time = recording.time
    t = float(np.clip(t, time[0], time[-1]))
    index = max(int(np.searchsorted(time, t + 1e-9, side="right")) - 1, 0)
    following = min(index + 1, len(time) - 1)
    step = time[following] - time[index]
    share = (t - time[index]) / step if step > 0.0 else 0.0

    def between(values: NDArray[np.float64]) -> NDArray[np.float64]:
        mixed: NDArray[np.float64] = (1.0 - share) * values[index] + share * values[following]
        return mixed

    return Moment(
        between(recording.x),
        between(recording.y),
        between(recording.heading),
        float(between(recording.speed)[0]),
        t,
        index,
    )


class View:
    """From metres to pixels: the camera follows the ego along the road and keeps it whole."""

    def __init__(
        self, recording: Recording, ego_x: float, size: tuple[int, int], enlarged: int
    ) -> None:
        left = recording.lane_centre - recording.lane_width / 2.0
        right = recording.lane_centre + recording.lane_width / 2.0
        self.left, self.right = float(left.min()), float(right.max())
        width, height = size[0] * enlarged, size[1] * enlarged
        panel = PANEL * height
        room = height - panel
        paved = self.right - self.left + 2.0 * SHOULDER
        # 0.8 leaves a strip of grass for the distance marks.
        self.scale = min(width / VISIBLE_ROAD, 0.8 * room / paved)
        self.width, self.height, self.panel = width, height, panel
        self.middle = panel + 0.46 * room
        self.centre_y = (self.left + self.right) / 2.0
        self.origin = ego_x - EGO_PLACE * width / self.scale

    def at(self, x: float, y: float) -> Point:
        """Pixel of a place on the road."""
        return (x - self.origin) * self.scale, self.middle + (y - self.centre_y) * self.scale

    @property
    def seen(self) -> tuple[float, float]:
        """First and last visible x, m."""
        return self.origin, self.origin + self.width / self.scale


def frame(recording: Recording, t: float, size: tuple[int, int] = SIZE) -> Image.Image:
    """The road around the ego at `t` seconds, with goal, speed and reward above it.

    Args:
        recording: the episode.
        t: s.
        size: width and height, pixels.
    """
    now = moment(recording, t)
    large = Image.new("RGB", (size[0] * SUPERSAMPLING, size[1] * SUPERSAMPLING), GRASS)
    view = View(recording, float(now.x[0]), size, SUPERSAMPLING)
    draw = ImageDraw.Draw(large)
    _road(draw, view, recording, now)
    _markings(draw, view, recording)
    for number in np.flatnonzero(recording.present)[::-1]:  # the ego last, on top
        _vehicle(draw, view, recording, now, int(number))
    draw.rectangle((0, 0, view.width, view.panel), fill=PAPER)
    picture = large.resize(size, Image.Resampling.BOX)
    letters = ImageDraw.Draw(picture)
    _distances(letters, View(recording, float(now.x[0]), size, 1))
    _panel(letters, recording, now, size)
    return picture


def _road(draw: ImageDraw.ImageDraw, view: View, recording: Recording, now: Moment) -> None:
    start, end = view.seen
    paved = (view.at(start, view.left - SHOULDER), view.at(end, view.right + SHOULDER))
    draw.rectangle(paved, fill=ASPHALT)
    lane = int(recording.goal_lane[now.index])
    if lane < 0:
        return
    centre, half = recording.lane_centre[lane], recording.lane_width[lane] / 2.0
    draw.rectangle((view.at(start, centre - half), view.at(end, centre + half)), fill=TARGET_LANE)
    for step in range(3):  # chevrons ahead of the ego point along the target lane
        tip = float(now.x[0]) + 9.0 + 2.2 * step
        corners = [(tip - 1.2, -1.1), (tip, 0.0), (tip - 1.2, 1.1)]
        points = [view.at(x, centre + y) for x, y in corners]
        draw.line(points, fill=CHEVRON, width=round(0.4 * view.scale), joint="curve")


def _markings(draw: ImageDraw.ImageDraw, view: View, recording: Recording) -> None:
    start, end = view.seen
    half = LINE_WIDTH / 2.0
    for edge in (view.left, view.right):
        draw.rectangle((view.at(start, edge - half), view.at(end, edge + half)), fill=MARKING)
    inner = np.sort(recording.lane_centre + recording.lane_width / 2.0)[:-1]
    first = int(start // DASH_PERIOD)
    for x in np.arange(first, int(end // DASH_PERIOD) + 1) * DASH_PERIOD:
        for y in inner:
            draw.rectangle((view.at(x, y - half), view.at(x + DASH, y + half)), fill=MARKING)


def _vehicle(
    draw: ImageDraw.ImageDraw, view: View, recording: Recording, now: Moment, number: int
) -> None:
    length, width = float(recording.length[number]), float(recording.width[number])
    x, y, heading = float(now.x[number]), float(now.y[number]), float(now.heading[number])

    def outline(back: float, front: float, side: float) -> list[Point]:
        corners = ((back, -side), (front, -side), (front, side), (back, side))
        along, across = cos(heading), sin(heading)
        return [view.at(x + a * along - b * across, y + a * across + b * along) for a, b in corners]

    body = BODY[int(recording.role[number])]
    dark: Colour = (body[0] * 11 // 20, body[1] * 11 // 20, body[2] * 11 // 20)
    side = width / 2.0
    draw.polygon(outline(-length / 2.0, length / 2.0, side), fill=body)
    # Windscreen and rear window tell front from back.
    draw.polygon(outline(0.10 * length, 0.24 * length, 0.76 * side), fill=dark)
    draw.polygon(outline(-0.38 * length, -0.30 * length, 0.70 * side), fill=dark)
    if recording.crashed[now.index, number]:
        rim = outline(-length / 2.0, length / 2.0, side)
        thick = max(round(0.35 * view.scale), 1)
        draw.line([*rim, rim[0], rim[1]], fill=INK, width=thick, joint="curve")
        draw.line([rim[0], rim[2]], fill=INK, width=thick)
        draw.line([rim[1], rim[3]], fill=INK, width=thick)


def _distances(draw: ImageDraw.ImageDraw, view: View) -> None:
    """Metres along the road every 20 m, so that motion shows even on an empty road."""
    start, end = view.seen
    points = round(0.05 * view.height)
    if points < 8:  # not legible, and no room
        return
    font = ImageFont.load_default(size=points)
    top = view.at(0.0, view.right + SHOULDER)[1]
    for x in range(int(start // 20) * 20, int(end) + 20, 20):
        column = view.at(float(x), 0.0)[0]
        draw.line((column, top + 2, column, top + 6), fill=FAINT)
        if 2 * points < column < view.width - 2 * points:
            draw.text((column, top + 8), f"{x} m", font=font, fill=FAINT, anchor="ma")


def _panel(
    draw: ImageDraw.ImageDraw, recording: Recording, now: Moment, size: tuple[int, int]
) -> None:
    """Five figures in a row, under the controller's name and the badge."""
    unit = min(size[0] / SIZE[0], size[1] / SIZE[1])
    title, label, figure = (ImageFont.load_default(size=round(s * unit)) for s in (17, 13, 20))
    edge = round(16 * unit)
    rows = (round(8 * unit), round(36 * unit), round(53 * unit))
    draw.text((edge, rows[0]), recording.controller, font=title, fill=INK)
    _badge(draw, recording, now, (size[0] - edge, rows[0]), title)
    for place, (name, value) in zip(PLACES, _figures(recording, now), strict=True):
        column = edge + round(place * (size[0] - 2 * edge))
        draw.text((column, rows[1]), name, font=label, fill=FAINT)
        draw.text((column, rows[2]), value, font=figure, fill=INK)


def _figures(recording: Recording, now: Moment) -> list[tuple[str, str]]:
    lane, speed = int(recording.goal_lane[now.index]), float(recording.goal_speed[now.index])
    lanes = len(recording.lane_centre)
    goal = "-" if lane < 0 else f"lane {lane + 1}/{lanes}"
    if not isnan(speed):
        goal += f", {speed:.1f} m/s"
    return [
        ("time", f"{now.time:.1f} s"),
        ("goal", goal),
        ("speed", f"{now.ego_speed:.1f} m/s"),
        ("reward now", f"{recording.reward[now.index]:+.2f}"),
        ("accumulated reward", f"{recording.accumulated_reward[now.index]:.2f}"),
    ]


def _badge(
    draw: ImageDraw.ImageDraw,
    recording: Recording,
    now: Moment,
    corner: tuple[int, int],
    font: ImageFont.FreeTypeFont | ImageFont.ImageFont,
) -> None:
    """What has happened so far, in the upper right corner."""
    if recording.accident and now.index == len(recording.time) - 1:
        words, colour = ACCIDENTS[recording.accident].replace("_", " "), ALARM
    elif recording.escaped[now.index]:
        words, colour = "escaped", GREEN
    else:
        return
    letters = round(draw.textlength(words, font=font))
    right, top = corner
    side = round(0.03 * draw.im.size[1])
    draw.rectangle(
        (right - letters - 2 * side, top - side // 2, right, top + 3 * side), fill=colour
    )
    place = (right - side, top - side // 2 + 7 * side // 4)
    draw.text(place, words, font=font, fill=PAPER, anchor="rm")
