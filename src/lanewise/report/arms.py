"""Tables of an experiment as Markdown and text: a row an arm, figures over its seeds."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from math import isfinite, nan
from typing import Any

import numpy as np

from lanewise.evaluation import aggregates
from lanewise.evaluation.metrics import (
    METRICS,
    PUBLISHED,
    PUBLISHED_TRAINING,
    TRAINING_WINDOW,
    Metric,
    Summary,
)
from lanewise.report.escape import cell, line
from lanewise.report.table import bounds, left_out, number, spread, unit

PAPER = (
    *("accumulated_reward", "average_speed", "escape_rate", "success_rate"),
    *("travel_distance", "accident_rate"),
)
"""The metrics of the paper's test table, in its order, our stricter success beside the paper's."""
SHOWN: tuple[Metric, ...] = tuple(m for name in PAPER for m in METRICS if m.name == name)
TRAINING = (
    ("reward", "reward, 1 a decision", 1.0, 2),
    ("timestep_reward", "reward, 1 a second", 1.0, 2),
    ("speed", "speed, m/s", 1.0, 2),
    ("escaped", "success (paper), %", 100.0, 1),
    ("success", "success, %", 100.0, 1),
)
"""Measures of a training episode: column of the metrics, title, factor, digits."""

UNKNOWN = "-"
"""A cell without a figure."""
EFFORT = ("decisions", "episodes", "updates", "seconds")
"""What a training took, over all its stages."""

Rows = Sequence[Mapping[str, Any]]


@dataclass(frozen=True)
class ArmFigures:
    """What the tables need of an arm."""

    title: str
    """Its name for people."""
    controller: str
    """Name of its controller, by which published figures are found."""
    seeds: Sequence[int]
    """In the order of what follows."""
    tests: Mapping[str, Sequence[Summary]]
    """By world, one a seed."""
    training: Sequence[Rows] = field(default=())
    """Training episodes of the last stage, one list a seed; none for a reference driver."""
    effort: Rows = field(default=())
    """What each seed's training took: ``decisions``, ``episodes``, ``updates``, ``seconds``."""
    unlike_paper: str | None = None
    """What makes its tests others than the published ones: empty where nothing does, None where
    nobody has looked."""
    unlike_papers_training: str | None = None
    """The same of its trainings."""

    def values(self, world: str, metric: str) -> list[float]:
        """A metric of every seed; NaN where it is unknown."""
        return [summary.values.get(metric, nan) for summary in self.tests.get(world, ())]


Unlike = Callable[[ArmFigures], str | None]
"""What makes an arm's tests, or its trainings, others than the published ones."""


def tests(arms: Sequence[ArmFigures], world: str) -> str:
    """The paper's test table: means over seeds, the lowest and the highest seed in parentheses."""
    heads = ["arm", "seeds", *(head(metric) for metric in SHOWN)]
    rows = []
    for arm, published in _beside(arms, PUBLISHED, _unlike_test):
        if published:
            rows.append([f"*{cell(arm.controller)}, published*", "-", *_published(arm.controller)])
        if arm.tests.get(world):
            cells = [_span(metric, arm.values(world, metric.name)) for metric in SHOWN]
            rows.append([cell(arm.title), str(len(arm.tests[world])), *cells])
    return _markdown(heads, rows, _left_out(arms, PUBLISHED, _unlike_test))


def every_seed(arms: Sequence[ArmFigures], worlds: Sequence[str]) -> str:
    """One row a seed and world, rates with exact 95 % intervals."""
    heads = ["arm", "seed", "world", "episodes", *(head(metric) for metric in SHOWN)]
    rows = []
    for arm in arms:
        for place, seed in enumerate(arm.seeds):
            for world in worlds:
                if place < len(arm.tests.get(world, ())):
                    summary = arm.tests[world][place]
                    cells = [_with_interval(metric, summary) for metric in SHOWN]
                    count = str(summary.episodes)
                    rows.append([cell(arm.title), str(seed), world, count, *cells])
    return _markdown(heads, rows)


