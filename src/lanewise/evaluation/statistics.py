"""95 % intervals: exact ones for rates, Student's for means, and for ratios of two sums.

`scipy.special` alone: `scipy.stats` has the same quantiles, but takes three times as long to
import, and every test of a controller imports this module.
"""

from math import nan, sqrt

import numpy as np
from numpy.typing import ArrayLike
from scipy import special

Interval = tuple[float, float]

CONFIDENCE = 0.95
"""Share of repetitions in which an interval is to hold the true value."""


def clopper_pearson(successes: int, trials: int, confidence: float = CONFIDENCE) -> Interval:
    """Exact interval of a rate.

    It holds the true rate with at least the stated confidence for every rate and number of
    trials: the low end p solves P(X >= k | p) = (1 - confidence) / 2, the high end
    P(X <= k | p) = (1 - confidence) / 2. Both are quantiles of beta distributions.

    Source: Clopper and Pearson, Biometrika 26 (1934).

    Args:
        successes: k, how many trials had the outcome.
        trials: n, at least 1.
        confidence: between 0 and 1.

    Returns:
        Low and high end, fractions of 1.

    Raises:
        ValueError: if the counts are impossible.
    """
    if not 0 <= successes <= trials or trials < 1:
        raise ValueError(f"{successes} of {trials} is not a rate")
    tail = (1.0 - confidence) / 2.0
    failures = trials - successes
    low = float(special.betaincinv(successes, failures + 1, tail)) if successes else 0.0
    # The upper end of a rate is the lower end of its opposite, taken from 1.
    high = 1.0 - float(special.betaincinv(failures, successes + 1, tail)) if failures else 1.0
    return low, high


def mean_interval(values: ArrayLike, confidence: float = CONFIDENCE) -> Interval:
    """Student's interval of a mean: m -/+ t s / sqrt(n), with n - 1 degrees of freedom.

    The standard interval for independent episodes. It trusts that the mean is close to normal,
    which a few hundred episodes make so even where the single outcomes are not.

    Args:
        values: [n] one value an episode, in any unit.
        confidence: between 0 and 1.

    Returns:
        Low and high end, in the unit of the values; NaN for fewer than two values.
    """
    sample = np.asarray(values, dtype=np.float64)
    if sample.size < 2:
        return nan, nan
    mean = float(sample.mean())
    half = _student_quantile(sample.size - 1, confidence) * float(sample.std(ddof=1))
    return mean - half / sqrt(sample.size), mean + half / sqrt(sample.size)


def ratio_interval(
    numerators: ArrayLike, denominators: ArrayLike, confidence: float = CONFIDENCE
) -> Interval:
    """Interval of sum(a) / sum(b), where an episode gives one pair (a, b).

    R -/+ t s(a - R b) / (mean(b) sqrt(n)): the delta method, with episodes as the independent
    units, because the goals or seconds inside one episode are not.

    Source: Cochran, Sampling Techniques (1977), section 6.4.

    Args:
        numerators: [n].
        denominators: [n], not negative.
        confidence: between 0 and 1.

    Returns:
        Low and high end; NaN for fewer than two pairs or where the denominators sum to zero.
    """
    above = np.asarray(numerators, dtype=np.float64)
    below = np.asarray(denominators, dtype=np.float64)
    if above.size < 2 or below.sum() == 0.0:
        return nan, nan
    ratio = float(above.sum() / below.sum())
    spread = float((above - ratio * below).std(ddof=1) / below.mean())
    half = _student_quantile(above.size - 1, confidence) * spread / sqrt(above.size)
    return ratio - half, ratio + half


def _student_quantile(degrees: int, confidence: float) -> float:
    """The t with P(-t < T < t) = confidence, for Student's T."""
    return float(special.stdtrit(degrees, (1.0 + confidence) / 2.0))
