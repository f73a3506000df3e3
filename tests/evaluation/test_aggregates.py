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

from lanewise.evaluation import aggregates

REFERENCE = json.loads(Path(__file__).with_name("rliable_reference.json").read_text())
"""Made by `rliable_reference.py`, which says how to make it anew."""

SCORES = st.lists(st.integers(-50, 50).map(float), min_size=1, max_size=12)


def tolerance(name, interval):
    """Both are random. Rounded scores make a lumpy bootstrap, whose quantile may jump a lump."""
    return (0.1 if "rounded" in name else 0.05) * (interval[1] - interval[0])


@pytest.mark.parametrize("name", REFERENCE["interquartile_mean"])
def test_interquartile_mean_is_rliables(name):
    table, expected = REFERENCE["tables"][name], REFERENCE["interquartile_mean"][name]
    assert aggregates.interquartile_mean(table) == pytest.approx(expected["value"], rel=1e-12)
    found = aggregates.interquartile_interval(table)
    within = tolerance(name, expected["interval"])
    assert found == pytest.approx(expected["interval"], abs=within)


@pytest.mark.parametrize("case", REFERENCE["probability_of_improvement"], ids=lambda c: c["scores"])
def test_probability_of_improvement_is_rliables(case):
    tables = [REFERENCE["tables"][case[name]] for name in ("scores", "others")]
    found = aggregates.probability_of_improvement(*tables)
    assert found == pytest.approx(case["value"], rel=1e-12)
    within = tolerance(case["scores"], case["interval"])
    assert aggregates.improvement_interval(*tables) == pytest.approx(case["interval"], abs=within)


def test_reference_has_ties_and_real_scores():
    tables = REFERENCE["tables"]
    assert set(np.ravel(tables["rounded, 6 seeds"])) & set(np.ravel(tables["rounded, 4 seeds"]))
    assert len(tables["quick.json, both worlds"]) == 10
    assert REFERENCE["origin"]["versions"]["rliable"] == "1.2.0"


@pytest.mark.parametrize(
    ("scores", "expected"),
    [
        ([7.0], 7.0),
        ([1.0, 2.0, 9.0], 4.0),  # fewer than 4: the mean
        ([-100.0, 1.0, 3.0, 100.0], 2.0),
        ([5.0, 1.0, 2.0, -9.0, 90.0], 8.0 / 3.0),
        ([[0.0, 8.0], [1.0, 7.0], [2.0, 6.0], [3.0, 50.0]], 4.5),  # pooled: 2, 3, 6, 7
        (range(12), 5.5),
    ],
)
def test_interquartile_mean_by_hand(scores, expected):
    assert aggregates.interquartile_mean(scores) == pytest.approx(expected)


@given(SCORES)
def test_interquartile_mean_is_scipys_and_ignores_order(scores):
    found = aggregates.interquartile_mean(scores)
    assert found == pytest.approx(stats.trim_mean(scores, 0.25))
    assert found == aggregates.interquartile_mean(scores[::-1])
    assert min(scores) <= found <= max(scores)


@pytest.mark.parametrize(
    ("scores", "others", "expected"),
    [
        ([2.0, 3.0], [1.0], 1.0),
        ([1.0], [1.0], 0.5),
        ([1.0, 2.0], [1.0, 2.0], 0.5),
        ([1.0, 2.0, 3.0], [2.0], 0.5),
        ([2.0, 2.0], [1.0, 2.0, 3.0], 0.5),
        ([1.0, 4.0], [1.0, 2.0], 0.625),  # 1 ties 1, 1 loses to 2, 4 wins twice
        ([[1.0, 0.0]], [[0.0, 0.0]], 0.75),  # wins one task, ties the other
    ],
)
def test_probability_of_improvement_by_hand(scores, others, expected):
    assert aggregates.probability_of_improvement(scores, others) == pytest.approx(expected)


@given(SCORES, SCORES)
def test_probability_of_improvement_is_mann_whitneys(scores, others):
    found = aggregates.probability_of_improvement(scores, others)
    statistic = stats.mannwhitneyu(scores, others, method="asymptotic").statistic
    assert found == pytest.approx(statistic / (len(scores) * len(others)))
    assert found + aggregates.probability_of_improvement(others, scores) == pytest.approx(1.0)


def test_interval_is_the_enumerated_bootstraps():
    scores = [1.0, 2.5, 3.0, 7.0, 11.0]
    every = [aggregates.interquartile_mean(list(x)) for x in itertools.product(scores, repeat=5)]
    assert len(every) == 5**5
    expected = np.quantile(every, (0.025, 0.975))
    found = aggregates.interquartile_interval(scores, resamples=50_000)
    assert found == pytest.approx(tuple(expected), abs=0.2)


