"""A comparison is made of the metrics, paired differences and aggregates, by the right runs."""

import dataclasses
import math

import pytest

from fabricate import make_episodes
from lanewise.errors import LanewiseError
from lanewise.evaluation import statistics
from lanewise.evaluation.aggregates import estimate, interquartile_mean
from lanewise.evaluation.comparison import Entry, arm_members, compare

RUNS = [
    Entry("a1", "hierarchical", 1, "x"),
    Entry("b0", "single-level", 0, "x"),
    Entry("a0", "hierarchical", 0, "x"),
    Entry("c0", "hierarchical", 0, "y"),
    Entry("c7", "hierarchical", 7, "y"),
]
EPISODES = [
    make_episodes(successes, 40, seed, faster)
    for seed, (successes, faster) in enumerate(
        [(36, 1.0), (0, 0.0), (38, 1.0), (20, 0.0), (24, 0.0)]
    )
]


@pytest.fixture(scope="module")
def found():
    return compare(RUNS, EPISODES, "lanewise")


def test_arms_are_runs_that_differ_in_seed_alone(found):
    assert [(arm.controller, arm.runs, arm.seeds) for arm in found.arms] == [
        ("hierarchical", (2, 0), (0, 1)),
        ("single-level", (1,), (0,)),
        ("hierarchical", (3, 4), (0, 7)),
    ]
    assert found.has_seeds


def test_arms_keep_the_value_of_every_seed(found):
    assert found.arms[0].values["success_rate"] == (38 / 40, 36 / 40)
    for arm in found.arms:
        for name, values in arm.values.items():
            assert values == tuple(found.summaries[run].values[name] for run in arm.runs)
            kept, expected = arm.interquartile_mean[name], estimate(interquartile_mean, values)
            assert kept.value == expected.value
            assert kept.interval == pytest.approx(expected.interval, nan_ok=True)
            assert math.isnan(kept.interval[0]) or len(arm.runs) > 1


def test_differences_are_to_the_first_run(found):
    assert len(found.differences) == 4
    rate = found.differences[0]["success_rate"]
    assert (rate.only_second, rate.only_first, rate.value) == (0, 36, -0.9)
    rate = found.differences[0]["accident_rate"]
    assert (rate.only_second, rate.only_first) == (36, 0)
    speeds = (EPISODES[0].average_speed, EPISODES[2].average_speed)
    assert found.differences[1]["average_speed"] == statistics.mean_difference(*speeds)


def test_improvement_is_by_the_better_way_of_each_metric(found):
    assert [(each.arm, each.over) for each in found.improvements] == [(1, 0), (2, 0), (2, 1)]
    over_flat = found.improvements[2].probability
    # Successes 20 and 24 of 40 against none; accidents the other way round, both better.
    assert over_flat["success_rate"].value == over_flat["accident_rate"].value == 1.0
    under_first = found.improvements[1].probability
    assert under_first["success_rate"].value == under_first["accident_rate"].value == 0.0
    assert under_first["average_speed"].value == 0.0


def test_without_repeated_seeds_nothing_is_said_about_arms():
    found = compare(RUNS[1:4], EPISODES[1:4], "lanewise")
    assert not found.has_seeds
    assert found.improvements == ()
    assert len(found.arms) == 3


def test_what_cannot_be_compared_is_refused():
    with pytest.raises(LanewiseError, match="a1 and again are the same run twice: hierarchical"):
        arm_members([*RUNS, dataclasses.replace(RUNS[0], name="again")])
    with pytest.raises(LanewiseError, match="at least two runs, got 1"):
        compare(RUNS[:1], EPISODES[:1], "lanewise")
