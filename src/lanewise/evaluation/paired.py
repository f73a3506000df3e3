"""Two controllers on the same starts: differences start by start.

What the starts have in common (where traffic stands) falls out of a paired difference, which makes
it sharper than two separate intervals. It speaks of the two controllers that drove, not of the way
they were trained: for that take several seeds (`aggregates`).
"""

from dataclasses import dataclass
from math import isfinite
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from scipy import stats

from lanewise.evaluation import statistics
from lanewise.evaluation.statistics import Interval


@dataclass(frozen=True)
class MeanDifference:
    """Mean difference of a quantity, second minus first."""

    value: float
    """In the quantity's unit."""
    interval: Interval
    """95 %, Student's over pairs; NaN for one pair."""

    def to_json(self) -> dict[str, Any]:
        """One object for JSON."""
        known = isfinite(self.interval[0])
        return {"difference": self.value, "interval": list(self.interval) if known else None}


@dataclass(frozen=True)
class RateDifference:
    """Difference of the rate of an outcome, second minus first, with McNemar's exact test."""

    value: float
    """A fraction of 1."""
    only_second: int
    """Starts with the outcome for the second controller alone."""
    only_first: int
    """Starts with the outcome for the first controller alone."""
    p_value: float
    """Chance of counts at least as uneven, were both controllers equally likely to stand alone."""

    def to_json(self) -> dict[str, Any]:
        """One object for JSON."""
        return {
            "difference": self.value,
            "only_this": self.only_second,
            "only_first": self.only_first,
            "p_value": self.p_value,
        }


def mean_difference(first: ArrayLike, second: ArrayLike) -> MeanDifference:
    """Mean of second minus first over the pairs, with Student's interval.

    Args:
        first: [n] one value a start.
        second: [n] of the same starts.

    Raises:
        ValueError: if there is no pair, or the lengths differ.
    """
    difference = np.subtract(*_pairs(second, first), dtype=np.float64)
    return MeanDifference(float(difference.mean()), statistics.mean_interval(difference))


def rate_difference(first: ArrayLike, second: ArrayLike) -> RateDifference:
    """How much more often the second controller had an outcome, and whether that is chance.

    Args:
        first: [n] bool, one a start.
        second: [n] bool, of the same starts.

    Raises:
        ValueError: if there is no pair, or the lengths differ.
    """
    before, after = (np.asarray(side, dtype=np.bool_) for side in _pairs(first, second))
    only_second, only_first = int((after & ~before).sum()), int((before & ~after).sum())
    value = (only_second - only_first) / len(before)
    return RateDifference(value, only_second, only_first, mcnemar(only_second, only_first))


def mcnemar(only_first: int, only_second: int) -> float:
    """Exact two-sided p-value of McNemar's test on the counts of discordant pairs.

    Pairs with equal outcomes say nothing. If neither side is ahead, each discordant pair falls to
    either with 1/2, which is the binomial test.

    Source: McNemar, Psychometrika 12 (1947); Agresti, Categorical Data Analysis (2002), 10.1.

    Args:
        only_first: b, pairs with the outcome on the first side alone.
        only_second: c, on the second side alone.

    Returns:
        Between 0 and 1; 1 where no pair is discordant.
    """
    total = only_first + only_second
    return float(stats.binomtest(only_first, total).pvalue) if total else 1.0


def _pairs(first: ArrayLike, second: ArrayLike) -> tuple[Any, Any]:
    ours, theirs = np.asarray(first), np.asarray(second)
    if ours.shape != theirs.shape or ours.ndim != 1 or not len(ours):
        raise ValueError(f"{ours.shape} and {theirs.shape} are not pairs")
    return ours, theirs
