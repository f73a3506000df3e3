"""Several runs on the same test starts: each one's metrics, differences to the first, arms.

Runs that differ in their seed alone are the seeds of one arm. A difference between two runs speaks
of two trained controllers; only arms of several seeds speak of the way they were trained.
"""

from collections.abc import Hashable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from lanewise.errors import LanewiseError
from lanewise.evaluation import metrics, statistics
from lanewise.evaluation.aggregates import (
    Estimate,
    estimate,
    interquartile_mean,
    probability_of_improvement,
)
from lanewise.evaluation.episodes import Episodes
from lanewise.evaluation.metrics import METRICS, PUBLISHED, Summary
from lanewise.evaluation.statistics import MeanDifference, RateDifference

Difference = MeanDifference | RateDifference

COMPARED = tuple(m for m in METRICS if m.name in (*PUBLISHED["hierarchical"], "success_rate"))
"""The paper's metrics and our success."""
FEWER_IS_BETTER = ("accident_rate",)
"""The others count as better the more they are, speed and distance too, as in the paper."""


@dataclass(frozen=True)
class Entry:
    """A run that takes part."""

    name: str
    """What the user calls it."""
    controller: str
    seed: int
    """Of its training."""
    settings: Hashable
    """Equal for runs that were made with equal settings."""


@dataclass(frozen=True)
class Arm:
    """The runs that differ in their seed alone."""

    controller: str
    runs: tuple[int, ...]
    """Which runs, in the order of their seeds."""
    seeds: tuple[int, ...]
    values: Mapping[str, tuple[float, ...]]
    """By metric: one value a seed."""
    interquartile_mean: Mapping[str, Estimate]
    """By metric, with intervals over seeds."""


@dataclass(frozen=True)
class Improvement:
    """How likely a new seed of one arm does better than a new seed of another."""

    arm: int
    over: int
    """Which other arm."""
    probability: Mapping[str, Estimate]
    """By metric, with intervals over seeds; better is fewer for accidents, more for the rest."""


@dataclass(frozen=True)
class Comparison:
    """Everything there is to say about several runs."""

    runs: tuple[Entry, ...]
    summaries: tuple[Summary, ...]
    """Each run's metrics."""
    differences: tuple[Mapping[str, Difference], ...]
    """Of each run but the first to the first, by metric."""
    arms: tuple[Arm, ...]
    """In the order of their first runs."""
    improvements: tuple[Improvement, ...]
    """Of each arm over each before it; empty where no arm has two seeds."""

    @property
    def has_seeds(self) -> bool:
        """Whether any arm has more than one seed."""
        return any(len(arm.runs) > 1 for arm in self.arms)


def compare(runs: Sequence[Entry], episodes: Sequence[Episodes], world: str) -> Comparison:
    """Compare runs; the i-th of a run's ``episodes`` started where the i-th of the others did.

    Raises:
        LanewiseError: there are fewer than two runs, or two are the same.
    """
    members = arm_members(runs)
    summaries = tuple(
        metrics.summarise(driven, controller=run.controller, world=world)
        for run, driven in zip(runs, episodes, strict=True)
    )
    arms = tuple(_arm(runs, summaries, numbers) for numbers in members)
    differences = tuple(_differences(episodes[0], other) for other in episodes[1:])
    return Comparison(tuple(runs), summaries, differences, arms, _improvements(arms))


def arm_members(runs: Sequence[Entry]) -> list[tuple[int, ...]]:
    """The numbers of the runs of each arm, in the order of their seeds.

    Raises:
        LanewiseError: there are fewer than two runs, or two are the same.
    """
    if len(runs) < 2:
        raise LanewiseError(f"a comparison needs at least two runs, got {len(runs)}")
    arms: dict[Hashable, dict[int, int]] = {}
    for number, run in enumerate(runs):
        seeds = arms.setdefault((run.controller, run.settings), {})
        if run.seed in seeds:
            raise LanewiseError(
                f"{runs[seeds[run.seed]].name} and {run.name} are the same run twice: "
                f"{run.controller}, the same settings, seed {run.seed}"
            )
        seeds[run.seed] = number
    return [tuple(seeds[seed] for seed in sorted(seeds)) for seeds in arms.values()]


def _differences(first: Episodes, other: Episodes) -> dict[str, Difference]:
    found: dict[str, Difference] = {}
    for metric in COMPARED:
        compare = statistics.rate_difference if metric.rate else statistics.mean_difference
        found[metric.name] = compare(metric.outcomes(first), metric.outcomes(other))
    return found


def _arm(runs: Sequence[Entry], summaries: Sequence[Summary], numbers: tuple[int, ...]) -> Arm:
    values = {m.name: tuple(summaries[n].values[m.name] for n in numbers) for m in COMPARED}
    return Arm(
        runs[numbers[0]].controller,
        numbers,
        tuple(runs[n].seed for n in numbers),
        values,
        {name: estimate(interquartile_mean, scores) for name, scores in values.items()},
    )


def _improvements(arms: Sequence[Arm]) -> tuple[Improvement, ...]:
    """Each arm over each before it, if seeds were repeated at all."""
    if all(len(arm.runs) < 2 for arm in arms):
        return ()
    pairs = ((later, earlier) for later in range(len(arms)) for earlier in range(later))
    return tuple(Improvement(*pair, _probability(*(arms[n] for n in pair))) for pair in pairs)


def _probability(arm: Arm, over: Arm) -> dict[str, Estimate]:
    found = {}
    for name in arm.values:
        sign = -1.0 if name in FEWER_IS_BETTER else 1.0
        scores, others = (sign * np.asarray(side.values[name]) for side in (arm, over))
        found[name] = estimate(probability_of_improvement, scores, others)
    return found
