"""Intervals and paired tests equal scipy's and closed forms."""

import math

import numpy as np
import pytest
from scipy import stats

from lanewise.evaluation.statistics import (
    clopper_pearson,
    mcnemar,
    mean_difference,
    mean_interval,
    rate_difference,
    ratio_interval,
)


@pytest.mark.parametrize("trials", [1, 300, 1_000_000])
@pytest.mark.parametrize("share", [0.0, 1e-5, 0.0233, 1.0])
def test_exact_interval_equals_scipys(trials, share):
    successes = round(share * trials)
    expected = stats.binomtest(successes, trials).proportion_ci(0.95, method="exact")
    found = clopper_pearson(successes, trials)
    assert found == pytest.approx((expected.low, expected.high), abs=1e-9)


@pytest.mark.parametrize("count", [2, 3, 10_000])
def test_mean_interval_is_students(count):
    values = np.random.default_rng(0).normal(13.0, 2.0, count)
    expected = stats.t.interval(0.95, count - 1, values.mean(), stats.sem(values))
    assert mean_interval(values) == pytest.approx(expected, rel=1e-9)


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
    found = mean_difference([1.0], [3.0])
    assert found.to_json() == {"difference": 2.0, "interval": None}


def test_mcnemar_is_the_exact_binomial_sum():
    """min(1, 2 P(X <= min(b, c))) with X binomial(b + c, 1/2), summed term by term."""
    for fewer, more in ((0, 0), (0, 5), (2, 3), (49, 50), (293, 300)):
        tail = sum(math.comb(fewer + more, k) for k in range(fewer + 1)) / 2 ** (fewer + more)
        assert mcnemar(fewer, more) == pytest.approx(min(1.0, 2.0 * tail), rel=1e-7)
        assert mcnemar(more, fewer) == mcnemar(fewer, more)


def test_rate_difference_counts_discordant_pairs():
    first = np.array([True, True, False, False, False])
    second = np.array([True, False, True, True, False])
    found = rate_difference(first, second)
    assert found.value == pytest.approx(second.mean() - first.mean())
    expected = {"difference": found.value, "only_this": 2, "only_first": 1, "p_value": 1.0}
    assert found.to_json() == expected


def test_mean_difference_is_the_paired_t_test():
    rng = np.random.default_rng(0)
    start = rng.normal(0.0, 5.0, 60)
    first, second = start + rng.normal(0.0, 1.0, 60), start + rng.normal(0.4, 1.0, 60)
    found = mean_difference(first, second)
    expected = stats.ttest_rel(second, first)
    assert found.value == pytest.approx(second.mean() - first.mean())
    assert found.interval == pytest.approx(tuple(expected.confidence_interval(0.95)), rel=1e-9)
