"""Every arm, seed by seed: a dot a seed, a line at their mean, the published value dashed."""

from collections.abc import Sequence
from textwrap import fill

import numpy as np

from lanewise.evaluation.metrics import METRICS, PUBLISHED, Metric
from lanewise.report import figure_style as style
from lanewise.report.experiment_tables import ArmFigures
from lanewise.report.figure_style import Artist, Axes, Figure, Line2D, Style
from lanewise.report.tables import head, scale

SHOWN = ("escape_rate", "success_rate", "accumulated_reward")
"""Metrics, a panel each."""
ROW, HEAD, LETTERS = 0.34, 1.0, 34
"""Inches of an arm's row and of what stands above and below them all; letters in a title's line."""
REFERENCE = "not trained"
"""Name of all controllers that learn nothing."""
SPREAD = 0.22
"""How far the dots of a row are spread around its middle, so that equal values do not overlap."""


@style.look()
def draw(arms: Sequence[ArmFigures], world: str) -> Figure:
    """The tests of every arm in a world, from above to below, if it has any there."""
    tested = [arm for arm in arms if arm.tests.get(world)]
    metrics = [metric for name in SHOWN for metric in METRICS if metric.name == name]
    figure = Figure(figsize=(style.WIDTH, HEAD + ROW * len(tested)), layout="constrained")
    panels = figure.subplots(1, len(metrics), sharey=True, squeeze=False)[0]
    for axes, metric in zip(panels, metrics, strict=True):
        for row, arm in enumerate(tested):
            _row(axes, row, metric, arm, world)
        _published(axes, metric, tested)
        axes.set_xlabel(head(metric))
        if metric.rate:
            axes.set_xlim(-4.0, 104.0)
        axes.grid(color=style.GRID, linewidth=0.6)
        axes.set_axisbelow(True)
    titles = [fill(style.plain(arm.title), LETTERS) for arm in tested]
    panels[0].set_yticks(range(len(tested)), titles)
    panels[0].set_ylim(len(tested) - 0.5, -0.5)
    style.legend(figure, _key(tested))
    return figure


def _row(axes: Axes, row: int, metric: Metric, arm: ArmFigures, world: str) -> None:
    values = scale(metric) * np.array(arm.values(world, metric.name))
    height = row + SPREAD * np.linspace(-1.0, 1.0, len(values)) if len(values) > 1 else [row]
    own = _own(arm)
    axes.plot(values, height, own.marker, color=own.colour, markersize=3.4, alpha=0.75)
    mean = float(np.mean(values))
    axes.plot([mean, mean], [row - 0.36, row + 0.36], color=own.colour, linewidth=style.DRAWN)


def _published(axes: Axes, metric: Metric, arms: Sequence[ArmFigures]) -> None:
    for controller in dict.fromkeys(arm.controller for arm in arms if arm.unlike_paper == ""):
        value = PUBLISHED.get(controller, {}).get(metric.name)
        if value is not None:
            colour = style.STYLES[style.OWN[controller]].colour
            axes.axvline(scale(metric) * value, color=colour, linestyle=(0, (4, 2)), linewidth=0.9)


def _own(arm: ArmFigures) -> Style:
    """As its controller looks in every figure; one that was not trained in grey."""
    place = style.OWN.get(arm.controller)
    return Style("0.45", (0, ()), "x") if place is None else style.STYLES[place]


def _key(arms: Sequence[ArmFigures]) -> list[Artist]:
    names = [arm.controller if arm.controller in style.OWN else REFERENCE for arm in arms]
    looks = dict(zip(names, map(_own, arms), strict=True))
    handles: list[Artist] = [
        Line2D([], [], color=own.colour, marker=own.marker, linestyle="", label=name)
        for name, own in looks.items()
    ]
    handles.append(Line2D([], [], color="0.3", linewidth=style.DRAWN, label="mean over seeds"))
    handles.append(Line2D([], [], color="0.3", linestyle=(0, (4, 2)), label="published"))
    return handles
