"""The paper's profiles: speed, instant and accumulated reward over the first timesteps."""

from collections.abc import Mapping, Sequence

import numpy as np

from lanewise.evaluation.episodes import Recording
from lanewise.report import figure_style as style
from lanewise.report.figure_style import Axes, Figure, Floats, Line2D, Look, Style

Arms = Mapping[str, Sequence[Recording]]
"""By a controller's title: recordings of the same length of test and decision rate."""

QUANTILES = (0.1, 0.9)
PANELS = (
    ("speed", "speed, m/s"),
    ("reward", "instant reward,\nof a decision"),
    ("accumulated_reward", "accumulated reward,\none a second"),
)
"""Field of a profile, and label."""


@style.look()
def draw(arms: Arms) -> Figure:
    """The arms' profiles.

    Curves are means over the episodes still under way, and end with the shortest that had no
    accident; bands hold the middle 80 %. An accident is a cross: from then on its episode counts in
    the accumulated reward only, penalty included.
    """
    looks = style.styles(arms)
    times = {title: _times(runs) for title, runs in arms.items()}
    figure = Figure(figsize=(style.WIDTH, 6.4), layout="constrained")
    panels = style.panels(figure, len(PANELS))
    for axes, (name, label) in zip(panels, PANELS, strict=True):
        for title, runs in arms.items():
            _arm(axes, runs, times[title], name, looks[title])
        axes.set_ylabel(label)
    panels[-1].set_xlabel("time, timesteps of 1 s")
    handles = style.keys(arms, looks, "episode", "band: middle 80 % of episodes")
    if any(_accidents(runs, times[title]) for title, runs in arms.items()):
        handles.append(Line2D([], [], label="accident ends an episode", **_cross("0.2")))
    style.legend(figure, handles)
    return figure


def _times(recordings: Sequence[Recording]) -> Floats:
    """The times of an arm's profile, as far as its shortest recording without an accident goes."""
    whole = [recording for recording in recordings if not recording.accident]
    longest = max(recordings, key=lambda recording: len(recording.time))
    limit = min((run.time[-1] for run in whole), default=longest.time[-1])
    time: Floats = longest.time[longest.time <= limit + 1e-9]
    return time


def _accidents(recordings: Sequence[Recording], time: Floats) -> list[Recording]:
    """Those that end in an accident within the profile."""
    return [run for run in recordings if run.accident and run.time[-1] <= time[-1] + 1e-9]


def _profile(run: Recording, name: str, count: int) -> Floats:
    """A field of a recording at the first so many times; unknown is NaN."""
    values = run.speed[:, 0] if name == "speed" else getattr(run, name).copy()
    if name == "reward":
        # Of driving: neither the start, where there was none, nor an accident's penalty.
        values[0] = np.nan
        if run.accident:
            values[-1] = np.nan
    # The sum stays after an accident, penalty included.
    rest = values[-1] if name == "accumulated_reward" else np.nan
    return np.concatenate([values[:count], np.full(max(count - len(values), 0), rest)])


def _arm(axes: Axes, runs: Sequence[Recording], time: Floats, name: str, own: Style) -> None:
    table = np.stack([_profile(run, name, len(time)) for run in runs])
    known = ~np.isnan(table).all(axis=0)  # not at the start, nor where nobody drives any more
    x, table = time[known], table[:, known]
    # One reward a second: between two of them the sum stands still.
    steps = "steps-post" if name == "accumulated_reward" else "default"
    if len(table) > 1:
        low, high = np.nanquantile(table, QUANTILES, axis=0)
        style.band(axes, x, low, high, own, stepped=steps == "steps-post")
    style.curve(axes, x, np.nanmean(table, axis=0), own, drawstyle=steps)
    if name != "reward":
        for run in _accidents(runs, time):
            end = _profile(run, name, len(run.time))[-1]
            axes.plot(run.time[-1], end, **_cross(own.colour))


def _cross(colour: str) -> Look:
    size: Look = {"marker": "x", "markersize": 7.0, "markeredgewidth": 1.8}
    return {**size, "color": colour, "linestyle": "", "zorder": 5}
