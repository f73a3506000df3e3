"""Each metric on episodes small enough to work out by hand."""

import csv
import dataclasses
import io
import json
import math

import numpy as np
import pytest

from lanewise.errors import LanewiseError
from lanewise.evaluation import metrics
from lanewise.evaluation.episodes import Episodes

FOUR = Episodes(
    success=np.array([True, True, False, False]),
    accident=np.array([0, 0, 1, 3], np.int8),
    accumulated_reward=np.array([12.0, 14.0, -8.0, -6.0]),
    average_speed=np.array([13.0, 14.0, 10.0, 7.0]),
    travel_distance=np.array([325.0, 350.0, 50.0, 35.0]),
    duration=np.array([25.0, 25.0, 5.0, 5.0]),
    escape_time=np.array([14.0, 16.0, np.nan, np.nan]),
    goals=np.array([10, 6, 2, 2]),
    goals_timed_out=np.array([1, 3, 1, 0]),
)


def first(count: int) -> Episodes:
    fields = {f.name: getattr(FOUR, f.name)[:count] for f in dataclasses.fields(FOUR)}
    return Episodes(**fields)


@pytest.fixture
def summary() -> metrics.Summary:
    return metrics.summarise(FOUR, controller="hierarchical", world="lanewise")


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("escape_rate", 0.5),
        ("success_rate", 0.5),
        ("accident_rate", 0.5),
        ("accumulated_reward", 3.0),
        ("average_speed", 11.0),
        ("travel_distance", 190.0),
        ("reward_per_second", 12.0 / 60.0),
        ("escape_time", 15.0),
        ("goal_time_out_rate", 0.25),
    ],
)
def test_values(summary, name, value):
    assert summary.values[name] == pytest.approx(value)
    low, high = summary.intervals[name]
    assert low < value < high


def test_no_accident_is_no_success():
    """An episode may end in neither: the ego just stays behind the trap."""
    behind = dataclasses.replace(FOUR, success=np.array([True, False, False, False]))
    found = metrics.summarise(behind, controller="hierarchical", world="lanewise").values
    assert (found["success_rate"], found["accident_rate"]) == (0.25, 0.5)


def test_who_passes_the_trap_and_then_crashes_has_the_papers_success_and_not_ours():
    later = dataclasses.replace(FOUR, escape_time=np.array([14.0, 16.0, 3.0, np.nan]))
    assert later.escaped.tolist() == [True, True, True, False]
    found = metrics.summarise(later, controller="hierarchical", world="lanewise")
    assert (found.values["escape_rate"], found.values["success_rate"]) == (0.75, 0.5)
    # Clopper and Pearson's for 3 of 4, from tables.
    assert found.intervals["escape_rate"] == pytest.approx((0.1941, 0.9937), abs=1e-4)


def test_every_metric_is_computed_and_explained(summary):
    assert list(summary.values) == [metric.name for metric in metrics.METRICS]
    assert all(metric.meaning and metric.title for metric in metrics.METRICS)


def test_accidents_are_counted_by_cause(summary):
    assert summary.accidents == {"collision": 1, "off_road": 0, "stopped": 1}


def test_json_round_trip(summary):
    stored = json.loads(json.dumps(summary.to_json(), allow_nan=False))
    again = metrics.Summary.from_json(stored)
    assert again == summary
    assert {"controller", "world", "episodes", "accidents", "intervals"} <= set(stored)
    assert stored["success_rate"] == 0.5


def test_one_episode_without_goals_or_escape_has_no_nan_in_json():
    nothing = dataclasses.replace(
        first(1),
        escape_time=np.array([np.nan]),
        goals=np.array([0]),
        goals_timed_out=np.array([0]),
    )
    stored = metrics.summarise(nothing, controller="single-level", world="lanewise").to_json()
    json.dumps(stored, allow_nan=False)
    assert stored["escape_time"] is None
    assert stored["goal_time_out_rate"] is None
    assert set(stored["intervals"]) == {"escape_rate", "success_rate", "accident_rate"}
    assert math.isnan(metrics.Summary.from_json(stored).values["escape_time"])


def test_a_summary_from_before_both_successes_is_read_without_the_papers(summary):
    stored = summary.to_json()
    del stored["escape_rate"], stored["intervals"]["escape_rate"]
    again = metrics.Summary.from_json(stored)
    assert "escape_rate" not in again.values
    assert again.to_json() == stored