def over_seeds(arms: Sequence[ArmFigures], reference: str | None, world: str = "lanewise") -> str:
    """Interquartile means with bootstrap intervals, and how likely an arm beats the reference.

    Args:
        arms: those with one seed alone have no interval.
        reference: title of the arm that the others are held against; None leaves that out.
        world: whose tests.
    """
    held = next((arm for arm in arms if arm.title == reference), None)
    names = ("escape_rate", "success_rate", "accumulated_reward")
    metrics = [metric for name in names for metric in SHOWN if metric.name == name]
    heads = ["arm"]
    for metric in metrics:
        heads.append(f"IQM of {head(metric)}")
        if held is not None:
            heads.append(f"P({metric.title} above {cell(held.title)})")
    rows = []
    for arm in arms:
        if not arm.tests.get(world):
            continue
        row = [cell(arm.title)]
        for metric in metrics:
            scores = arm.values(world, metric.name)
            row.append(_interquartile_mean(metric, scores))
            if held is not None:
                improves = UNKNOWN if arm is held else _improvement(scores, held, world, metric)
                row.append(improves)
        rows.append(row)
    return _markdown(heads, rows)


def training(arms: Sequence[ArmFigures]) -> str:
    """The paper's training table: means of the last episodes, over seeds."""
    heads = ["arm", "seeds", *(title for _, title, _, _ in TRAINING)]
    rows = []
    trained = [arm for arm in arms if arm.training]
    for arm, published in _beside(trained, PUBLISHED_TRAINING, _unlike_training):
        if published:
            figures = PUBLISHED_TRAINING[arm.controller]
            cells = [
                f"{factor * figures[name]:.{digits}f}" if name in figures else UNKNOWN
                for name, _, factor, digits in TRAINING
            ]
            rows.append([f"*{cell(arm.controller)}, published*", "5", *cells])
        cells = [
            spread([factor * last_mean(rows_, name) for rows_ in arm.training], digits)
            for name, _, factor, digits in TRAINING
        ]
        rows.append([cell(arm.title), str(len(arm.training)), *cells])
    return _markdown(heads, rows, _left_out(trained, PUBLISHED_TRAINING, _unlike_training))


def run(arms: Sequence[ArmFigures]) -> str:
    """What was run: means over seeds of what the trainings took, and the tests."""
    heads = ["arm", "seeds", "decisions", "episodes", "updates", "updates a decision", "minutes"]
    rows = []
    for arm in arms:
        cells = [UNKNOWN] * 5
        if arm.effort:
            decisions, episodes, updates, seconds = (
                float(np.mean([each[name] for each in arm.effort])) for name in EFFORT
            )
            cells = [f"{value:,.0f}" for value in (decisions, episodes, updates)]
            share = f"{updates / decisions:.3f}" if decisions else UNKNOWN
            cells += [share, f"{seconds / 60:.1f}"]
        tested = (summaries[0].episodes if summaries else 0 for summaries in arm.tests.values())
        numbers = ", ".join(map(str, arm.seeds))
        rows.append([cell(arm.title), numbers, *cells, " + ".join(map(str, tested))])
    worlds = list(dict.fromkeys(world for arm in arms for world in arm.tests))
    return _markdown([*heads, f"tests of a seed in {' + '.join(map(cell, worlds))}"], rows)


def last_mean(rows: Rows, name: str) -> float:
    """Mean of a measure over the last training episodes; NaN if there was none.

    NaN also where an episode from an older version does not tell it.
    """
    last = [row.get(name) for row in rows[-TRAINING_WINDOW:]]
    return float(np.mean([nan if value is None else value for value in last])) if last else nan


