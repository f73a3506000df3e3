"""The one definition of every test metric: name, unit, meaning, and what the paper published."""

import csv
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from math import isfinite, nan
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lanewise.errors import LanewiseError
from lanewise.evaluation import statistics
from lanewise.evaluation.episodes import ACCIDENT_KINDS, ACCIDENTS, Episodes
from lanewise.evaluation.statistics import Interval

PUBLISHED_EPISODES = 300
"""Test episodes behind each column of the paper's table."""


@dataclass(frozen=True)
class Metric:
    """What one number of a test says."""

    name: str
    """Key in JSON and in tables."""
    title: str
    """Short name for people."""
    meaning: str
    outcomes: Callable[[Episodes], NDArray[Any]]
    """[E] what it is the mean of, bool for a share, NaN where an episode says nothing; or the
    numerators of a ratio of sums."""
    denominators: Callable[[Episodes], NDArray[Any]] | None = None
    """[E] of a ratio of sums."""
    unit: str = ""
    """Unit of the stored value; empty for plain numbers, and for rates, which are fractions."""
    counted: str = ""
    """How often what it sums is counted; shown in place of a unit."""
    rate: bool = False
    """Is it a share, stored as a fraction of 1 and shown in percent?"""

    def compute(self, episodes: Episodes) -> tuple[float, Interval]:
        """Value and 95 % interval of a set of episodes; NaN if no episode counts."""
        values = self.outcomes(episodes)
        if self.denominators is not None:
            return _ratio(values, self.denominators(episodes), share=self.rate)
        return _share(values) if self.rate else _mean(values)


def _share(happened: NDArray[np.bool_]) -> tuple[float, Interval]:
    count = int(happened.sum())
    return count / len(happened), statistics.clopper_pearson(count, len(happened))


def _mean(values: NDArray[np.float64]) -> tuple[float, Interval]:
    known = values[~np.isnan(values)]
    value = float(known.mean()) if len(known) else nan
    return value, statistics.mean_interval(known)


def _ratio(above: NDArray[Any], below: NDArray[Any], *, share: bool) -> tuple[float, Interval]:
    total = float(below.sum())
    value = float(above.sum()) / total if total else nan
    low, high = statistics.ratio_interval(above, below)
    if not share:
        return value, (low, high)
    # All or none: no spread to be seen, so an interval would pretend to be certain.
    return value, (max(low, 0.0), min(high, 1.0)) if 0.0 < value < 1.0 else (nan, nan)


METRICS = (
    Metric(
        "escape_rate",
        "success (paper)",
        "share of episodes in which the ego's rear passed the front of every trap car before the "
        "episode ended; an accident later does not count against it",
        lambda episodes: episodes.escaped,
        rate=True,
    ),
    Metric(
        "success_rate",
        "success",
        "share of episodes in which the ego's rear passed the front of every trap car and no "
        "accident happened, not even later (stricter than the paper's)",
        lambda episodes: episodes.success,
        rate=True,
    ),
    Metric(
        "accident_rate",
        "accidents",
        "share of episodes with a collision, off the road, or come to a stop",
        lambda episodes: episodes.accident != 0,
        rate=True,
    ),
    Metric(
        "accumulated_reward",
        "reward",
        "mean over episodes of the sum of the rewards at the end of each second; an accident adds "
        "its penalty once and ends the sum",
        lambda episodes: episodes.accumulated_reward,
        counted="1 a second",
    ),
    Metric(
        "average_speed",
        "speed",
        "mean over episodes of the ego's mean speed",
        lambda episodes: episodes.average_speed,
        unit="m/s",
    ),
    Metric(
        "travel_distance",
        "distance",
        "mean over episodes of the distance travelled along the road",
        lambda episodes: episodes.travel_distance,
        unit="m",
    ),
    Metric(
        "reward_per_second",
        "reward/s",
        "sum of all accumulated rewards over the sum of all durations",
        lambda episodes: episodes.accumulated_reward,
        lambda episodes: episodes.duration,
    ),
    Metric(
        "escape_time",
        "escape time",
        "mean time until the ego was first past the trap, over the episodes in which it ever was",
        lambda episodes: episodes.escape_time,
        unit="s",
    ),
    Metric(
        "goal_time_out_rate",
        "goals given up",
        "share of the goals that ended by being given up; 0 where they are renewed before that",
        lambda episodes: episodes.goals_timed_out,
        lambda episodes: episodes.goals,
        rate=True,
    ),
)
"""Every metric, in the order of the tables."""

PUBLISHED: dict[str, dict[str, float]] = {
    "single-level": {
        "escape_rate": 0.0,
        "accident_rate": 0.0,
        "accumulated_reward": 3.32,
        "average_speed": 10.29,
        "travel_distance": 257.29,
    },
    "hierarchical": {
        "escape_rate": 0.9767,
        "accident_rate": 0.0233,
        "accumulated_reward": 13.20,
        "average_speed": 13.42,
        "travel_distance": 331.60,
    },
}
"""The paper's table "Performance Comparison", by controller and metric."""
TRAINING_WINDOW = 50
"""Last training episodes behind the paper's training table."""
PUBLISHED_TRAINING: dict[str, dict[str, float]] = {
    "single-level": {"reward": 25.82, "speed": 10.89, "escaped": 0.0},
    "hierarchical": {"reward": 47.94, "speed": 13.089, "escaped": 0.6},
}
"""The paper's training phase: means of the last episodes over 5 runs."""


