"""Learning curves: the paper's training figure over several arms, and every stage of one run."""

from collections.abc import Mapping, Sequence
from math import isfinite, nan
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lanewise.errors import LanewiseError
from lanewise.report import figure_style as style
from lanewise.report.figure_style import Axes, Figure, Floats, Line2D, Look, Style
from lanewise.runs.metrics_file import settled_at

Rows = Sequence[Mapping[str, Any]]
Arms = Mapping[str, Sequence[Rows]]
"""By an arm's title: for each seed, its finished episodes in order."""

WINDOW = 50
"""Episodes in the running mean: the window of the paper's training table."""
STAGE_WINDOW = 0.05
"""The same in the figure of one run's stages, as a share of a stage's rows."""
PANELS = (
    ("escaped", "success (paper), %", 100.0),
    ("success", "success, %\n(and no accident)", 100.0),
    ("reward", "reward per episode,\none a decision", 1.0),
    ("speed", "average speed, m/s", 1.0),
)
"""Column of the rows, label with its unit, and factor to that unit."""
STAGE_COLUMNS = {"escaped": "escape_rate", "success": "success_rate"}
"""Names of columns in the rows of a stage, where they differ."""
POINTS = 1000
"""About as many places of a curve are drawn: more would show no more, and swell the SVG."""
SETTLED = "epsilon at its final value"


@style.look()
def draw(arms: Arms, *, settled: Mapping[str, float] | None = None) -> Figure:
    """The arms' training: means over seeds of running means, bands from lowest to highest seed.

    Args:
        arms: rows with `escaped`, `success`, `reward` and `speed`; null is a gap. An arm ends where
            its shortest seed ends.
        settled: by title, the episode at which epsilon came to its final value, which is marked.

    Raises:
        LanewiseError: if a training has no finished episode.
    """
    for title, seeds in arms.items():
        if not all(seeds):
            raise LanewiseError(f"{title}: a training without a finished episode cannot be drawn")
    looks, marks = style.styles(arms), settled or {}
    figure, panels = _panels()
    for axes, (column, _, factor) in zip(panels, PANELS, strict=True):
        for title, seeds in arms.items():
            smooth = [factor * _running_mean(_column_of(rows, column), WINDOW) for rows in seeds]
            _arm(axes, smooth, looks[title], marks.get(title))
    panels[-1].set_xlabel(f"training episode (running mean over the last {WINDOW})")
    handles = style.keys(arms, looks, "seed", "band: lowest to highest seed")
    if marks:
        handles.append(Line2D([], [], label=SETTLED, **_mark("0.3")))
    style.legend(figure, handles)
    return figure


@style.look()
def draw_stages(rows: Rows) -> Figure:
    """Every stage of a run: its metrics rows, pale, and their running mean over 5 % of the stage.

    A vertical mark shows where exploration has come down to its final epsilon.
    """
    stages = list(dict.fromkeys(str(row["stage"]) for row in rows))
    figure, panels = _panels()
    for axes, (column, _, factor) in zip(panels, PANELS, strict=True):
        for number, stage in enumerate(stages):
            name, own = STAGE_COLUMNS.get(column, column), style.STYLES[number % len(style.STYLES)]
            some = [row for row in rows if str(row["stage"]) == stage]
            x, y = _column_of(some, "decisions"), factor * _column_of(some, name)
            axes.plot(x, y, color=own.colour, linewidth=0.6, alpha=0.25)
            smooth = _running_mean(y, max(1, round(STAGE_WINDOW * len(y))))
            style.curve(axes, x, smooth, own, label=stage)
            place = settled_at(_column_of(some, "epsilon").tolist())
            if place is not None:
                look: Look = {"color": own.colour, "linestyle": own.dashes, "linewidth": 0.8}
                axes.axvline(x[place], alpha=0.6, **look)
    panels[-1].set_xlabel("decisions of the stage")
    handles, _ = panels[0].get_legend_handles_labels()
    mark = Line2D([], [], color="0.4", marker="|", markersize=9, linestyle="", label=SETTLED)
    style.legend(figure, [*handles, mark], most=4)
    return figure


def _column_of(rows: Rows, name: str) -> Floats:
    values = (row.get(name) for row in rows)
    return np.array([nan if value is None else value for value in values], dtype=np.float64)


def _running_mean(values: Floats, window: int) -> Floats:
    """Mean of the last `window` values at each place, of fewer at the start; NaN is skipped."""
    known = ~np.isnan(values)
    sums = np.concatenate([[0.0], np.cumsum(np.where(known, values, 0.0))])
    counts = np.concatenate([[0], np.cumsum(known)])
    starts = np.maximum(np.arange(1, len(values) + 1) - window, 0)
    number = counts[1:] - counts[starts]
    return np.where(number > 0, (sums[1:] - sums[starts]) / np.maximum(number, 1), nan)


def drawn_places(length: int) -> NDArray[np.int64]:
    """Which episodes of a curve are drawn: evenly spaced, the last among them."""
    step = -(-length // POINTS)
    return np.arange(length - 1, -1, -step, dtype=np.int64)[::-1]


def _panels() -> tuple[Figure, list[Axes]]:
    """A figure with a panel for each measure."""
    figure = Figure(figsize=(style.WIDTH, 1.2 + 1.8 * len(PANELS)), layout="constrained")
    panels = style.panels(figure, len(PANELS))
    for axes, (_, label, factor) in zip(panels, PANELS, strict=True):
        axes.set_ylabel(label)
        if factor == 100.0:
            axes.set_ylim(-3.0, 103.0)
    panels[-1].xaxis.set_major_formatter("{x:,.0f}")
    return figure, panels


def _arm(axes: Axes, seeds: Sequence[Floats], own: Style, settled: float | None) -> None:
    """Mean and band over seeds, as far as the shortest goes; a seed's gap is a gap of the mean."""
    length = min(len(values) for values in seeds)
    table = np.stack([values[:length] for values in seeds])
    mean, episode, drawn = table.mean(axis=0), np.arange(1.0, length + 1.0), drawn_places(length)
    if len(seeds) > 1:
        low, high = table.min(axis=0), table.max(axis=0)
        style.band(axes, episode[drawn], low[drawn], high[drawn], own)
    style.curve(axes, episode[drawn], mean[drawn], own)
    if settled is not None and 1.0 <= settled <= length:
        height = float(np.interp(settled, episode, mean))
        # A seed's first episodes may lack a value; then there is no height to mark.
        if isfinite(height):
            axes.plot(settled, height, **_mark(own.colour), zorder=5)


def _mark(colour: str) -> Look:
    look: Look = {"marker": "o", "markersize": 6.5, "markerfacecolor": "white"}
    return {**look, "markeredgecolor": colour, "markeredgewidth": 1.4, "linestyle": ""}
