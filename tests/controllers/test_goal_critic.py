from dataclasses import replace

import jax.numpy as jnp
import pytest
from percepts import percept_of

from lanewise.controllers import goal_critic
from lanewise.controllers.goals import Goal
from lanewise.controllers.settings import GoalSettings
from lanewise.driving.settings import DrivingSettings

SETTINGS = GoalSettings(time_limit=3.0)
DRIVING = DrivingSettings(decision_frequency=2)
KEEP = 4
"""The joint-9 action that moves nothing."""


def goal(lane, speed):
    return Goal(lane=jnp.int32(lane), speed=jnp.float32(speed))


def under_way(age=1, lane=1, speed=10.0):
    start = goal_critic.start(SETTINGS, percept_of())
    return replace(start, goal=goal(lane, speed), age=jnp.int32(age), due=jnp.bool_(False))


def review(memory, seen, renewal="critic", settings=SETTINGS):
    return goal_critic.update_goal_status(settings, DRIVING, renewal, memory, seen)


def counts(memory):
    return int(memory.ended), int(memory.timed_out)


@pytest.mark.parametrize("sign", [-1, 1])
def test_reached_means_strictly_within_both_tolerances(sign):
    def reached(lateral, speed):
        seen = percept_of(y=4.0 + sign * lateral, speed=10.0 + sign * speed, lane=1)
        return bool(goal_critic.reached(SETTINGS, goal(1, 10.0), seen))

    assert reached(0.0, 0.0)
    assert reached(0.29, 0.29)
    assert not reached(0.31, 0.0)
    assert not reached(0.0, 0.31)


def test_the_tolerance_itself_is_not_reached():
    settings = GoalSettings(lateral_tolerance=0.25, speed_tolerance=0.5)
    aside, faster = percept_of(y=4.25), percept_of(speed=10.5)
    assert not goal_critic.reached(settings, goal(1, 10.0), aside)
    assert not goal_critic.reached(settings, goal(1, 10.0), faster)


def test_a_goal_reached_ends_and_is_counted_once():
    memory = review(under_way(), percept_of())
    assert memory.due
    assert counts(memory) == (1, 0)
    assert counts(review(memory, percept_of())) == (1, 0)


def test_a_goal_ends_at_its_time_limit_and_not_before():
    far = percept_of(y=0.0)
    before, at = review(under_way(age=5), far), review(under_way(age=6), far)
    assert (bool(before.due), counts(before)) == (False, (0, 0))
    assert (bool(at.due), counts(at)) == (True, (1, 1))


def test_a_goal_reached_at_its_time_limit_is_not_given_up():
    assert counts(review(under_way(age=6), percept_of())) == (1, 0)


@pytest.mark.parametrize(
    ("renewal", "due"), [("critic", [0, 0, 0]), ("timestep", [0, 1, 1]), ("decision", [1, 1, 1])]
)
def test_renewal_modes_renew_before_the_goal_has_ended(renewal, due):
    far = percept_of(y=0.0)
    memories = [review(under_way(age=age), far, renewal) for age in (1, 2, 3)]
    assert [int(memory.due) for memory in memories] == due
    # A renewal is no end of a goal: nothing was reached or given up.
    assert [counts(memory) for memory in memories] == [(0, 0)] * 3


def test_renewing_is_for_due_goals_only():
    held = goal_critic.maybe_renew_goal(SETTINGS, under_way(age=3), percept_of(), jnp.int32(0))
    assert (int(held.goal.lane), float(held.goal.speed), int(held.age)) == (1, 10.0, 3)
    due = replace(under_way(age=3), due=jnp.bool_(True))
    new = goal_critic.maybe_renew_goal(SETTINGS, due, percept_of(), jnp.int32(0))
    assert (int(new.goal.lane), float(new.goal.speed), int(new.age)) == (0, 9.0, 0)
    assert not new.due


@pytest.mark.parametrize(
    ("reference", "expected"), [("previous-goal", (2, 12.0)), ("current-state", (0, 8.0))]
)
def test_a_new_goal_moves_its_reference(reference, expected):
    settings = replace(SETTINGS, reference=reference)
    due = replace(under_way(lane=2, speed=12.0), due=jnp.bool_(True))
    seen = percept_of(y=0.0, speed=8.0)
    new = goal_critic.maybe_renew_goal(settings, due, seen, jnp.int32(KEEP))
    assert (int(new.goal.lane), float(new.goal.speed)) == expected


def test_the_first_goal_is_relative_to_the_moment():
    start = goal_critic.start(SETTINGS, percept_of(y=0.0, speed=11.0))
    assert start.due
    first = goal_critic.maybe_renew_goal(
        SETTINGS, start, percept_of(y=0.0, speed=11.0), jnp.int32(8)
    )
    assert (int(first.goal.lane), float(first.goal.speed)) == (1, 12.0)
    assert int(goal_critic.increment_age(first).age) == 1
