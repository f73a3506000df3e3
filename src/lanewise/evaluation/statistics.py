"""95 % intervals and paired tests of episodes.

Intervals use `scipy.special` alone: `scipy.stats` has the same quantiles, but takes three times as
long to import, and every test of a controller imports this module.

Pairs are two controllers on the same starts. What the starts have in common (where traffic stands)
falls out of a paired difference, which makes it sharper than two separate intervals. It speaks of
the two controllers that drove, not of the way they were trained: for that take several seeds
(`aggregates`).
"""

from dataclasses import dataclass
from math import isfinite, nan, sqrt
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import special

Interval = tuple[float, float]

CONFIDENCE = 0.95
"""Share of repetitions in which an interval is to hold the true value."""


def clopper_pearson(successes: int, trials: int) -> Interval:
    """Exact interval of a rate, fractions of 1.

    It holds the true rate with at least this confidence for every rate and number of trials: the
    low end p solves P(X >= k | p) = 0.025, the high end P(X <= k | p) = 0.025. Both are quantiles
    of beta distributions.

    Source: Clopper and Pearson, Biometrika 26 (1934).
    """
    tail = (1.0 - CONFIDENCE) / 2.0
    failures = trials - successes
    low = float(special.betaincinv(successes, failures + 1, tail)) if successes else 0.0
    # The upper end of a rate is the lower end of its opposite, taken from 1.
    high = 1.0 - float(special.betaincinv(failures, successes + 1, tail)) if failures else 1.0
    return low, high


def mean_interval(values: ArrayLike) -> Interval:
    """Student's interval of a mean: m -/+ t s / sqrt(n), with n - 1 degrees of freedom.

    It trusts that the mean is close to normal, which a few hundred episodes make so even where the
    single outcomes are not. NaN for fewer than two values.
    """
    sample = np.asarray(values, dtype=np.float64)
    # A mean is a ratio, whose denominators are all 1.
    return ratio_interval(sample, np.ones_like(sample))


def ratio_interval(numerators: ArrayLike, denominators: ArrayLike) -> Interval:
    """Interval of sum(a) / sum(b), where an episode gives one pair (a, b).

    R -/+ t s(a - R b) / (mean(b) sqrt(n)): the delta method, with episodes as the independent
    units, because the goals or seconds inside one episode are not. NaN for fewer than two pairs or
    where the denominators sum to zero.

    Source: Cochran, Sampling Techniques (1977), section 6.4.
    """
    above = np.asarray(numerators, dtype=np.float64)
    below = np.asarray(denominators, dtype=np.float64)
    if above.size < 2 or below.sum() == 0.0:
        return nan, nan
    ratio = float(above.sum() / below.sum())
    spread = float((above - ratio * below).std(ddof=1) / below.mean())
    student = float(special.stdtrit(above.size - 1, (1.0 + CONFIDENCE) / 2.0))
    half = student * spread / sqrt(above.size)
    return ratio - half, ratio + half


def interval_to_json(interval: Interval) -> list[float] | None:
    """Both ends; null if the interval is not known."""
    return list(interval) if isfinite(interval[0]) else None


@dataclass(frozen=True)
class MeanDifference:
    """Mean difference of a quantity, second minus first."""

    value: float
    """In the quantity's unit."""
    interval: Interval
    """95 %, Student's over pairs; NaN for one pair."""

    def to_json(self) -> dict[str, Any]:
        """One object for JSON."""
        return {"difference": self.value, "interval": interval_to_json(self.interval)}


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
    """Mean of second minus first over n pairs, with Student's interval."""
    difference = np.subtract(second, first, dtype=np.float64)
    return MeanDifference(float(difference.mean()), mean_interval(difference))


def rate_difference(first: NDArray[np.bool_], second: NDArray[np.bool_]) -> RateDifference:
    """How much more often the second controller had an outcome, [n] each, and if that is chance."""
    only_second, only_first = int((second & ~first).sum()), int((first & ~second).sum())
    value = (only_second - only_first) / len(first)
    return RateDifference(value, only_second, only_first, mcnemar(only_second, only_first))


def mcnemar(only_first: int, only_second: int) -> float:
    """Exact two-sided p-value of McNemar's test on the counts of discordant pairs; 1 without any.

    Pairs with equal outcomes say nothing. If neither side is ahead, each discordant pair falls to
    either with 1/2, which is the binomial test.

    Source: McNemar, Psychometrika 12 (1947); Agresti, Categorical Data Analysis (2002), 10.1.
    """
    from scipy import stats

    total = only_first + only_second
    return float(stats.binomtest(only_first, total).pvalue) if total else 1.0
