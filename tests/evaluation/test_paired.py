"""Paired differences equal scipy's, and small ones are worked out by hand."""

import json
import math

import numpy as np
import pytest
from scipy import stats

from lanewise.evaluation import paired


@pytest.mark.parametrize("only_first", [0, 2, 49, 50, 293])
@pytest.mark.parametrize("only_second", [0, 3, 50, 300])
def test_mcnemar_is_the_exact_binomial_sum(only_first, only_second):
    """min(1, 2 P(X <= min(b, c))) with X binomial(b + c, 1/2), summed term by term."""
    fewer, total = min(only_first, only_second), only_first + only_second
    tail = sum(math.comb(total, k) for k in range(fewer + 1)) / 2**total
    found = paired.mcnemar(only_first, only_second)
    assert found == pytest.approx(min(1.0, 2.0 * tail), rel=1e-7)


def test_mcnemar_by_hand():
    assert paired.mcnemar(0, 5) == pytest.approx(2 / 32)
    assert paired.mcnemar(1, 4) == pytest.approx(2 * 6 / 32)
    assert paired.mcnemar(7, 7) == paired.mcnemar(0, 0) == paired.mcnemar(1, 0) == 1.0


def test_mcnemar_of_a_million_is_quick_and_finite():
    assert 0.0 <= paired.mcnemar(500_000, 502_000) < 0.05


def test_rate_difference_counts_discordant_pairs():
    first = np.array([True, True, False, False, False])
    second = np.array([True, False, True, True, False])
    found = paired.rate_difference(first, second)
    assert (found.only_first, found.only_second) == (1, 2)
    assert found.value == pytest.approx(second.mean() - first.mean())
    assert found.p_value == 1.0
    assert json.loads(json.dumps(found.to_json()))["only_this"] == 2


def test_mean_difference_is_the_paired_t_test():
    rng = np.random.default_rng(0)
    start = rng.normal(0.0, 5.0, 60)
    first, second = start + rng.normal(0.0, 1.0, 60), start + rng.normal(0.4, 1.0, 60)
    found = paired.mean_difference(first, second)
    expected = stats.ttest_rel(second, first)
    assert found.value == pytest.approx(second.mean() - first.mean())
    assert found.interval == pytest.approx(tuple(expected.confidence_interval(0.95)), rel=1e-9)


def test_one_pair_has_no_interval():
    found = paired.mean_difference([1.0], [3.0])
    assert found.value == 2.0
    assert all(map(math.isnan, found.interval))
    assert found.to_json() == {"difference": 2.0, "interval": None}


@pytest.mark.parametrize("compare", [paired.mean_difference, paired.rate_difference])
@pytest.mark.parametrize(("first", "second"), [([], []), ([1], [1, 0]), ([[1]], [[1]])])
def test_what_is_no_pair_is_refused(compare, first, second):
    with pytest.raises(ValueError, match="are not pairs"):
        compare(first, second)
