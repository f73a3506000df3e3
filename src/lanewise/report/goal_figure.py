"""The goals of an episode: which lane and speed were asked for, and what the ego made of them."""

import numpy as np
from numpy.typing import NDArray

from lanewise.errors import LanewiseError
from lanewise.evaluation.episodes import Recording
from lanewise.report import figure_style as style
from lanewise.report import road_shapes
from lanewise.report.figure_style import STYLES, Axes, Figure, Floats, Line2D, Look

EGO, GOAL = STYLES[0], STYLES[1]
OUT: Look = {"color": style.MUTED, "linewidth": 1.0, "linestyle": (0, (1, 2))}
WRECK: Look = {"marker": "X", "markersize": 9.0, "color": "black", "ls": "", "clip_on": False}
MARKERS: dict[str, Look] = {
    "set": {"marker": "|", "markersize": 9.0, "markeredgewidth": 1.3, "color": GOAL.colour},
    "reached": {"marker": "o", "markersize": 6.0, "markerfacecolor": "white", "color": "#00664B"},
    "timed out": {"marker": "x", "markersize": 6.5, "markeredgewidth": 1.7, "color": "#D55E00"},
}
"""By what became of a goal: set, on the goal's line; reached or timed out, on the ego's."""

Events = dict[str, NDArray[np.int64]]
"""By what became of goals, the frames at whose end it did."""


@style.look()
def draw(recording: Recording) -> Figure:
    """An episode's goals: above, lane and place across the road; below, speed; each with the ego's.

    A bar marks where a goal was set, a circle where one was reached, a cross where the time limit
    ended one.

    Raises:
        LanewiseError: if the controller has no goals.
    """
    if (recording.goal_lane < 0).all():
        raise LanewiseError(f"{recording.controller} sets no goals; there is nothing to draw")
    found = _events(recording)
    figure = Figure(figsize=(style.WIDTH, 4.6), layout="constrained")
    across, speed = style.panels(figure, 2)
    _lanes(across, recording)
    lateral = recording.lane_centre[recording.goal_lane]
    _track(across, recording, lateral, recording.y[:, 0], found)
    _track(speed, recording, recording.goal_speed, recording.speed[:, 0], found)
    speed.margins(y=0.1)
    across.set_ylabel("across the road, m")
    speed.set_ylabel("speed, m/s")
    speed.set_xlabel("time, s")
    style.legend(figure, _key(recording, found), most=4)
    return figure


def _events(recording: Recording) -> Events:
    """The frames before those in which the recording's counts and goal have changed.

    A goal set again unchanged, while the one before had not ended, leaves no trace.
    """
    ended, timed_out = np.diff(recording.goals_ended), np.diff(recording.goals_timed_out)
    moved = (np.diff(recording.goal_lane) != 0) | (np.diff(recording.goal_speed) != 0.0)
    fresh = moved | (ended > 0)
    fresh[0] = True
    found = {"set": fresh, "reached": ended > timed_out, "timed out": timed_out > 0}
    return {name: np.flatnonzero(frames) for name, frames in found.items()}


def _lanes(axes: Axes, recording: Recording) -> None:
    """Lanes as in a picture from above: the left one on top."""
    centre, half = recording.lane_centre, recording.lane_width / 2.0
    outer = road_shapes.edges(recording)
    axes.set_ylim(outer[1] + 0.3, outer[0] - 0.3)
    axes.set_yticks(centre)
    axes.grid(visible=False, axis="y")
    for edge in np.unique(np.concatenate([centre - half, centre + half])):
        dashes = (0, ()) if edge in outer else (0, (6, 5))
        axes.axhline(edge, color="0.6", linewidth=0.9, linestyle=dashes, zorder=1)
    for number, y in enumerate(centre, start=1):
        place: Look = {"transform": axes.get_yaxis_transform(), "va": "center"}
        axes.text(1.006, y, f"lane {number}", fontsize="small", color=style.MUTED, **place)


def _track(axes: Axes, recording: Recording, goal: Floats, ego: Floats, found: Events) -> None:
    time = recording.time
    # The goal of a frame held throughout the decision that ended there.
    style.curve(axes, time, goal, GOAL, drawstyle="steps-pre", zorder=2)
    begun = found["set"]
    axes.plot(time[begun], goal[begun + 1], linestyle="", zorder=3, **MARKERS["set"])
    style.curve(axes, time, ego, EGO, zorder=4)
    for end in ("reached", "timed out"):
        axes.plot(time[found[end]], ego[found[end]], linestyle="", zorder=5, **MARKERS[end])
    if recording.escaped.any():
        out = time[int(np.argmax(recording.escaped))]
        axes.axvline(out, zorder=1, **OUT)
    if recording.accident:
        axes.plot(time[-1], ego[-1], **WRECK, zorder=6)


def _key(recording: Recording, found: Events) -> list[Line2D]:
    handles = [
        Line2D([], [], color=EGO.colour, linewidth=style.DRAWN, label="ego"),
        Line2D([], [], color=GOAL.colour, ls=GOAL.dashes, lw=style.DRAWN, label="goal"),
    ]
    for event, marker in MARKERS.items():
        label = f"goal {event} ({len(found[event])})"
        handles.append(Line2D([], [], linestyle="", label=label, **marker))
    if recording.escaped.any():
        handles.append(Line2D([], [], label="out of the trap", **OUT))
    if recording.accident:
        handles.append(Line2D([], [], label=recording.ending, **WRECK))
    return handles
