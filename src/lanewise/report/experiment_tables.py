"""Tables of an experiment as Markdown and text: a row for each arm, figures over its seeds."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from math import isfinite, nan
from typing import Any

import numpy as np

from lanewise.evaluation import aggregates, metrics
from lanewise.evaluation.aggregates import Estimate
from lanewise.evaluation.metrics import METRICS, PUBLISHED, Metric, Summary
from lanewise.report import tables
from lanewise.report.markup import cell, line
from lanewise.report.tables import UNKNOWN, digits, head, number, scale, spread, unit
from lanewise.runs.selected_weights import SelectedWeights

PAPER = (
    *("accumulated_reward", "average_speed", "escape_rate", "success_rate"),
    *("travel_distance", "accident_rate"),
)
"""The metrics of the paper's test table, in its order, our stricter success beside the paper's."""
SHOWN: tuple[Metric, ...] = tuple(m for name in PAPER for m in METRICS if m.name == name)
OVER_SEEDS = ("escape_rate", "success_rate", "accumulated_reward")
"""Metrics with aggregates over seeds."""
TESTS = tuple((m.name, head(m), scale(m), digits(m)) for m in SHOWN)
"""Columns: name of a figure, title, factor, decimal places."""
TRAINING = (
    ("reward", "reward, 1 a decision", 1.0, 2),
    ("timestep_reward", "reward, 1 a second", 1.0, 2),
    ("speed", "speed, m/s", 1.0, 2),
    ("escaped", "success (paper), %", 100.0, 1),
    ("success", "success, %", 100.0, 1),
)
"""The same of a training episode."""
WEIGHTS = (
    ("escape_rate", "success (paper), %", 100.0, 1),
    ("success_rate", "success, %", 100.0, 1),
    ("accident_rate", "accidents, %", 100.0, 1),
    ("reward", "reward, 1 a second", 1.0, 2),
)
"""The same of kept and last weights."""
EFFORT = ("decisions", "episodes", "updates", "seconds")
"""What a training took, over all its stages."""

Rows = Sequence[Mapping[str, Any]]


@dataclass(frozen=True)
class ArmFigures:
    """What the tables need of an arm."""

    title: str
    controller: str
    """By which published figures are found."""
    seeds: Sequence[int]
    """In the order of what follows."""
    tests: Mapping[str, Sequence[Summary]]
    """By world, one for each seed."""
    training: Sequence[Rows] = field(default=())
    """Training episodes of the last stage, one list for each seed; empty if nothing is trained."""
    effort: Rows = field(default=())
    """What each seed's training took: ``decisions``, ``episodes``, ``updates``, ``seconds``."""
    unlike_paper: str | None = None
    """How its tests differ from the published ones: empty if they do not, None if unknown."""
    unlike_papers_training: str | None = None
    """The same of its trainings."""

    def values(self, world: str, metric: str) -> list[float]:
        """A metric of every seed; NaN where it is unknown."""
        return [summary.values.get(metric, nan) for summary in self.tests.get(world, ())]


def tests(arms: Sequence[ArmFigures], world: str) -> str:
    """The paper's test table: means over seeds, the lowest and the highest seed in parentheses."""

    def values(arm: ArmFigures, name: str) -> list[float]:
        return arm.values(world, name)

    return _with_published(arms, TESTS, values, PUBLISHED, "-", "unlike_paper")


def every_seed(arms: Sequence[ArmFigures], worlds: Sequence[str]) -> str:
    """One row for each seed and world, rates with exact 95 % intervals."""
    heads = ["arm", "seed", "world", "episodes", *(head(metric) for metric in SHOWN)]
    rows = [
        [
            *(cell(arm.title), str(seed), world, str(arm.tests[world][place].episodes)),
            *(tables.with_interval(metric, arm.tests[world][place]) for metric in SHOWN),
        ]
        for arm in arms
        for place, seed in enumerate(arm.seeds)
        for world in worlds
        if place < len(arm.tests.get(world, ()))
    ]
    return tables.markdown(heads, rows) + "\n"


def over_seeds(arms: Sequence[ArmFigures], reference: str | None) -> str:
    """Interquartile means in our world with bootstrap intervals, and how likely an arm beats one.

    Args:
        arms: an arm of one seed has no interval.
        reference: title of the arm to compare the others with; None leaves the comparison out.
    """
    held = next((arm for arm in arms if arm.title == reference), None)
    shown = [metric for metric in METRICS if metric.name in OVER_SEEDS]
    heads = ["arm"]
    for metric in shown:
        heads.append(f"IQM of {head(metric)}")
        if held is not None:
            heads.append(f"P({metric.title} above {cell(held.title)})")
    rows = []
    for arm in arms:
        if not arm.tests.get("lanewise"):
            continue
        row = [cell(arm.title)]
        for metric in shown:
            scores = arm.values("lanewise", metric.name)
            middle = _estimate(aggregates.interquartile_mean, scores)
            row.append(tables.estimated(metric, middle) if middle else UNKNOWN)
            if held is not None:
                others = [] if arm is held else held.values("lanewise", metric.name)
                ahead = _estimate(aggregates.probability_of_improvement, scores, others)
                row.append(tables.chance(ahead) if ahead else UNKNOWN)
        rows.append(row)
    return tables.markdown(heads, rows) + "\n"


