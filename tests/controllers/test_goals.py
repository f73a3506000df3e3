"""Goals, how the high level moves them, and the goal critic, which ends them."""

from dataclasses import replace
from math import cos

import jax.numpy as jnp
import numpy as np
import pytest
from percepts import percept_of

from lanewise.controllers import goal_critic, goals
from lanewise.controllers.goals import Goal
from lanewise.controllers.settings import GoalSettings
from lanewise.driving.settings import DrivingSettings

SETTINGS = GoalSettings(time_limit=3.0)
DRIVING = DrivingSettings(decision_frequency=2)


def goal(lane, speed):
    return Goal(lane=jnp.int32(lane), speed=jnp.float32(speed))


def moves(settings, reference):
    """(lane, speed) that every action makes of a goal."""
    every = [
        goals.apply_high_level_action(settings, reference, percept_of(), jnp.int32(action))
        for action in range(goals.action_count(settings))
    ]
    return [(int(g.lane), float(g.speed)) for g in every]


@pytest.mark.parametrize(
    ("settings", "expected"),
    [
        ({}, [(0, 9), (0, 10), (0, 11), (1, 9), (1, 10), (1, 11), (2, 9), (2, 10), (2, 11)]),
        (
            {"action_set": "single-5", "speed_step": 0.5},
            [(0, 10), (1, 9.5), (1, 10), (1, 10.5), (2, 10)],
        ),
        (
            {"action_set": "joint-6", "speed_step": 2.5},
            [(0, 7.5), (0, 12.5), (1, 7.5), (1, 12.5), (2, 7.5), (2, 12.5)],
        ),
    ],
)
def test_the_actions_of_each_set(settings, expected):
    assert moves(GoalSettings(**settings), goal(1, 10.0)) == expected


def test_goals_are_clipped_to_the_road_that_exists_and_the_bounds_of_speed():
    """The road of the percept has a fourth lane in its arrays that is absent."""
    for lane, lanes in ((0, {0, 1}), (2, {1, 2})):
        assert {lane for lane, _ in moves(SETTINGS, goal(lane, 10.0))} == lanes
    assert {speed for _, speed in moves(SETTINGS, goal(1, 5.5))} == {5.0, 5.5, 6.5}
    assert {speed for _, speed in moves(SETTINGS, goal(1, 16.0))} == {15.0, 16.0}
    narrow = GoalSettings(lowest_speed=9.8, highest_speed=10.1)
    speeds = [speed for _, speed in moves(narrow, goal(1, 10.0))]
    assert speeds == pytest.approx([9.8, 10.0, 10.1] * 3)


@pytest.mark.parametrize(("speed", "wanted"), [(3.0, 5.0), (12.3, 12.3), (20.0, 16.0)])
def test_the_goal_of_the_moment_is_within_bounds(speed, wanted):
    moment = goals.goal_from_state(SETTINGS, percept_of(y=7.9, speed=speed))
    assert (int(moment.lane), float(moment.speed)) == (2, pytest.approx(wanted))


def test_errors_are_signed_and_along_the_road():
    seen = percept_of(y=5.0, speed=10.0, heading=0.3)
    expected = [3.0, 11.0 - 10.0 * cos(0.3)]
    np.testing.assert_allclose(goals.errors(goal(2, 11.0), seen), expected, rtol=1e-5)


def test_goal_features_are_scaled_and_clipped_and_tracking_is_their_sum():
    seen = percept_of(y=4.0, speed=10.0)
    for wanted, features in (((2, 9.0), [1.0, -0.5]), ((0, 16.0), [-1.0, 2.0])):
        np.testing.assert_allclose(goals.features(goal(*wanted), seen), features)
    far = goals.features(goal(0, 9.9), percept_of(y=12.0))
    np.testing.assert_allclose(far, [-2, -0.05], atol=1e-6)
    aside = percept_of(y=5.0, speed=10.0)
    assert float(goals.tracking(goal(0, 11.0), aside)) == pytest.approx(5 / 4 + 1 / 2)
    assert float(goals.tracking(goal(1, 10.0), seen)) == 0.0


def under_way(age=1, lane=1, speed=10.0, due=False):
    start = goal_critic.start(SETTINGS, percept_of())
    return replace(start, goal=goal(lane, speed), age=jnp.int32(age), due=jnp.bool_(due))


def review(memory, seen, renewal="critic"):
    return goal_critic.update_goal_status(SETTINGS, DRIVING, renewal, memory, seen)


def renewed(memory, seen, action, settings=SETTINGS):
    return goal_critic.maybe_renew_goal(settings, memory, seen, jnp.int32(action))


def counts(memory):
    return bool(memory.due), int(memory.ended), int(memory.timed_out)


def values(memory):
    return int(memory.goal.lane), float(memory.goal.speed)


@pytest.mark.parametrize("sign", [-1, 1])
def test_reached_means_strictly_within_both_tolerances(sign):
    def reached(lateral, speed, settings=SETTINGS):
        seen = percept_of(y=4.0 + sign * lateral, speed=10.0 + sign * speed, lane=1)
        return bool(goal_critic.reached(settings, goal(1, 10.0), seen))

    assert reached(0.0, 0.0)
    assert reached(0.29, 0.29)
    assert not reached(0.31, 0.0)
    assert not reached(0.0, 0.31)
    exact = GoalSettings(lateral_tolerance=0.25, speed_tolerance=0.5)
    assert not reached(0.25, 0.0, exact)
    assert not reached(0.0, 0.5, exact)


def test_a_goal_ends_once_when_reached_or_at_its_time_limit():
    far = percept_of(y=0.0)
    assert counts(review(under_way(age=5), far)) == (False, 0, 0)
    assert counts(review(under_way(age=6), far)) == (True, 1, 1)
    # Reached at the limit it is not given up, and what has ended is not counted again.
    for age in (1, 6):
        memory = review(under_way(age=age), percept_of())
        assert counts(memory) == counts(review(memory, percept_of())) == (True, 1, 0)


@pytest.mark.parametrize(
    ("renewal", "due"), [("critic", [0, 0, 0]), ("timestep", [0, 1, 1]), ("decision", [1, 1, 1])]
)
def test_renewal_modes_renew_before_the_goal_has_ended(renewal, due):
    """A renewal is no end of a goal: nothing was reached or given up."""
    far = percept_of(y=0.0)
    memories = [review(under_way(age=age), far, renewal) for age in (1, 2, 3)]
    assert [counts(memory) for memory in memories] == [(bool(each), 0, 0) for each in due]


def test_renewing_is_for_due_goals_only():
    held = renewed(under_way(age=3), percept_of(), 0)
    assert (values(held), int(held.age)) == ((1, 10.0), 3)
    new = renewed(under_way(age=3, due=True), percept_of(), 0)
    assert (values(new), int(new.age), bool(new.due)) == ((0, 9.0), 0, False)


@pytest.mark.parametrize(
    ("reference", "expected"), [("previous-goal", (2, 12.0)), ("current-state", (0, 8.0))]
)
def test_a_new_goal_moves_its_reference(reference, expected):
    settings, seen = replace(SETTINGS, reference=reference), percept_of(y=0.0, speed=8.0)
    keep = 4
    new = renewed(under_way(lane=2, speed=12.0, due=True), seen, keep, settings)
    assert values(new) == expected


def test_the_first_goal_is_relative_to_the_moment():
    start = goal_critic.start(SETTINGS, percept_of(y=0.0, speed=11.0))
    assert start.due
    assert values(renewed(start, percept_of(y=0.0, speed=11.0), 8)) == (1, 12.0)