@dataclass(frozen=True)
class Summary:
    """The metrics of one controller in one world."""

    controller: str
    world: str
    episodes: int
    """Number of test episodes."""
    values: Mapping[str, float]
    """By metric; NaN where there is nothing to average. An older summary lacks newer metrics."""
    accidents: Mapping[str, int]
    """Episodes by cause: collision, off_road, stopped."""
    accident_kinds: Mapping[str, int]
    """Episodes by kind of accident; none in an older summary."""
    intervals: Mapping[str, Interval]
    """95 %, by metric; a metric without an interval is missing."""
    unlike_paper: str | None = None
    """What makes the test another than the published ones: empty where nothing does, None where
    nobody has looked. Not stored."""

    def to_json(self) -> dict[str, Any]:
        """One object for JSON: rates as fractions of 1, unknown values as null."""
        return {
            "controller": self.controller,
            "world": self.world,
            "episodes": self.episodes,
            **{name: value if isfinite(value) else None for name, value in self.values.items()},
            "accidents": dict(self.accidents),
            "accident_kinds": dict(self.accident_kinds),
            "intervals": {name: [low, high] for name, (low, high) in self.intervals.items()},
        }

    @classmethod
    def from_json(cls, stored: Mapping[str, Any]) -> "Summary":
        """Read back what `to_json` made."""
        values = {m.name: stored[m.name] for m in METRICS if m.name in stored}
        return cls(
            stored["controller"],
            stored["world"],
            int(stored["episodes"]),
            {name: nan if value is None else float(value) for name, value in values.items()},
            dict(stored["accidents"]),
            dict(stored.get("accident_kinds", {})),
            {name: (low, high) for name, (low, high) in stored["intervals"].items()},
        )


def summarise(
    episodes: Episodes, *, controller: str, world: str, unlike_paper: str | None = None
) -> Summary:
    """Every metric of a set of test episodes; the other arguments are as of `Summary`.

    Raises:
        LanewiseError: there is no episode.
    """
    if not len(episodes):
        raise LanewiseError("there is no test episode to summarise; ask for at least one")
    computed = {metric.name: metric.compute(episodes) for metric in METRICS}
    return Summary(
        controller,
        world,
        len(episodes),
        {name: value for name, (value, _) in computed.items()},
        _counts(episodes.accident, ACCIDENTS),
        _counts(episodes.accident_kind, tuple(ACCIDENT_KINDS)),
        {name: interval for name, (_, interval) in computed.items() if isfinite(interval[0])},
        unlike_paper,
    )


def _counts(codes: NDArray[np.int8], names: Sequence[str]) -> dict[str, int]:
    """Episodes by the name of their code, but for the first, which is that of no accident."""
    counts = np.bincount(codes, minlength=len(names)).tolist()
    return dict(zip(names[1:], counts[1:], strict=True))


def published_intervals(controller: str) -> dict[str, Interval]:
    """Exact 95 % intervals of a controller's published rates, whose counts can be told."""
    known, total = PUBLISHED[controller], PUBLISHED_EPISODES
    rates = (metric.name for metric in METRICS if metric.rate and metric.name in known)
    return {name: statistics.clopper_pearson(round(known[name] * total), total) for name in rates}


@dataclass(frozen=True)
class Paired:
    """Two worlds, or two controllers, on the same starts."""

    episodes: int
    differing: tuple[int, ...]
    """Starts whose success or accident differs."""

    def to_json(self) -> dict[str, Any]:
        """One object for JSON."""
        return {
            "episodes": self.episodes,
            "identical": self.episodes - len(self.differing),
            "share": 1.0 - len(self.differing) / self.episodes,
            "differing": list(self.differing),
        }


def paired(a: Episodes, b: Episodes) -> Paired:
    """Compare outcomes start by start; where one set is longer, its further starts are left out.

    Raises:
        LanewiseError: there is no common start.
    """
    common = min(len(a), len(b))
    if not common:
        raise LanewiseError("there is no pair of test episodes to compare")
    same = (a.success[:common] == b.success[:common]) & (a.accident[:common] == b.accident[:common])
    return Paired(common, tuple(int(i) for i in np.flatnonzero(~same)))


_CODES = {"accident": ACCIDENTS, "accident_kind": tuple(ACCIDENT_KINDS)}
"""Outcomes that are stored by name."""
_NUMBERS = tuple(n for n in Episodes.__dataclass_fields__ if n not in ("success", *_CODES))


def to_csv(episodes: Episodes) -> str:
    """One row an episode as comma-separated text, numbers in full; an unknown value is empty."""
    lines = [",".join(["episode", "success", *_CODES, *_NUMBERS])]
    for i in range(len(episodes)):
        numbers = (getattr(episodes, name)[i].item() for name in _NUMBERS)
        cells = ("" if number != number else repr(number) for number in numbers)
        words = (names[getattr(episodes, code)[i]] for code, names in _CODES.items())
        lines.append(",".join([str(i), str(int(episodes.success[i])), *words, *cells]))
    return "\n".join(lines) + "\n"


def from_csv(text: str) -> Episodes:
    """Read back what `to_csv` made."""
    head, *rows = csv.reader(text.splitlines())
    cells = dict(zip(head, zip(*rows, strict=True), strict=True))
    numbers: dict[str, Any] = {
        name: np.array([float(cell or nan) for cell in cells[name]]) for name in _NUMBERS
    }
    for name in ("goals", "goals_timed_out"):
        numbers[name] = numbers[name].astype(np.int64)
    codes: dict[str, Any] = {
        code: np.array([names.index(cell) for cell in cells[code]], np.int8)
        for code, names in _CODES.items()
    }
    return Episodes(
        success=np.array([cell == "1" for cell in cells["success"]]), **codes, **numbers
    )