def _estimate(statistic: Callable[..., Any], *arms: Sequence[float]) -> Estimate | None:
    """Over seeds; None where an arm has no score or an unknown one."""
    known = all(scores and all(map(isfinite, scores)) for scores in arms)
    return aggregates.estimate(statistic, *arms) if known else None


def training(arms: Sequence[ArmFigures]) -> str:
    """The paper's training table: means of the last episodes, over seeds."""

    def values(arm: ArmFigures, name: str) -> list[float]:
        return [last_mean(episodes, name) for episodes in arm.training]

    trained, papers = [arm for arm in arms if arm.training], metrics.PUBLISHED_TRAINING
    return _with_published(trained, TRAINING, values, papers, "5", "unlike_papers_training")


def effort(arms: Sequence[ArmFigures]) -> str:
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
    heads.append(f"tests of a seed in {' + '.join(map(cell, worlds))}")
    return tables.markdown(heads, rows) + "\n"


def weights(stages: Mapping[str, Sequence[SelectedWeights]]) -> str:
    """Kept and last weights, a row for each stage, by title: means over seeds and extremes."""
    heads = ["stage", "kept by", "chosen for success, %"]
    heads += [f"{title}: {of}" for _, title, _, _ in WEIGHTS for of in ("kept", "last")]
    rows = []
    for title, seeds in stages.items():
        chosen = [100.0 * each for seed in seeds if (each := seed.chosen_for) is not None]
        figures = (
            spread([factor * seed.line[f"{of}_{name}"] for seed in seeds], places)
            for name, _, factor, places in WEIGHTS
            for of in ("kept", "last")
        )
        rows.append([cell(title), cell(seeds[0].line["rule"]), spread(chosen, 1), *figures])
    return tables.markdown(heads, rows, texts=2) + "\n"


def last_mean(rows: Rows, name: str) -> float:
    """Mean of a measure over the last training episodes; NaN if unknown for one of them."""
    last = [row.get(name) for row in rows[-metrics.TRAINING_WINDOW :]]
    return float(np.mean([nan if value is None else value for value in last])) if last else nan


def text(arms: Sequence[ArmFigures], world: str) -> str:
    """The test table for a terminal, means alone."""
    heads = [["", *(metric.title for metric in SHOWN)], ["", *(unit(metric) for metric in SHOWN)]]
    rows = []
    for arm, published in _beside(arms, PUBLISHED, "unlike_paper"):
        if published:
            papers = (PUBLISHED[arm.controller].get(metric.name, nan) for metric in SHOWN)
            rows.append([f"{arm.controller}, published", *map(number, SHOWN, papers)])
        if arm.tests.get(world):
            means = (float(np.mean(arm.values(world, metric.name))) for metric in SHOWN)
            title = f"{line(arm.title)} ({len(arm.tests[world])})"
            rows.append([title, *map(number, SHOWN, means)])
    return "\n".join([tables.text(heads, rows), *_left_out(arms, PUBLISHED, "unlike_paper")]) + "\n"


def _with_published(
    arms: Sequence[ArmFigures],
    columns: Sequence[tuple[str, str, float, int]],
    values: Callable[[ArmFigures, str], list[float]],
    published: Mapping[str, Mapping[str, float]],
    published_seeds: str,
    unlike: str,
) -> str:
    """A row for each arm, above the first of a controller the published one, and notes on both."""
    rows = []
    for arm, first in _beside(arms, published, unlike):
        paper, own = published.get(arm.controller, {}), {c[0]: values(arm, c[0]) for c in columns}
        seeds = str(len(own[columns[0][0]]))
        if first:
            cells = (spread([factor * paper.get(n, nan)], d) for n, _, factor, d in columns)
            rows.append([f"*{cell(arm.controller)}, published*", published_seeds, *cells])
        if seeds != "0":
            cells = (spread([factor * v for v in own[n]], d) for n, _, factor, d in columns)
            rows.append([cell(arm.title), seeds, *cells])
    table = tables.markdown(["arm", "seeds", *(title for _, title, _, _ in columns)], rows)
    notes = _left_out(arms, published, unlike)
    return "\n".join([table, *(["", *map(cell, notes)] if notes else [])]) + "\n"


def _beside(
    arms: Sequence[ArmFigures], published: Mapping[str, Any], unlike: str
) -> Iterator[tuple[ArmFigures, bool]]:
    """Each arm, and whether its controller's published figures stand before it: once.

    ``unlike`` is the field that says how its tests, or trainings, differ from the published ones.
    """
    seen: set[str] = set()
    for arm in arms:
        alike = arm.controller in published and getattr(arm, unlike) == ""
        yield arm, alike and arm.controller not in seen
        if alike:
            seen.add(arm.controller)


def _left_out(arms: Sequence[ArmFigures], published: Mapping[str, Any], unlike: str) -> list[str]:
    """Why some arms must not be compared with published figures."""
    known = (arm for arm in arms if arm.controller in published)
    return tables.left_out({arm.title: getattr(arm, unlike) for arm in known})
