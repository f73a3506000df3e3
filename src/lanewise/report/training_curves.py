"""The paper's training figure, with our success beside the paper's; several arms at once."""

from collections.abc import Mapping, Sequence
from math import isfinite
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from lanewise.errors import LanewiseError
from lanewise.extras import needed_for
from lanewise.report import style
from lanewise.report.curves import (
    PAPERS_SUCCESS,
    PERCENT,
    SUCCESS,
    Rows,
    column_of,
    running_mean,
    told,
)
from lanewise.report.style import Floats, Look, Style

with needed_for("the training figure"):
    from matplotlib.artist import Artist
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from matplotlib.lines import Line2D

Arms = Mapping[str, Sequence[Rows]]
"""By an arm's title: for each seed, its finished episodes in order."""

WINDOW = 50
"""Episodes in the running mean: the window of the paper's training table."""
REWARDS = {
    "reward": "reward per episode,\none a decision",
    "timestep_reward": "reward per episode,\none a second",
}
"""Column of the reward, and what it sums; the paper does not say which of the two it shows."""
POINTS = 1000
"""About as many places of a curve are drawn: more would show no more, and swell the SVG."""
BAND = "lowest to highest seed"
SETTLED = "epsilon at its final value"


def write(
    arms: Arms,
    path: Path | str,
    *,
    window: int = WINDOW,
    reward: str = "reward",
    settled: Mapping[str, float] | None = None,
) -> None:
    """Draw the arms' training into a PNG or SVG file.

    Each curve is the mean over an arm's seeds of their running means over the last `window`
    episodes, of fewer at the start; the band runs from the lowest to the highest seed. An arm ends
    where its shortest seed ends.

    Args:
        arms: rows with `escaped`, `success`, `speed` and the column `reward` names; null or
            missing is a gap, and `escaped` has no panel where no row has it. Arms named like a
            controller look the same in every figure.
        path: ending in .png or .svg.
        window: episodes.
        reward: `reward`, one reward a decision, or `timestep_reward`, one a second.
        settled: by title, the episode at which epsilon came to its final value; marked on the
            curve where the curve reaches so far.

    Raises:
        LanewiseError: if there is no arm, an arm without an episode, too many arms to tell apart,
            a title in `settled` that is no arm's, or the file cannot be written.
    """
    style.write(path, lambda: draw(arms, window=window, reward=reward, settled=settled))


@style.look()
def draw(
    arms: Arms,
    *,
    window: int = WINDOW,
    reward: str = "reward",
    settled: Mapping[str, float] | None = None,
) -> Figure:
    """The figure of `write`."""
    marks = settled or {}
    _check(arms, window, reward, marks)
    looks = style.styles(arms)
    wanted = (
        ("escaped", PAPERS_SUCCESS, PERCENT),
        ("success", SUCCESS, PERCENT),
        (reward, REWARDS[reward], 1.0),
        ("speed", "average speed, m/s", 1.0),
    )
    columns = told(wanted, (row for seeds in arms.values() for rows in seeds for row in rows))
    figure = Figure(figsize=(style.WIDTH, 1.2 + 1.8 * len(columns)), layout="constrained")
    panels = style.panels(figure, len(columns))
    for axes, (column, label, factor) in zip(panels, columns, strict=True):
        for title, seeds in arms.items():
            smooth = [factor * running_mean(column_of(rows, column), window) for rows in seeds]
            _arm(axes, smooth, looks[title], marks.get(title))
        axes.set_ylabel(label)
        if factor == PERCENT:
            axes.set_ylim(-3.0, 103.0)
    panels[-1].set_xlabel(f"training episode (running mean over the last {window})")
    style.thousands(panels[-1])
    style.legend(figure, _key(arms, looks, marks))
    return figure


def over_seeds(seeds: Sequence[Floats]) -> tuple[Floats, Floats, Floats]:
    """Mean, lowest and highest over seeds at each episode, as far as the shortest seed goes.

    An episode before a seed's first known value has none, rather than a mean over fewer seeds.
    """
    length = min(len(values) for values in seeds)
    table = np.stack([values[:length] for values in seeds])
    return table.mean(axis=0), table.min(axis=0), table.max(axis=0)


def drawn_places(length: int) -> NDArray[np.int64]:
    """Which episodes of a curve are drawn: evenly spaced, the last among them."""
    step = -(-length // POINTS)
    return np.arange(length - 1, -1, -step, dtype=np.int64)[::-1]


def _arm(axes: Axes, seeds: Sequence[Floats], own: Style, settled: float | None) -> None:
    mean, low, high = over_seeds(seeds)
    episode = np.arange(1.0, len(mean) + 1.0)
    drawn = drawn_places(len(mean))
    if len(seeds) > 1:
        style.band(axes, episode[drawn], low[drawn], high[drawn], own)
    style.curve(axes, episode[drawn], mean[drawn], own)
    if settled is not None and 1.0 <= settled <= len(mean):
        height = float(np.interp(settled, episode, mean))
        # A seed's first episodes may lack a value; then there is no height to mark.
        if isfinite(height):
            axes.plot(settled, height, **_mark(own), zorder=5)


def _mark(own: Style) -> Look:
    return {
        "marker": own.marker,
        "markersize": 6.5,
        "markerfacecolor": "white",
        "markeredgecolor": own.colour,
        "markeredgewidth": 1.4,
        "linestyle": "",
    }


def _key(arms: Arms, looks: Mapping[str, Style], marks: Mapping[str, float]) -> list[Artist]:
    handles: list[Artist] = []
    for title, seeds in arms.items():
        own = looks[title]
        name = f"{style.plain(title)} ({len(seeds)} seed{'s' if len(seeds) > 1 else ''})"
        handles.append(Line2D([], [], color=own.colour, ls=own.dashes, lw=style.DRAWN, label=name))
    if any(len(seeds) > 1 for seeds in arms.values()):
        handles.append(style.band_key(f"band: {BAND}"))
    if marks:
        handles.append(Line2D([], [], label=SETTLED, **_mark(Style("0.3", (0, ()), "o"))))
    return handles


def _check(arms: Arms, window: int, reward: str, marks: Mapping[str, float]) -> None:
    if not arms:
        raise LanewiseError("there is no training to draw")
    for title, seeds in arms.items():
        if not seeds or not all(len(rows) for rows in seeds):
            raise LanewiseError(f"{title}: a training without a finished episode cannot be drawn")
    for title in marks:
        if title not in arms:
            raise LanewiseError(f"{title}: no such training to mark in the figure")
    if window < 1:
        raise LanewiseError(f"the running mean needs at least one episode, got {window}")
    if reward not in REWARDS:
        raise LanewiseError(f"reward must be {' or '.join(REWARDS)}, got {reward}")
