"""The learning curves: both successes, reward and speed while each stage trains."""

from collections.abc import Iterable, Mapping, Sequence
from math import nan
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lanewise.errors import LanewiseError
from lanewise.extras import needed_for
from lanewise.report import style
from lanewise.report.style import STYLES
from lanewise.runs.metrics_file import settled_at

with needed_for("the learning-curve figure"):
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from matplotlib.lines import Line2D

Rows = Sequence[Mapping[str, Any]]

Panel = tuple[str, str, float]
"""Column of the metrics rows, label with its unit, and factor to that unit."""
PERCENT = 100.0
PAPERS_SUCCESS = "success (paper), %"
SUCCESS = "success, %\n(and no accident)"
PANELS: tuple[Panel, ...] = (
    ("escape_rate", PAPERS_SUCCESS, PERCENT),
    ("success_rate", SUCCESS, PERCENT),
    ("reward", "reward per episode,\none a decision", 1.0),
    ("speed", "average speed, m/s", 1.0),
)

SETTLED = "epsilon at its final value"


def write_curves(
    rows: Rows, path: Path | str, *, against: str = "decisions", window: float = 0.05
) -> None:
    """Draw one line a stage into a PNG or SVG file.

    Thin and pale: the rows as recorded. Thick: their running mean over the last `window` of the
    stage. A vertical mark shows where exploration has come down to its final epsilon.

    Args:
        rows: metrics rows with `stage`, `decisions`, `episodes`, `escape_rate`, `success_rate`,
            `reward`, `speed` and `epsilon`; null or missing values are gaps. What no row has, as
            `escape_rate` in older files, has no panel.
        path: ending in .png or .svg.
        against: `decisions` or `episodes`, the horizontal axis.
        window: length of the running mean as a share of a stage's rows.

    Raises:
        LanewiseError: if there is no row, or the file cannot be written.
    """
    if not rows:
        raise LanewiseError("there are no metrics to draw; train first")
    style.write(path, lambda: draw(rows, against=against, window=window))


@style.look()
def draw(rows: Rows, *, against: str = "decisions", window: float = 0.05) -> Figure:
    """The figure of `write_curves`."""
    columns = told(PANELS, rows)
    figure = Figure(figsize=(style.WIDTH, 1.0 + 1.8 * len(columns)), layout="constrained")
    panels = style.panels(figure, len(columns))
    stages = list(dict.fromkeys(str(row["stage"]) for row in rows))
    for axes, (column, label, factor) in zip(panels, columns, strict=True):
        for number, stage in enumerate(stages):
            own = [row for row in rows if str(row["stage"]) == stage]
            _line(axes, own, number, (against, column, factor, window))
        axes.set_ylabel(label)
        if factor == PERCENT:
            axes.set_ylim(-3.0, 103.0)
    panels[-1].set_xlabel(f"{against} of the stage")
    style.thousands(panels[-1])
    handles, _ = panels[0].get_legend_handles_labels()
    mark = Line2D([], [], color="0.4", marker="|", markersize=9, linestyle="", label=SETTLED)
    style.legend(figure, [*handles, mark], most=4)
    return figure


def _line(axes: Axes, rows: Rows, number: int, what: tuple[str, str, float, float]) -> None:
    against, column, factor, window = what
    own = STYLES[number % len(STYLES)]
    x = column_of(rows, against)
    y = factor * column_of(rows, column)
    smooth = running_mean(y, max(1, round(window * len(y))))
    axes.plot(x, y, color=own.colour, linewidth=0.6, alpha=0.25)
    style.curve(axes, x, smooth, own, label=str(rows[0]["stage"]))
    settled = settled_at(column_of(rows, "epsilon").tolist())
    if settled is not None:
        axes.axvline(x[settled], color=own.colour, linestyle=own.dashes, linewidth=0.8, alpha=0.6)


def told(panels: Sequence[Panel], rows: Iterable[Mapping[str, Any]]) -> list[Panel]:
    """The panels whose column is in some row."""
    known = {name for row in rows for name in row}
    return [panel for panel in panels if panel[0] in known]


def column_of(rows: Rows, name: str) -> NDArray[np.float64]:
    """One column of metrics rows; null and missing values as NaN."""
    values = (row.get(name) for row in rows)
    return np.array([nan if value is None else value for value in values], dtype=np.float64)


def running_mean(values: NDArray[np.float64], window: int) -> NDArray[np.float64]:
    """Mean of the last `window` values at each place, of fewer at the start; NaN is skipped."""
    known = ~np.isnan(values)
    sums = np.concatenate([[0.0], np.cumsum(np.where(known, values, 0.0))])
    counts = np.concatenate([[0], np.cumsum(known)])
    ends = np.arange(1, len(values) + 1)
    starts = np.maximum(ends - window, 0)
    number = counts[ends] - counts[starts]
    total = sums[ends] - sums[starts]
    return np.where(number > 0, total / np.maximum(number, 1), nan)
