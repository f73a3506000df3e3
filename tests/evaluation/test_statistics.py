"""Intervals equal scipy's, and the published ones."""

import math

import numpy as np
import pytest
from scipy import special, stats

from lanewise.evaluation import statistics


@pytest.mark.parametrize("trials", [1, 2, 10, 300, 3_000, 1_000_000])
@pytest.mark.parametrize("share", [0.0, 1e-5, 0.0233, 0.5, 0.9767, 1.0])
def test_exact_interval_equals_scipys(trials, share):
    successes = round(share * trials)
    expected = stats.binomtest(successes, trials).proportion_ci(0.95, method="exact")
    assert statistics.clopper_pearson(successes, trials) == pytest.approx(
        (expected.low, expected.high), abs=1e-9
    )


def test_published_intervals():
    accidents = statistics.clopper_pearson(7, 300)
    successes = statistics.clopper_pearson(293, 300)
    assert [round(100 * end, 2) for end in accidents] == [0.94, 4.75]
    assert [round(100 * end, 2) for end in successes] == [95.25, 99.06]


def test_ends_are_where_the_tails_are():
    low, high = statistics.clopper_pearson(7, 300)
    assert stats.binom.sf(6, 300, low) == pytest.approx(0.025, rel=1e-9)
    assert stats.binom.cdf(7, 300, high) == pytest.approx(0.025, rel=1e-9)


def test_none_and_all_are_one_sided():
    assert statistics.clopper_pearson(0, 300)[0] == 0.0
    assert statistics.clopper_pearson(300, 300)[1] == 1.0


@pytest.mark.parametrize(("successes", "trials"), [(-1, 10), (11, 10), (0, 0)])
def test_impossible_counts_are_refused(successes, trials):
    with pytest.raises(ValueError, match="is not a rate"):
        statistics.clopper_pearson(successes, trials)


@pytest.mark.parametrize("degrees", [1, 2, 5, 29, 299, 9_999, 1_000_000])
@pytest.mark.parametrize("confidence", [0.5, 0.95, 0.999])
def test_student_quantile_equals_scipys(degrees, confidence):
    expected = stats.t.ppf((1 + confidence) / 2, degrees)
    assert statistics.student_quantile(degrees, confidence) == pytest.approx(expected, rel=1e-8)


def test_incomplete_beta_equals_scipys():
    rng = np.random.default_rng(0)
    for _ in range(300):
        a, b = np.exp(rng.uniform(-2, 8, 2))
        x = rng.uniform(1e-6, 1 - 1e-6)
        assert statistics.incomplete_beta(a, b, x) == pytest.approx(
            special.betainc(a, b, x), abs=1e-10
        )


def test_mean_interval_equals_scipys():
    values = np.random.default_rng(0).normal(13.0, 2.0, 40)
    expected = stats.t.interval(0.95, 39, values.mean(), stats.sem(values))
    assert statistics.mean_interval(values) == pytest.approx(expected, rel=1e-9)


def test_mean_interval_of_one_value_is_unknown():
    assert all(map(math.isnan, statistics.mean_interval([1.0])))


def test_ratio_interval_is_the_means_when_denominators_are_one():
    values = np.random.default_rng(0).normal(size=30)
    assert statistics.ratio_interval(values, np.ones(30)) == pytest.approx(
        statistics.mean_interval(values)
    )


def test_ratio_interval_covers_about_as_often_as_it_says():
    rng = np.random.default_rng(0)
    held = 0
    for _ in range(400):
        below = rng.integers(1, 10, 60)
        above = rng.binomial(below, 0.3)
        low, high = statistics.ratio_interval(above, below)
        held += low <= 0.3 <= high
    assert 0.91 <= held / 400 <= 0.98


def test_ratio_of_nothing_is_unknown():
    assert all(map(math.isnan, statistics.ratio_interval([0.0, 0.0], [0.0, 0.0])))
