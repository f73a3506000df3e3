from math import cos

import jax.numpy as jnp
import numpy as np
import pytest
from percepts import percept_of

from lanewise.controllers import goals
from lanewise.controllers.goals import Goal
from lanewise.controllers.settings import GoalSettings


def goal(lane, speed):
    return Goal(lane=jnp.int32(lane), speed=jnp.float32(speed))


def moves(settings, reference, seen=None):
    """(lane, speed) that every action makes of a goal."""
    seen = percept_of() if seen is None else seen
    every = [
        goals.apply_high_level_action(settings, reference, seen, jnp.int32(action))
        for action in range(goals.action_count(settings))
    ]
    return [(int(g.lane), float(g.speed)) for g in every]


def test_joint_nine_are_all_pairs_of_lane_and_speed():
    assert moves(GoalSettings(), goal(1, 10.0)) == [
        (0, 9), (0, 10), (0, 11),
        (1, 9), (1, 10), (1, 11),
        (2, 9), (2, 10), (2, 11),
    ]  # fmt: skip


def test_single_five_change_one_thing_at_a_time():
    settings = GoalSettings(action_set="single-5", speed_step=0.5)
    assert moves(settings, goal(1, 10.0)) == [(0, 10), (1, 9.5), (1, 10), (1, 10.5), (2, 10)]


def test_joint_six_have_no_keep():
    settings = GoalSettings(action_set="joint-6", speed_step=2.5)
    assert moves(settings, goal(1, 10.0)) == [
        (0, 7.5), (0, 12.5), (1, 7.5), (1, 12.5), (2, 7.5), (2, 12.5),
    ]  # fmt: skip


@pytest.mark.parametrize(("lane", "lanes"), [(0, {0, 1}), (2, {1, 2})])
def test_goals_are_clipped_to_the_road_that_exists(lane, lanes):
    """The road of the percept has a fourth lane in its arrays that is absent."""
    assert {lane for lane, _ in moves(GoalSettings(), goal(lane, 10.0))} == lanes


def test_goals_are_clipped_to_the_bounds_of_speed():
    assert {speed for _, speed in moves(GoalSettings(), goal(1, 5.5))} == {5.0, 5.5, 6.5}
    assert {speed for _, speed in moves(GoalSettings(), goal(1, 16.0))} == {15.0, 16.0}
    narrow = GoalSettings(lowest_speed=9.8, highest_speed=10.1)
    speeds = [speed for _, speed in moves(narrow, goal(1, 10.0))]
    assert speeds == pytest.approx([9.8, 10.0, 10.1] * 3)


@pytest.mark.parametrize(("speed", "wanted"), [(3.0, 5.0), (12.3, 12.3), (20.0, 16.0)])
def test_the_goal_of_the_moment_is_within_bounds(speed, wanted):
    moment = goals.goal_from_state(GoalSettings(), percept_of(y=7.9, speed=speed))
    assert (int(moment.lane), float(moment.speed)) == (2, pytest.approx(wanted))


def test_errors_are_signed_and_along_the_road():
    seen = percept_of(y=5.0, speed=10.0, heading=0.3)
    lateral, speed = goals.errors(goal(2, 11.0), seen)
    assert float(lateral) == pytest.approx(3.0)
    assert float(speed) == pytest.approx(11.0 - 10.0 * cos(0.3), abs=1e-5)


def test_goal_features_are_scaled_and_clipped():
    seen = percept_of(y=4.0, speed=10.0)
    np.testing.assert_allclose(goals.features(goal(2, 9.0), seen), [1.0, -0.5])
    np.testing.assert_allclose(goals.features(goal(0, 16.0), seen), [-1.0, 2.0])
    np.testing.assert_allclose(
        goals.features(goal(0, 9.9), percept_of(y=12.0)), [-2, -0.05], atol=1e-6
    )


def test_tracking_is_the_sum_of_the_scaled_distances():
    seen = percept_of(y=5.0, speed=10.0)
    assert float(goals.tracking(goal(0, 11.0), seen)) == pytest.approx(5 / 4 + 1 / 2)
    assert float(goals.tracking(goal(1, 10.0), percept_of())) == 0.0
