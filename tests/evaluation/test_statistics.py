"""Intervals equal scipy's tests, closed forms, and the published ones."""

import math

import numpy as np
import pytest
from scipy import stats

from lanewise.evaluation.statistics import clopper_pearson, mean_interval, ratio_interval


@pytest.mark.parametrize("trials", [1, 10, 300, 1_000_000])
@pytest.mark.parametrize("share", [0.0, 1e-5, 0.0233, 0.5, 1.0])
def test_exact_interval_equals_scipys(trials, share):
    successes = round(share * trials)
    expected = stats.binomtest(successes, trials).proportion_ci(0.95, method="exact")
    found = clopper_pearson(successes, trials)
    assert found == pytest.approx((expected.low, expected.high), abs=1e-9)


def test_published_intervals():
    assert [round(100 * end, 2) for end in clopper_pearson(7, 300)] == [0.94, 4.75]
    assert [round(100 * end, 2) for end in clopper_pearson(293, 300)] == [95.25, 99.06]


def test_ends_are_where_the_tails_are():
    low, high = clopper_pearson(7, 300)
    assert stats.binom.sf(6, 300, low) == pytest.approx(0.025, rel=1e-9)
    assert stats.binom.cdf(7, 300, high) == pytest.approx(0.025, rel=1e-9)
    # None and all, in closed form: (1 - p)^n = 0.025.
    assert clopper_pearson(0, 300) == pytest.approx((0.0, 1.0 - 0.025 ** (1 / 300)))
    assert clopper_pearson(300, 300) == pytest.approx((0.025 ** (1 / 300), 1.0))


@pytest.mark.parametrize(("successes", "trials"), [(-1, 10), (11, 10), (0, 0)])
def test_impossible_counts_are_refused(successes, trials):
    with pytest.raises(ValueError, match="is not a rate"):
        clopper_pearson(successes, trials)


@pytest.mark.parametrize("count", [2, 3, 40, 10_000])
@pytest.mark.parametrize("confidence", [0.5, 0.95])
def test_mean_interval_is_students(count, confidence):
    values = np.random.default_rng(0).normal(13.0, 2.0, count)
    expected = stats.t.interval(confidence, count - 1, values.mean(), stats.sem(values))
    assert mean_interval(values, confidence) == pytest.approx(expected, rel=1e-9)
    # With denominators of one a ratio is a mean.
    assert ratio_interval(values, np.ones(count), confidence) == pytest.approx(expected)


def test_ratio_interval_covers_about_as_often_as_it_says():
    rng = np.random.default_rng(0)
    held = 0
    for _ in range(400):
        below = rng.integers(1, 10, 60)
        above = rng.binomial(below, 0.3)
        low, high = ratio_interval(above, below)
        held += low <= 0.3 <= high
    assert 0.91 <= held / 400 <= 0.98


def test_of_one_value_or_nothing_there_is_no_interval():
    assert all(map(math.isnan, mean_interval([1.0])))
    assert all(map(math.isnan, ratio_interval([0.0, 0.0], [0.0, 0.0])))