def text(arms: Sequence[ArmFigures], world: str) -> str:
    """The test table for a terminal, means alone."""
    rows = [["", *(metric.title for metric in SHOWN)], ["", *(unit(metric) for metric in SHOWN)]]
    for arm, published in _beside(arms, PUBLISHED, _unlike_test):
        if published:
            rows.append([f"{arm.controller}, published", *_published(arm.controller)])
        if arm.tests.get(world):
            means = [float(np.mean(arm.values(world, metric.name))) for metric in SHOWN]
            cells = [_known(metric, mean) for metric, mean in zip(SHOWN, means, strict=True)]
            rows.append([f"{line(arm.title)} ({len(arm.tests[world])})", *cells])
    widths = [max(len(row[i]) for row in rows) for i in range(len(rows[0]))]
    lines = []
    for label, *figures in rows:
        padded = [figure.rjust(width) for figure, width in zip(figures, widths[1:], strict=True)]
        lines.append("  ".join([label.ljust(widths[0]), *padded]))
    left = _left_out(arms, PUBLISHED, _unlike_test)
    return "\n".join([*lines[:2], "-" * len(lines[0]), *lines[2:], *left]) + "\n"


def _beside(
    arms: Sequence[ArmFigures], published: Mapping[str, Any], unlike: Unlike
) -> Iterator[tuple[ArmFigures, bool]]:
    """Each arm, and whether its controller's published figures stand before it: once."""
    seen: set[str] = set()
    for arm in arms:
        first = arm.controller in published and unlike(arm) == "" and arm.controller not in seen
        if first:
            seen.add(arm.controller)
        yield arm, first


def _left_out(
    arms: Sequence[ArmFigures], published: Mapping[str, Any], unlike: Unlike
) -> list[str]:
    """Why published figures are not to be held against some of the arms."""
    why = {arm.title: unlike(arm) for arm in arms if arm.controller in published}
    return left_out({title: reason for title, reason in why.items() if reason})


def _unlike_test(arm: ArmFigures) -> str | None:
    return arm.unlike_paper


def _unlike_training(arm: ArmFigures) -> str | None:
    return arm.unlike_papers_training


def _published(controller: str) -> list[str]:
    return [_known(metric, PUBLISHED[controller].get(metric.name, nan)) for metric in SHOWN]


def _known(metric: Metric, value: float) -> str:
    return number(metric, value) if isfinite(value) else UNKNOWN


def head(metric: Metric) -> str:
    """A metric's title with its unit."""
    return f"{metric.title}, {unit(metric)}" if unit(metric) else metric.title


def _span(metric: Metric, values: Sequence[float]) -> str:
    """Mean over seeds, lowest and highest; unknown if a seed's is: of fewer it would be another."""
    shown = _known(metric, float(np.mean(values)))
    if len(values) == 1 or shown == UNKNOWN:
        return shown
    return f"{shown} ({number(metric, min(values))} to {number(metric, max(values))})"


def _with_interval(metric: Metric, summary: Summary) -> str:
    shown = _known(metric, summary.values.get(metric.name, nan))
    interval = summary.intervals.get(metric.name)
    return shown if interval is None else f"{shown} {bounds(metric, interval)}"


def _interquartile_mean(metric: Metric, scores: Sequence[float]) -> str:
    if not all(map(isfinite, scores)):
        return UNKNOWN
    shown = number(metric, aggregates.interquartile_mean(scores))
    interval = aggregates.interquartile_interval(scores)
    return f"{shown} {bounds(metric, interval)}" if isfinite(interval[0]) else shown


def _improvement(scores: Sequence[float], held: ArmFigures, world: str, metric: Metric) -> str:
    others = held.values(world, metric.name)
    if not others or not all(map(isfinite, (*scores, *others))):
        return UNKNOWN
    value = aggregates.probability_of_improvement(scores, others)
    low, high = aggregates.improvement_interval(scores, others)
    return f"{value:.2f} ({low:.2f}, {high:.2f})" if isfinite(low) else f"{value:.2f}"


def _markdown(
    heads: Sequence[str], rows: Sequence[Sequence[str]], notes: Sequence[str] = ()
) -> str:
    """A table, and notes below it."""
    lines = ["| " + " | ".join(heads) + " |", "|---|" + "---:|" * (len(heads) - 1)]
    lines += ["| " + " | ".join(row) + " |" for row in rows]
    below = ["", *map(cell, notes)] if notes else []
    return "\n".join([*lines, *below]) + "\n"
