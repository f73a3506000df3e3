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
    accident_kind=np.array([0, 0, 3, 8], np.int8),
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


def test_values(summary):
    expected = {
        "escape_rate": 0.5,
        "success_rate": 0.5,
        "accident_rate": 0.5,
        "accumulated_reward": 3.0,
        "average_speed": 11.0,
        "travel_distance": 190.0,
        "reward_per_second": 12.0 / 60.0,
        "escape_time": 15.0,
        "goal_time_out_rate": 0.25,
    }
    assert summary.values == pytest.approx(expected)
    assert list(summary.values) == [metric.name for metric in metrics.METRICS]
    for name, value in expected.items():
        low, high = summary.intervals[name]
        assert low < value < high
    assert summary.accidents == {"collision": 1, "off_road": 0, "stopped": 1}
    happened = {kind: count for kind, count in summary.accident_kinds.items() if count}
    assert happened == {"cut_in": 1, "stopped": 1}


def test_a_success_of_ours_is_an_escape_without_an_accident_and_the_papers_any_escape():
    """An episode may end in neither: the ego just stays behind the trap."""
    later = dataclasses.replace(
        FOUR,
        success=np.array([True, False, False, False]),
        escape_time=np.array([14.0, 16.0, 3.0, np.nan]),
    )
    assert later.escaped.tolist() == [True, True, True, False]
    found = metrics.summarise(later, controller="hierarchical", world="lanewise")
    assert found.values["escape_rate"] == 0.75
    assert (found.values["success_rate"], found.values["accident_rate"]) == (0.25, 0.5)
    # Clopper and Pearson's for 3 of 4, from tables.
    assert found.intervals["escape_rate"] == pytest.approx((0.1941, 0.9937), abs=1e-4)


def test_episodes_are_shown_by_their_fields_instead_of_their_numbers():
    assert repr(first(4)).startswith("Episodes(4 of success, accident, ")


def test_json_round_trip(summary):
    stored = json.loads(json.dumps(summary.to_json(), allow_nan=False))
    assert metrics.Summary.from_json(stored) == summary
    assert {"controller", "world", "episodes", "accidents", "intervals"} <= set(stored)
    assert stored["success_rate"] == 0.5
    # A summary from before both successes is read without the paper's.
    del stored["escape_rate"], stored["intervals"]["escape_rate"]
    again = metrics.Summary.from_json(stored)
    assert "escape_rate" not in again.values
    assert again.to_json() == stored


def test_one_episode_without_goals_or_escape_has_no_nan_in_json():
    none = np.array([0])
    nothing = dataclasses.replace(
        first(1), escape_time=np.array([np.nan]), goals=none, goals_timed_out=none
    )
    stored = metrics.summarise(nothing, controller="single-level", world="lanewise").to_json()
    json.dumps(stored, allow_nan=False)
    assert stored["escape_time"] is None
    assert stored["goal_time_out_rate"] is None
    assert set(stored["intervals"]) == {"escape_rate", "success_rate", "accident_rate"}
    assert math.isnan(metrics.Summary.from_json(stored).values["escape_time"])


def test_no_episode_is_refused():
    with pytest.raises(LanewiseError, match="no test episode"):
        metrics.summarise(first(0), controller="single-level", world="lanewise")
    with pytest.raises(LanewiseError, match="no pair"):
        metrics.paired(FOUR, first(0))


def test_published_intervals():
    found = metrics.published_intervals("hierarchical")
    assert set(found) == {"escape_rate", "accident_rate"}
    assert found["accident_rate"] == pytest.approx((0.0094, 0.0475), abs=5e-5)


def test_paired_finds_each_difference_among_the_common_starts():
    other = dataclasses.replace(
        FOUR,
        success=np.array([True, False, False, False]),
        accident=np.array([0, 0, 1, 1], np.int8),
    )
    pair = metrics.paired(FOUR, other)
    expected = {"episodes": 4, "identical": 2, "share": 0.5, "differing": [1, 3]}
    assert json.loads(json.dumps(pair.to_json())) == expected
    assert metrics.paired(FOUR, first(3)) == metrics.Paired(3, ())


def test_csv_has_one_row_an_episode_in_full_and_is_read_back():
    rng = np.random.default_rng(4)
    exact = dataclasses.replace(FOUR, accumulated_reward=rng.normal(size=4))
    text = metrics.to_csv(exact)
    rows = list(csv.DictReader(io.StringIO(text)))
    assert [row["accident"] for row in rows] == ["none", "none", "collision", "stopped"]
    assert [row["accident_kind"] for row in rows] == ["none", "none", "cut_in", "stopped"]
    assert (rows[2]["escape_time"], rows[0]["goals"]) == ("", "10")
    again = metrics.from_csv(text)
    for name, values in vars(exact).items():
        np.testing.assert_array_equal(getattr(again, name), values, err_msg=name)
        assert getattr(again, name).dtype == values.dtype
