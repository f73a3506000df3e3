"""One moment of a recording as a picture: the road from above, goal, speed and rewards over it."""

from math import isnan

from lanewise.evaluation.episodes import Recording
from lanewise.report import road_shapes
from lanewise.report.road_shapes import Moment, Point
from lanewise.system.extras import needed_for

with needed_for("drawing a recording"):
    from PIL import Image, ImageDraw, ImageFont

WIDTH, HEIGHT = 960, 240
"""Of a frame, pixels; even, as MP4 wants them."""
VISIBLE_ROAD = 120.0
"""Length of road across the picture, m."""
EGO_PLACE = 0.42
"""Where the ego stands, as a share of the width."""
SUPERSAMPLING = 3
"""Shapes are drawn this much larger and scaled down, for smooth edges."""
PANEL = 0.36
"""Share of the height for the figures above the road."""
COLUMNS = (0.0, 0.15, 0.42, 0.60, 0.79)
"""Where the figures above the road begin, as shares of the width."""

PAPER, INK, FAINT, GREEN, ALARM = "#FFFFFF", "#1C1E21", "#6E7278", "#1A7A40", "#B0141E"
COLOURS = (*road_shapes.COLOURS, PAPER, INK, FAINT, GREEN, ALARM)
"""Every colour a frame holds but for the shades between them."""


class Camera:
    """From metres to pixels: it follows the ego along the road and shows the whole width."""

    def __init__(self, recording: Recording, ego_x: float, enlarged: int = 1) -> None:
        left, right = road_shapes.pavement(recording)
        width, height = WIDTH * enlarged, HEIGHT * enlarged
        self.panel = PANEL * height
        room = height - self.panel
        # 0.8 leaves a strip of grass for the distance marks.
        self.scale = min(width / VISIBLE_ROAD, 0.8 * room / (right - left))
        self.origin = ego_x - EGO_PLACE * width / self.scale
        self.end = self.origin + width / self.scale
        self._middle, self._centre = self.panel + 0.46 * room, (left + right) / 2.0

    def pixel(self, place: Point) -> Point:
        """Pixel of a place on the road, m."""
        x, y = place
        return (x - self.origin) * self.scale, self._middle + (y - self._centre) * self.scale


def frame(recording: Recording, t: float) -> Image.Image:
    """The road around the ego at `t` seconds, with goal, speed and reward above it."""
    now = road_shapes.moment(recording, t)
    camera = Camera(recording, float(now.x[0]), SUPERSAMPLING)
    large = Image.new("RGB", (WIDTH * SUPERSAMPLING, HEIGHT * SUPERSAMPLING), road_shapes.GRASS)
    draw = ImageDraw.Draw(large)
    for shape in road_shapes.shapes(recording, now, camera.origin, camera.end):
        draw.polygon([camera.pixel(corner) for corner in shape.corners], fill=shape.colour)
    draw.rectangle((0, 0, large.width, camera.panel), fill=PAPER)
    picture = large.resize((WIDTH, HEIGHT), Image.Resampling.BOX)
    letters = ImageDraw.Draw(picture)
    _distances(letters, recording, Camera(recording, float(now.x[0])))
    _panel(letters, recording, now)
    return picture


def _distances(draw: ImageDraw.ImageDraw, recording: Recording, camera: Camera) -> None:
    """Metres along the road every 20 m, so that motion shows even on an empty road."""
    font = ImageFont.load_default(size=12)
    edge = road_shapes.pavement(recording)[1]
    for x in range(int(camera.origin // 20) * 20, int(camera.end) + 20, 20):
        column, top = camera.pixel((float(x), edge))
        draw.line((column, top + 2, column, top + 6), fill=FAINT)
        if 24 < column < WIDTH - 24:
            draw.text((column, top + 8), f"{x} m", font=font, fill=FAINT, anchor="ma")


def _panel(draw: ImageDraw.ImageDraw, recording: Recording, now: Moment) -> None:
    """Five figures in a row, under the controller's name and the badge."""
    title, label, figure = map(ImageFont.load_default, (17, 13, 20))
    edge = 16
    draw.text((edge, 8), recording.controller, font=title, fill=INK)
    if badge := _badge(recording, now):
        words, colour = badge
        right = WIDTH - edge
        left = right - round(draw.textlength(words, font=title)) - 14
        draw.rectangle((left, 5, right, 29), fill=colour)
        draw.text((right - 7, 17), words, font=title, fill=PAPER, anchor="rm")
    for place, (name, value) in zip(COLUMNS, _figures(recording, now), strict=True):
        column = edge + round(place * (WIDTH - 2 * edge))
        draw.text((column, 36), name, font=label, fill=FAINT)
        draw.text((column, 53), value, font=figure, fill=INK)


def _figures(recording: Recording, now: Moment) -> list[tuple[str, str]]:
    lane, speed = int(recording.goal_lane[now.index]), float(recording.goal_speed[now.index])
    goal = "-" if lane < 0 else f"lane {lane + 1}/{len(recording.lane_centre)}"
    if not isnan(speed):
        goal += f", {speed:.1f} m/s"
    return [
        ("time", f"{now.time:.1f} s"),
        ("goal", goal),
        ("speed", f"{now.ego_speed:.1f} m/s"),
        ("reward now", f"{recording.reward[now.index]:+.2f}"),
        ("accumulated reward", f"{recording.accumulated_reward[now.index]:.2f}"),
    ]


def _badge(recording: Recording, now: Moment) -> tuple[str, str] | None:
    """What has happened to the ego so far, and the colour to say it in."""
    if recording.accident and now.index == len(recording.time) - 1:
        return recording.ending, ALARM
    return ("escaped", GREEN) if recording.escaped[now.index] else None