def test_no_episode_is_refused():
    with pytest.raises(LanewiseError, match="no test episode"):
        metrics.summarise(first(0), controller="single-level", world="lanewise")


def test_published_table():
    """The published success is by the paper's own definition, in training too."""
    assert metrics.PUBLISHED["single-level"] == {
        "escape_rate": 0.0,
        "accident_rate": 0.0,
        "accumulated_reward": 3.32,
        "average_speed": 10.29,
        "travel_distance": 257.29,
    }
    assert metrics.PUBLISHED["hierarchical"] == {
        "escape_rate": 0.9767,
        "accident_rate": 0.0233,
        "accumulated_reward": 13.20,
        "average_speed": 13.42,
        "travel_distance": 331.60,
    }
    assert {name: of["escaped"] for name, of in metrics.PUBLISHED_TRAINING.items()} == {
        "single-level": 0.0,
        "hierarchical": 0.6,
    }
    assert not any("success" in of for of in metrics.PUBLISHED_TRAINING.values())


def test_published_interval():
    interval = metrics.published_interval("hierarchical", "accident_rate")
    assert interval == pytest.approx((0.0094, 0.0475), abs=5e-5)
    assert metrics.published_interval("hierarchical", "average_speed") is None
    assert metrics.published_interval("hierarchical", "success_rate") is None
    assert metrics.published_interval("other", "escape_rate") is None


def test_paired_finds_each_difference():
    other = dataclasses.replace(
        FOUR,
        success=np.array([True, False, False, False]),
        accident=np.array([0, 0, 1, 1], np.int8),
    )
    pair = metrics.paired(FOUR, other)
    assert pair.differing == (1, 3)
    assert pair.share == 0.5
    assert json.loads(json.dumps(pair.to_json()))["identical"] == 2


def test_paired_compares_the_common_starts():
    assert metrics.paired(FOUR, first(3)) == metrics.Paired(3, ())
    with pytest.raises(LanewiseError, match="no pair"):
        metrics.paired(FOUR, first(0))


def test_csv_has_one_row_an_episode_in_full():
    rows = list(csv.DictReader(io.StringIO(metrics.to_csv(FOUR))))
    assert len(rows) == 4
    assert [row["accident"] for row in rows] == ["none", "none", "collision", "stopped"]
    assert rows[2]["escape_time"] == ""
    assert float(rows[1]["travel_distance"]) == 350.0
    assert rows[0]["goals"] == "10"


def test_a_csv_is_read_back_to_the_same_episodes():
    rng = np.random.default_rng(4)
    first = Episodes(
        success=rng.random(9) < 0.5,
        accident=rng.integers(0, 4, 9).astype(np.int8),
        accumulated_reward=rng.normal(size=9),
        average_speed=rng.normal(size=9),
        travel_distance=rng.normal(size=9),
        duration=rng.normal(size=9),
        escape_time=np.where(rng.random(9) < 0.5, np.nan, rng.random(9)),
        goals=rng.integers(0, 9, 9),
        goals_timed_out=rng.integers(0, 9, 9),
    )
    again = metrics.from_csv(metrics.to_csv(first))
    for name in Episodes.__dataclass_fields__:
        np.testing.assert_array_equal(getattr(again, name), getattr(first, name), err_msg=name)
        assert getattr(again, name).dtype == getattr(first, name).dtype
    for text in ("", "episode,success\n0,1\n", metrics.to_csv(first).replace("none", "nobody")):
        with pytest.raises(LanewiseError, match="damaged"):
            metrics.from_csv(text + "x")


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("0,1,none,1.5", "1,1,none,1.5"),
        ("0,1,none,1.5", "0,1,none,inf"),
        ("1.5", ""),
        ("4,", "4.0,"),
    ],
)
def test_a_table_of_episodes_says_what_ours_say(old, new):
    """Numbered from 0 on; whole numbers whole, and finite ones known and finite."""
    one = Episodes(
        success=np.array([True]),
        accident=np.zeros(1, np.int8),
        accumulated_reward=np.array([1.5]),
        average_speed=np.array([2.0]),
        travel_distance=np.array([3.0]),
        duration=np.array([25.0]),
        escape_time=np.array([np.nan]),
        goals=np.array([4]),
        goals_timed_out=np.array([0]),
    )
    text = metrics.to_csv(one)
    assert metrics.from_csv(text).accumulated_reward.tolist() == [1.5]
    assert old in text
    with pytest.raises(LanewiseError, match="episodes are damaged"):
        metrics.from_csv(text.replace(old, new, 1))
