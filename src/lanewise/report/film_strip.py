"""The paper's film strip: controllers side by side from above, at the same moments."""

from collections.abc import Mapping, Sequence

import numpy as np

from lanewise.evaluation.episodes import ACCIDENTS, Recording
from lanewise.report import figure_style as style
from lanewise.report import road_shapes
from lanewise.report.figure_style import Axes, Figure, Look, Patch, PolyCollection
from lanewise.report.road_shapes import Moment

TIMES = (1.0, 2.0, 3.0, 4.0, 9.0, 18.0)
"""The paper's moments, s."""
SEEN = (-30.0, 52.0)
"""Stretch of road in a frame, m from the ego's centre."""
LEFT, GAP, TOP, BOTTOM = 0.7, 0.22, 0.56, 0.42
"""Margins of the figure and the gap between columns, inches."""
CAPTION = 0.27
"""Room below a frame for its figures, inches."""
NAMES = ("ego (E)", "trap cars (numbered)", "traffic")
"""In the legend, by role."""


@style.look()
def draw(columns: Mapping[str, Recording], *, times: Sequence[float] = TIMES) -> Figure:
    """Moments of one episode per controller, in columns by title and rows by time, s.

    Under each frame stand the reward r_t of the decision that ended at t, the accumulated reward
    R_t (one a second) and the speed; right of them, what has become of the ego. The view follows
    the ego. After its end an episode stands still, and has no r_t. More than two columns would
    leave no room for the words.
    """
    width = (style.WIDTH - LEFT - 0.1 - GAP * (len(columns) - 1)) / len(columns)
    inch = width / (SEEN[1] - SEEN[0])
    frame_height = inch * max(np.diff(road_shapes.pavement(each))[0] for each in columns.values())
    height = TOP + len(times) * (frame_height + CAPTION) + BOTTOM
    figure = Figure(figsize=(style.WIDTH, height))
    for column, (title, recording) in enumerate(columns.items()):
        for row, t in enumerate(times):
            left = LEFT + column * (width + GAP)
            bottom = height - TOP - row * (frame_height + CAPTION) - frame_height
            box = np.array([left, bottom, width, frame_height])
            box /= [style.WIDTH, height, style.WIDTH, height]
            axes = figure.add_axes(tuple(box), label=f"{title}, {t:g} s")
            _frame(axes, recording, road_shapes.moment(recording, t), 72.0 * inch)
            _caption(axes, recording, t)
            if row == 0:
                axes.set_title(style.plain(title), fontweight="bold", fontsize="medium", pad=4.0)
            if column == 0:
                axes.set_ylabel(f"$t$ = {t:g} s", rotation=0, ha="right", va="center")
            _scale(axes, last=row == len(times) - 1)
    roles = sorted({int(r) for each in columns.values() for r in each.role[each.present]})
    handles = [Patch(facecolor=road_shapes.BODIES[role], label=NAMES[role]) for role in roles]
    if any((recording.goal_lane >= 0).any() for recording in columns.values()):
        handles.append(Patch(facecolor=road_shapes.GOAL_LANE, label="lane of the goal"))
    figure.legend(handles=handles, loc="upper center", ncols=len(handles), frameon=False)
    return figure


def _frame(axes: Axes, recording: Recording, now: Moment, points: float) -> None:
    """The road around the ego; `points` of a font are a metre."""
    start, end = (float(now.x[0]) + offset for offset in SEEN)
    shapes = list(road_shapes.shapes(recording, now, start, end))
    axes.add_collection(
        PolyCollection(
            [shape.corners for shape in shapes],
            facecolors=[shape.colour for shape in shapes],
            linewidths=0.0,
            snap=False,  # or some markings would come out a pixel wider than others
        )
    )
    axes.set(
        xlim=(start, end), ylim=road_shapes.pavement(recording)[::-1], aspect="equal", yticks=[]
    )
    axes.spines[:].set_visible(False)
    named = [
        *np.flatnonzero(recording.role == 0),
        *np.flatnonzero((recording.role == 1) & recording.present),
    ]
    for letter, number in zip("E123456789", named, strict=False):
        axes.text(
            float(now.x[number]) - 0.5,
            float(now.y[number]),
            letter,
            color="black" if recording.role[number] else "white",
            # A capital is 0.73 of its font's size tall, and fills two thirds of the vehicle.
            fontsize=min(points * float(recording.width[number]) * 0.66 / 0.73, 15.0),
            fontweight="bold",
            ha="center",
            va="center_baseline",
            clip_on=True,
        )


def _caption(axes: Axes, recording: Recording, t: float) -> None:
    now = road_shapes.moment(recording, t)
    over = t > recording.time[-1] + 1e-9
    instant = "-" if over or now.index == 0 else f"{recording.reward[now.index]:+.2f}"
    words = f"$r_t$ = {instant}   $R_t$ = {recording.accumulated_reward[now.index]:.2f}"
    words += f"   {now.ego_speed:.1f} m/s"
    fate = _fate(recording, now, over)
    below: Look = {"xycoords": "axes fraction", "textcoords": "offset points", "va": "top"}
    for place, text, side, weight in ((0, words, "left", "normal"), (1, fate, "right", "bold")):
        look: Look = below | {"ha": side, "fontsize": "small", "fontweight": weight}
        axes.annotate(text, (place, 0.0), (0.0, -2.0), **look)


def _fate(recording: Recording, now: Moment, over: bool) -> str:
    end = f"at {recording.time[-1]:.1f} s"
    if now.index == len(recording.time) - 1 and recording.accident:
        return f"{ACCIDENTS[recording.accident].replace('_', ' ')} {end}"
    if over:
        return f"ended {end}"
    if not recording.escaped[now.index]:
        return ""
    traps = (recording.role == 1) & recording.present
    if not traps.any():
        return "succeeded"
    fronts = now.x[traps] + recording.length[traps] / 2.0
    gap = now.x[0] - recording.length[0] / 2.0 - fronts.max()
    return f"{gap:.0f} m past the trap" if gap > 0.0 else "passed again"


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
