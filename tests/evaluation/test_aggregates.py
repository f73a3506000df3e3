"""Aggregates over seeds equal rliable's and closed forms."""

import json
import math
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import stats

from lanewise.evaluation.aggregates import (
    estimate,
    interquartile_mean,
    probability_of_improvement,
)

REFERENCE = json.loads(Path(__file__).with_name("rliable_reference.json").read_text())
"""Made by `rliable_reference.py`, which says how to make it anew."""

SCORES = st.lists(st.integers(-50, 50).map(float), min_size=1, max_size=12)

STATISTICS = {1: interquartile_mean, 2: probability_of_improvement}
"""By number of arms."""


def value_of(*arms):
    """Without a bootstrap worth the name."""
    return estimate(STATISTICS[len(arms)], *arms, resamples=2).value


@pytest.mark.parametrize("case", REFERENCE["cases"], ids=lambda case: " over ".join(case["arms"]))
def test_statistics_and_intervals_are_rliables(case):
    """Both bootstraps are random. Rounded scores make a lumpy one: quantiles may jump a lump."""
    arms = [REFERENCE["scores"][name] for name in case["arms"]]
    found = estimate(STATISTICS[len(arms)], *arms)
    assert found.value == pytest.approx(case["value"], rel=1e-12)
    low, high = case["interval"]
    within = (0.1 if "rounded" in case["arms"][0] else 0.05) * (high - low)
    assert found.interval == pytest.approx((low, high), abs=within)


@pytest.mark.parametrize(
    ("arms", "expected"),
    [
        (([7.0],), 7.0),
        (([1.0, 2.0, 9.0],), 4.0),  # fewer than 4: the mean
        (([5.0, 1.0, 2.0, -9.0, 90.0],), 8.0 / 3.0),
        (([2.0, 3.0], [1.0]), 1.0),
        (([1.0, 4.0], [1.0, 2.0]), 0.625),  # 1 ties 1, 1 loses to 2, 4 wins twice
    ],
)
def test_statistics_by_hand(arms, expected):
    assert value_of(*arms) == pytest.approx(expected)


@settings(deadline=None, max_examples=50)
@given(SCORES, SCORES)
def test_probability_of_improvement_is_mann_whitneys(scores, others):
    found = value_of(scores, others)
    statistic = stats.mannwhitneyu(scores, others, method="asymptotic").statistic
    assert found == pytest.approx(statistic / (len(scores) * len(others)))
    assert found + value_of(others, scores) == pytest.approx(1.0)


def test_the_same_seed_gives_the_same_interval():
    scores = np.random.default_rng(0).normal(size=30)
    first, again, other = (
        estimate(interquartile_mean, scores, seed=seed, resamples=100) for seed in (3, 3, 4)
    )
    assert first == again != other


@pytest.mark.parametrize(
    "arms",
    [
        ([3.0],),
        ([3.0, 3.0, 3.0],),
        ([1.0], [2.0, 3.0, 4.0]),
        ([5.0, 6.0], [1.0, 2.0]),  # ahead in every resample
    ],
)
def test_one_seed_or_no_spread_has_no_interval(arms):
    found = estimate(STATISTICS[len(arms)], *arms)
    assert math.isfinite(found.value)
    assert all(map(math.isnan, found.interval))
    assert found.to_json() == {"value": found.value, "interval": None}


def about(share, repetitions):
    """Four standard errors of a simulation, and the coarseness of fewer resamples."""
    error = math.sqrt(share * (1.0 - share) / repetitions)
    return pytest.approx(share, abs=4.0 * error + 0.01)


SIMULATED = [(0.0, 3, 0.76), (2.0, 5, 0.62)]
SLOW = [(0.0, 2, 0.5), (0.0, 10, 0.94), (0.01, 5, 0.92)]


@pytest.mark.parametrize(
    ("shift", "seeds", "share"),
    [*SIMULATED, *(pytest.param(*each, marks=pytest.mark.slow) for each in SLOW)],
)
def test_coverage_is_what_the_module_says(shift, seeds, share):
    """Of the interquartile mean of one arm, or of how it improves on one that is shifted."""
    rng = np.random.default_rng(0)
    held = 0
    for repetition in range(500):
        arms = [rng.normal(shift, 1.0, seeds)]
        statistic, truth = interquartile_mean, shift
        if shift:
            arms.append(rng.normal(0.0, 1.0, seeds))
            statistic = probability_of_improvement
            truth = stats.norm.cdf(shift / math.sqrt(2.0))
        low, high = estimate(statistic, *arms, seed=repetition, resamples=400).interval
        # Arms that do not overlap have no interval, which holds nothing.
        held += low <= truth <= high
    assert held / 500 == about(share, 500)
