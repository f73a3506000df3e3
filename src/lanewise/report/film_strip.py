"""The paper's film strip: controllers side by side from above, at the same moments."""

from collections.abc import Mapping, Sequence
from itertools import count
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from lanewise.errors import LanewiseError
from lanewise.evaluation.episodes import ACCIDENTS, Recording
from lanewise.extras import needed_for
from lanewise.report import road, style
from lanewise.report.road import Place
from lanewise.report.scene import Moment, moment
from lanewise.report.style import Look

with needed_for("the film strip"):
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

TIMES = (1.0, 2.0, 3.0, 4.0, 9.0, 18.0)
"""The paper's moments, s."""
SEEN = (-30.0, 52.0)
"""Stretch of road in a frame, m from the ego's centre."""
MOST = 2
"""More columns would leave no room for the words below the frames."""
LEFT, GAP, TOP, BOTTOM = 0.7, 0.22, 0.56, 0.42
"""Margins of the figure and the gap between columns, inches."""
CAPTION = 0.27
"""Room below a frame for its figures, inches."""


def write(
    columns: Mapping[str, Recording], path: Path | str, *, times: Sequence[float] = TIMES
) -> None:
    """Draw moments of one episode a controller into a PNG or SVG file.

    Under each frame stand the instant reward r_t of the decision that ended at t, the accumulated
    reward R_t (one reward a second so far) and the speed; right of them, what has become of the
    ego. The view follows the ego. After its end an episode stands still, and has no r_t.

    Args:
        columns: by title, left to right, at most two.
        path: ending in .png or .svg.
        times: s, top to bottom.

    Raises:
        LanewiseError: if there is no recording or no moment, too many recordings, or the file
            cannot be written.
    """
    style.write(path, lambda: draw(columns, times=times))


@style.look()
def draw(columns: Mapping[str, Recording], *, times: Sequence[float] = TIMES) -> Figure:
    """The figure of `write`."""
    if not columns or not times:
        raise LanewiseError("a film strip needs a recording and a moment")
    if len(columns) > MOST:
        raise LanewiseError(f"a film strip holds {MOST} recordings, not {len(columns)}")
    frame_width = (style.WIDTH - LEFT - 0.1 - GAP * (len(columns) - 1)) / len(columns)
    metres = max(_paved(recording) for recording in columns.values())
    frame_height = frame_width * metres / (SEEN[1] - SEEN[0])
    height = TOP + len(times) * (frame_height + CAPTION) + BOTTOM
    figure = Figure(figsize=(style.WIDTH, height))
    for column, (title, recording) in enumerate(columns.items()):
        for row, t in enumerate(times):
            left = LEFT + column * (frame_width + GAP)
            top = height - TOP - row * (frame_height + CAPTION)
            box = (left, top - frame_height, frame_width, frame_height)
            axes = figure.add_axes(_shares(box, height), label=f"{title}, {t:g} s")
            _frame(axes, recording, moment(recording, t))
            _caption(axes, recording, t)
            if row == 0:
                axes.set_title(style.plain(title), fontweight="bold", fontsize="medium", pad=4.0)
            if column == 0:
                axes.set_ylabel(f"$t$ = {t:g} s", rotation=0, ha="right", va="center")
            _scale(axes, last=row == len(times) - 1)
    with_goals = any((recording.goal_lane >= 0).any() for recording in columns.values())
    shown = sorted({role for recording in columns.values() for role in _seen(recording, times)})
    traps = max(int(_traps(recording).sum()) for recording in columns.values())
    handles = [*road.key(shown, traps), *([road.goal_key()] if with_goals else [])]
    figure.legend(handles=handles, loc="upper center", ncols=len(handles), frameon=False)
    return figure


def _shares(box: tuple[float, ...], height: float) -> tuple[float, float, float, float]:
    """A box in inches as shares of the figure."""
    left, bottom, wide, high = box
    return left / style.WIDTH, bottom / height, wide / style.WIDTH, high / height


