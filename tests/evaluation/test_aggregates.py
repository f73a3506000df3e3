"""Aggregates over seeds equal rliable's, closed forms and enumerated bootstraps."""

import itertools
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


def value_of(statistic, *arms):
    """Without a bootstrap worth the name."""
    return estimate(statistic, *arms, resamples=2).value


CASES = [
    (interquartile_mean, [name], expected)
    for name, expected in REFERENCE["interquartile_mean"].items()
] + [
    (probability_of_improvement, [case["scores"], case["others"]], case)
    for case in REFERENCE["probability_of_improvement"]
]


@pytest.mark.parametrize(("statistic", "names", "expected"), CASES)
def test_statistics_and_intervals_are_rliables(statistic, names, expected):
    """Both bootstraps are random. Rounded scores make a lumpy one: quantiles may jump a lump."""
    found = estimate(statistic, *(REFERENCE["tables"][name] for name in names))
    assert found.value == pytest.approx(expected["value"], rel=1e-12)
    low, high = expected["interval"]
    within = (0.1 if "rounded" in names[0] else 0.05) * (high - low)
    assert found.interval == pytest.approx((low, high), abs=within)


@pytest.mark.parametrize(
    ("arms", "expected"),
    [
        (([7.0],), 7.0),
        (([1.0, 2.0, 9.0],), 4.0),  # fewer than 4: the mean
        (([5.0, 1.0, 2.0, -9.0, 90.0],), 8.0 / 3.0),
        (([[0.0, 8.0], [1.0, 7.0], [2.0, 6.0], [3.0, 50.0]],), 4.5),  # pooled: 2, 3, 6, 7
        (([2.0, 3.0], [1.0]), 1.0),
        (([1.0, 4.0], [1.0, 2.0]), 0.625),  # 1 ties 1, 1 loses to 2, 4 wins twice
        (([[1.0, 0.0]], [[0.0, 0.0]]), 0.75),  # wins one task, ties the other
    ],
)
def test_statistics_by_hand(arms, expected):
    statistic = interquartile_mean if len(arms) == 1 else probability_of_improvement
    assert value_of(statistic, *arms) == pytest.approx(expected)


@settings(deadline=None, max_examples=50)
@given(SCORES, SCORES)
def test_probability_of_improvement_is_mann_whitneys(scores, others):
    found = value_of(probability_of_improvement, scores, others)
    statistic = stats.mannwhitneyu(scores, others, method="asymptotic").statistic
    assert found == pytest.approx(statistic / (len(scores) * len(others)))
    assert found + value_of(probability_of_improvement, others, scores) == pytest.approx(1.0)


def test_intervals_are_the_enumerated_bootstraps():
    scores, others = [1.0, 2.5, 3.0, 7.0, 11.0], [0.0, 2.0, 3.0]
    draws = np.array(list(itertools.product(scores, repeat=5)))[..., None]
    expected = np.quantile(interquartile_mean(draws), (0.025, 0.975))
    found = estimate(interquartile_mean, scores, resamples=50_000)
    assert found.interval == pytest.approx(tuple(expected), abs=0.2)
    every = [
        probability_of_improvement(np.array(x)[:, None], np.array(y)[:, None])
        for x in itertools.product(scores[:3], repeat=3)
        for y in itertools.product(others, repeat=3)
    ]
    expected = np.quantile(every, (0.025, 0.975))
    found = estimate(probability_of_improvement, scores[:3], others)
    assert found.interval == pytest.approx(tuple(expected), abs=0.03)


def test_strata_are_resampled_apart():
    """Four copies of a task are as good as four tasks: half as uncertain."""
    scores = np.random.default_rng(0).normal(size=(10, 1))
    alone, apart = (
        np.diff(estimate(interquartile_mean, np.repeat(scores, copies, axis=1)).interval)[0]
        for copies in (1, 4)
    )
    assert apart == pytest.approx(alone / 2.0, rel=0.2)


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
        ([[3.0, 4.0]],),
        ([3.0, 3.0, 3.0],),
        ([1.0], [2.0, 3.0, 4.0]),
        ([5.0, 6.0], [1.0, 2.0]),  # ahead in every resample
    ],
)
def test_one_seed_or_no_spread_has_no_interval(arms):
    found = estimate(interquartile_mean if len(arms) == 1 else probability_of_improvement, *arms)
    assert math.isfinite(found.value)
    assert all(map(math.isnan, found.interval))
    assert found.to_json() == {"value": found.value, "interval": None}


@pytest.mark.parametrize(("scores", "message"), [([], "shape"), ([1.0, math.nan], "not finite")])
def test_impossible_scores_are_refused(scores, message):
    with pytest.raises(ValueError, match=message):
        estimate(interquartile_mean, scores)
    with pytest.raises(ValueError, match="1 tasks cannot be paired with 2"):
        value_of(probability_of_improvement, [1.0, 2.0], [[1.0, 2.0]])


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
