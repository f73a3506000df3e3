"""95 % intervals: exact ones for rates, Student's for means, and for ratios of two sums.

Only numpy and the standard library, so that evaluating needs no scipy; the tests compare every
function here with scipy's.
"""

from collections.abc import Iterator
from math import exp, lgamma, log, log1p, nan, sqrt

import numpy as np
from numpy.typing import ArrayLike

Interval = tuple[float, float]

CONFIDENCE = 0.95
"""Share of repetitions in which an interval is to hold the true value."""

_TINY = 1e-300
"""Stands in for an exact zero in the continued fraction (Lentz)."""
_MAX_TERMS = 100_000
"""The fraction needs about sqrt(max(a, b)) terms: 1,000 for a million episodes."""


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
    low = beta_quantile(successes, failures + 1, tail) if successes else 0.0
    # The upper end of a rate is the lower end of its opposite, taken from 1.
    high = 1.0 - beta_quantile(failures, successes + 1, tail) if failures else 1.0
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
    half = student_quantile(sample.size - 1, confidence) * float(sample.std(ddof=1))
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
    half = student_quantile(above.size - 1, confidence) * spread / sqrt(above.size)
    return ratio - half, ratio + half


def student_quantile(degrees: int, confidence: float = CONFIDENCE) -> float:
    """The t with P(-t < T < t) = confidence, for Student's T with so many degrees of freedom.

    From P(|T| < t) = I_y(1/2, degrees / 2) at y = t^2 / (degrees + t^2). Source: Abramowitz and
    Stegun 26.7.1 and 26.5.27.
    """
    y = beta_quantile(0.5, degrees / 2.0, confidence)
    return sqrt(degrees * y / (1.0 - y))


def beta_quantile(a: float, b: float, share: float) -> float:
    """The x in (0, 1) with I_x(a, b) = share, by bisection down to neighbouring floats."""
    low, high = 0.0, 1.0
    while True:
        middle = (low + high) / 2.0
        if not low < middle < high:
            return middle
        if incomplete_beta(a, b, middle) < share:
            low = middle
        else:
            high = middle


def incomplete_beta(a: float, b: float, x: float) -> float:
    """The regularised incomplete beta function I_x(a, b), for 0 < x < 1.

    x^a (1 - x)^b / (a B(a, b)) times a continued fraction, which converges fast below
    (a + 1) / (a + b + 2); above it I_x(a, b) = 1 - I_(1-x)(b, a). Source: Abramowitz and Stegun
    26.5.8; evaluation by Lentz's method as in Numerical Recipes, section 6.4.
    """
    log_front = lgamma(a + b) - lgamma(a) - lgamma(b) + a * log(x) + b * log1p(-x)
    if x < (a + 1.0) / (a + b + 2.0):
        return exp(log_front) * _fraction(a, b, x) / a
    return 1.0 - exp(log_front) * _fraction(b, a, 1.0 - x) / b


def _fraction(a: float, b: float, x: float) -> float:
    """The continued fraction of the incomplete beta function, to the precision of floats."""
    c = 1.0
    d = 1.0 / _nonzero(1.0 - (a + b) * x / (a + 1.0))
    value = d
    for even, odd in _terms(a, b, x):
        for term in (even, odd):
            d = 1.0 / _nonzero(1.0 + term * d)
            c = _nonzero(1.0 + term / c)
            value *= c * d
        if abs(c * d - 1.0) < 1e-15:
            break
    return value


def _terms(a: float, b: float, x: float) -> Iterator[tuple[float, float]]:
    for m in range(1, _MAX_TERMS):
        end = a + 2 * m
        even = m * (b - m) * x / ((end - 1.0) * end)
        odd = -(a + m) * (a + b + m) * x / (end * (end + 1.0))
        yield even, odd


def _nonzero(value: float) -> float:
    return value if abs(value) > _TINY else _TINY