def _paved(recording: Recording) -> float:
    left = (recording.lane_centre - recording.lane_width / 2.0).min()
    right = (recording.lane_centre + recording.lane_width / 2.0).max()
    return float(right - left) + 2.0 * road.SHOULDER


def _frame(axes: Axes, recording: Recording, now: Moment) -> None:
    ego = float(now.x[0])
    seen = (ego + SEEN[0], ego + SEEN[1])
    road.lanes(axes, recording.lane_centre, recording.lane_width, seen)
    lane = int(recording.goal_lane[now.index])
    if lane >= 0:
        road.goal_lane(axes, float(recording.lane_centre[lane]), float(recording.lane_width[lane]))
    traps = count(1)
    for number in np.flatnonzero(recording.present):
        place = Place(
            float(now.x[number]),
            float(now.y[number]),
            float(now.heading[number]),
            float(recording.length[number]),
            float(recording.width[number]),
        )
        role = int(recording.role[number])
        letter = "E" if role == 0 else str(next(traps)) if role == 1 else ""
        if seen[0] - place.length < place.x < seen[1] + place.length:
            inside = seen[0] + 1.5 < place.x < seen[1] - 1.5
            road.vehicle(axes, place, role, letter if inside else "")
            if recording.crashed[now.index, number]:
                road.crash(axes, place)


def _seen(recording: Recording, times: Sequence[float]) -> set[int]:
    """Roles in view at any of the times."""
    roles: set[int] = set()
    for t in times:
        x = moment(recording, t).x
        within = (x > x[0] + SEEN[0]) & (x < x[0] + SEEN[1]) & recording.present
        roles |= {int(role) for role in recording.role[within]}
    return roles


def _caption(axes: Axes, recording: Recording, t: float) -> None:
    now = moment(recording, t)
    over = t > recording.time[-1] + 1e-9
    instant = "-" if over or now.index == 0 else f"{recording.reward[now.index]:+.2f}"
    words = f"$r_t$ = {instant}   $R_t$ = {recording.accumulated_reward[now.index]:.2f}"
    words += f"   {now.ego_speed:.1f} m/s"
    below: Look = {"xycoords": "axes fraction", "textcoords": "offset points", "va": "top"}
    axes.annotate(words, (0.0, 0.0), (0.0, -2.0), ha="left", fontsize="small", **below)
    axes.annotate(
        _fate(recording, now, over),
        (1.0, 0.0),
        (0.0, -2.0),
        ha="right",
        fontsize="small",
        fontweight="bold",
        **below,
    )


def _fate(recording: Recording, now: Moment, over: bool) -> str:
    """What has become of the ego by then."""
    end = f"at {recording.time[-1]:.1f} s"
    if now.index == len(recording.time) - 1 and recording.accident:
        return f"{ACCIDENTS[recording.accident].replace('_', ' ')} {end}"
    if over:
        return f"ended {end}"
    if not recording.escaped[now.index]:
        return ""
    traps = _traps(recording)
    if not traps.any():
        return "succeeded"
    fronts = now.x[traps] + recording.length[traps] / 2.0
    gap = now.x[0] - recording.length[0] / 2.0 - fronts.max()
    return f"{gap:.0f} m past the trap" if gap > 0.0 else "passed again"


def _traps(recording: Recording) -> NDArray[np.bool_]:
    """Which vehicles are trap cars, [N]."""
    traps: NDArray[np.bool_] = (recording.role == 1) & recording.present
    return traps


def _scale(axes: Axes, *, last: bool) -> None:
    """Metres from the ego, below the last frame of a column and its caption."""
    ego = axes.get_xlim()[0] - SEEN[0]
    metres = np.arange(-20.0, SEEN[1], 20.0)
    axes.set_xticks(ego + metres if last else [])
    if last:
        spine = axes.spines["bottom"]
        spine.set_visible(True)
        spine.set_position(("outward", 72.0 * CAPTION - 3.0))
        axes.set_xticklabels([f"{metre:g}" for metre in metres])
        axes.tick_params(axis="x", length=3.0, labelsize="small")
        axes.set_xlabel("distance from the ego, m", labelpad=1.0)