def test_improvement_interval_is_the_enumerated_bootstraps():
    scores, others = [1.0, 3.0, 4.0], [0.0, 2.0, 3.0, 5.0]
    every = [
        aggregates.probability_of_improvement(list(x), list(y))
        for x in itertools.product(scores, repeat=3)
        for y in itertools.product(others, repeat=4)
    ]
    expected = np.quantile(every, (0.025, 0.975))
    assert aggregates.improvement_interval(scores, others) == pytest.approx(expected, abs=0.03)


def test_strata_are_resampled_apart():
    # Were seeds drawn across tasks, the far task's level would leak into the spread.
    rng = np.random.default_rng(0)
    near, far = rng.normal(0.0, 1.0, (8, 1)), rng.normal(1000.0, 1.0, (8, 1))

    def mean(scores):
        return scores.mean(axis=(-2, -1))

    low, high = aggregates.bootstrap_interval(mean, np.hstack([near, far]))
    assert high - low < 2.0


def test_same_seeds_are_as_uncertain_as_one_task():
    scores = np.random.default_rng(0).normal(size=(10, 1))
    repeated = np.repeat(scores, 4, axis=1)
    alone, together, apart = (
        np.diff(aggregates.interquartile_interval(table, same_seeds=same))[0]
        for table, same in ((scores, False), (repeated, True), (repeated, False))
    )
    assert together == pytest.approx(alone, rel=0.1)
    assert apart == pytest.approx(alone / 2.0, rel=0.2)


def test_the_same_seed_gives_the_same_interval():
    scores = np.random.default_rng(0).normal(size=7)
    first = aggregates.interquartile_interval(scores, seed=3)
    assert first == aggregates.interquartile_interval(scores, seed=3)
    assert first != aggregates.interquartile_interval(scores, seed=4)


def test_resamples_need_not_fill_blocks():
    def count(scores):
        sizes.append(len(scores))
        return scores.mean(axis=(-2, -1))

    sizes = []
    aggregates.bootstrap_interval(count, [1.0, 2.0], resamples=2_300)
    assert sizes == [1_000, 1_000, 300]


@pytest.mark.parametrize("scores", [[3.0], [[3.0, 4.0]], [3.0, 3.0, 3.0], [[3.0, 4.0]] * 5])
def test_one_seed_or_equal_seeds_have_no_interval(scores):
    assert math.isfinite(aggregates.interquartile_mean(scores))
    assert all(map(math.isnan, aggregates.interquartile_interval(scores)))


def test_improvement_without_spread_has_no_interval():
    assert all(map(math.isnan, aggregates.improvement_interval([1.0], [2.0, 3.0, 4.0])))
    assert aggregates.probability_of_improvement([5.0, 6.0], [1.0, 2.0]) == 1.0
    assert all(map(math.isnan, aggregates.improvement_interval([5.0, 6.0], [1.0, 2.0])))


@pytest.mark.parametrize(("scores", "message"), [([], "shape"), ([1.0, math.nan], "not finite")])
def test_impossible_scores_are_refused(scores, message):
    with pytest.raises(ValueError, match=message):
        aggregates.interquartile_mean(scores)
    with pytest.raises(ValueError, match=message):
        aggregates.interquartile_interval(scores)


def test_arms_of_other_tasks_are_refused():
    with pytest.raises(ValueError, match="1 tasks cannot be paired with 2"):
        aggregates.probability_of_improvement([1.0, 2.0], [[1.0, 2.0]])


@settings(deadline=None, max_examples=25)
@given(st.lists(st.integers(-5, 5).map(float), min_size=2, max_size=6))
def test_interval_lies_within_the_scores(scores):
    low, high = aggregates.interquartile_interval(scores, resamples=200)
    assert math.isnan(low) or min(scores) <= low < high <= max(scores)


def about(share, repetitions):
    """Four standard errors of a simulation, and the coarseness of fewer resamples."""
    error = math.sqrt(share * (1.0 - share) / repetitions)
    return pytest.approx(share, abs=4.0 * error + 0.01)


@pytest.mark.parametrize(("seeds", "share"), [(2, 0.50), (3, 0.76), (5, 0.91), (10, 0.94)])
def test_coverage_is_what_the_module_says(seeds, share):
    rng = np.random.default_rng(0)
    held = 0
    for repetition in range(600):
        scores = rng.normal(5.0, 2.0, seeds)
        low, high = aggregates.interquartile_interval(scores, seed=repetition, resamples=400)
        held += low <= 5.0 <= high
    assert held / 600 == about(share, 600)


@pytest.mark.parametrize(("shift", "share"), [(0.0, 0.92), (2.0, 0.62)])
def test_coverage_of_improvement_is_what_the_module_says(shift, share):
    truth = stats.norm.cdf(shift / math.sqrt(2.0))
    rng = np.random.default_rng(0)
    held = 0
    for repetition in range(400):
        scores, others = rng.normal(shift, 1.0, 5), rng.normal(0.0, 1.0, 5)
        low, high = aggregates.improvement_interval(scores, others, seed=repetition, resamples=400)
        # Arms that do not overlap have no interval, which holds nothing.
        held += low <= truth <= high
    assert held / 400 == about(share, 400)
