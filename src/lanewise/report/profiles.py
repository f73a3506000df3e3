"""The paper's profiles: speed, instant and accumulated reward over the first timesteps."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from lanewise.errors import LanewiseError
from lanewise.evaluation.episodes import Recording
from lanewise.report import figure_style as style
from lanewise.report.figure_style import Axes, Figure, Floats, Line2D, Look, Style

Arms = Mapping[str, Sequence[Recording]]
"""By a controller's title: recordings of the same length of test."""

QUANTILES = (0.1, 0.9)
PANELS = (
    ("speed", "speed, m/s"),
    ("reward", "instant reward,\nof a decision"),
    ("accumulated_reward", "accumulated reward,\none a second"),
)
"""Field of a profile, and label."""


@dataclass(frozen=True)
class _Profile:
    """One controller's recordings after each decision, [episodes, times]; unknown is NaN."""

    time: Floats
    speed: Floats
    reward: Floats
    """Of the decision that ended there, unless that is the start or an accident."""
    accumulated_reward: Floats
    """One reward a second; after an accident it stays, penalty included."""
    accidents: Sequence[tuple[float, float, float]]
    """(time, speed, accumulated reward) of each."""


@style.look()
def draw(arms: Arms) -> Figure:
    """The arms' profiles.

    Curves are means over the episodes still under way, and end with the shortest that had no
    accident; bands hold the middle 80 %. An accident is a cross: from then on its episode counts in
    the accumulated reward only, penalty included.

    Raises:
        LanewiseError: if there is no arm, an arm without a recording, recordings of one arm with
            different decision rates, or too many arms.
    """
    if not arms:
        raise LanewiseError("there is no recording to draw")
    looks = style.styles(arms)
    profiles = {title: _profile(title, runs) for title, runs in arms.items()}
    figure = Figure(figsize=(style.WIDTH, 6.4), layout="constrained")
    panels = style.panels(figure, len(PANELS))
    for axes, (name, label) in zip(panels, PANELS, strict=True):
        for title, one in profiles.items():
            _arm(axes, one, name, looks[title])
        axes.set_ylabel(label)
    panels[-1].set_xlabel("time, timesteps of 1 s")
    handles = style.keys(arms, looks, "episode", "band: middle 80 % of episodes")
    if any(one.accidents for one in profiles.values()):
        handles.append(Line2D([], [], label="accident ends an episode", **_cross("0.2")))
    style.legend(figure, handles)
    return figure


def _profile(title: str, recordings: Sequence[Recording]) -> _Profile:
    """An arm's recordings side by side, as far as the shortest without an accident goes."""
    if not recordings:
        raise LanewiseError(f"{title}: there is no recording to draw")
    whole = [recording for recording in recordings if not recording.accident]
    longest = max(recordings, key=lambda recording: len(recording.time))
    limit = min((run.time[-1] for run in whole), default=longest.time[-1])
    time = longest.time[longest.time <= limit + 1e-9]
    for recording in recordings:
        common = min(len(time), len(recording.time))
        if not np.allclose(recording.time[:common], time[:common]):
            raise LanewiseError(f"{title}: recordings with different decision rates")
    accidents = [
        (float(run.time[-1]), float(run.speed[-1, 0]), float(run.accumulated_reward[-1]))
        for run in recordings
        if run.accident and run.time[-1] <= time[-1] + 1e-9
    ]
    count, sums = len(time), [run.accumulated_reward for run in recordings]
    return _Profile(
        time,
        np.stack([_padded(run.speed[:, 0], count, np.nan) for run in recordings]),
        np.stack([_padded(_instant(run), count, np.nan) for run in recordings]),
        np.stack([_padded(each, count, each[-1]) for each in sums]),
        accidents,
    )


def _instant(recording: Recording) -> Floats:
    """Rewards of driving: neither the start, where there was none, nor an accident's penalty."""
    reward = recording.reward.copy()
    reward[0] = np.nan
    if recording.accident:
        reward[-1] = np.nan
    return reward


def _padded(values: Floats, length: int, rest: float) -> Floats:
    return np.concatenate([values[:length], np.full(max(length - len(values), 0), rest)])


def _arm(axes: Axes, one: _Profile, name: str, own: Style) -> None:
    table: Floats = getattr(one, name)
    known = ~np.isnan(table).all(axis=0)  # not at the start, nor where nobody drives any more
    time, table = one.time[known], table[:, known]
    # One reward a second: between two of them the sum stands still.
    steps = "steps-post" if name == "accumulated_reward" else "default"
    if len(table) > 1:
        low, high = np.nanquantile(table, QUANTILES, axis=0)
        style.band(axes, time, low, high, own, stepped=steps == "steps-post")
    style.curve(axes, time, np.nanmean(table, axis=0), own, drawstyle=steps)
    for when, speed, accumulated in one.accidents:
        height = {"speed": speed, "accumulated_reward": accumulated}.get(name)
        if height is not None:
            axes.plot(when, height, **_cross(own.colour))


def _cross(colour: str) -> Look:
    size: Look = {"marker": "x", "markersize": 7.0, "markeredgewidth": 1.8}
    return {**size, "color": colour, "linestyle": "", "zorder": 5}
