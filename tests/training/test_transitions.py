"""Transitions of a level, one function at a time, with numbers worked out by hand."""

from dataclasses import replace

import jax.numpy as jnp
import numpy as np
import pytest

from lanewise.controllers.controller import Feedback
from lanewise.driving.episode import Outcome
from lanewise.learning.settings import LearnerSettings
from lanewise.training import transitions
from lanewise.training.settings import LevelSettings

PLAIN = LevelSettings(
    learner=LearnerSettings(discount=0.5),
    external_weight=2.0,
    tracking_weight=0.25,
    goal_reward=3.0,
    approach_weight=1.0,
    discount_across_goal="per-decision",
)
AFTER = jnp.array([7.0, 8.0])
"""What is seen after the decision."""


def outcome(terminated=False, truncated=False):
    flags = (jnp.bool_(flag) for flag in (terminated, truncated))
    return Outcome(jnp.float32(10.0), jnp.int32(terminated), *flags)


def feedback(distance=4.0, reached=False):
    return Feedback(distance=jnp.float32(distance), reached=jnp.bool_(reached))


def chosen(level_settings, count):
    """``count`` choices, of features [number, number] and action number, the first one 1."""
    pending = transitions.empty(level_settings, 2)
    for number in range(1, count + 1):
        pending = transitions.push(pending, jnp.full(2, float(number)), jnp.int32(number))
    return pending


def gathered(level_settings, pending, *results):
    for result, seen in results:
        pending = transitions.accumulate(level_settings, pending, result, seen, jnp.float32(6.0))
    return pending


def emitted(level_settings, pending, result=None, seen=None):
    result, seen = result or outcome(), seen or feedback()
    return transitions.emit(level_settings, pending, result, seen, AFTER, jnp.bool_(False))[0]


def complete(level_settings, pending, result=None, ready=False):
    result, ready = result or outcome(), jnp.bool_(ready)
    return transitions.emit(level_settings, pending, result, feedback(), AFTER, ready)[1].tolist()


def test_a_decision_is_paid_by_what_came_of_it():
    # 2 * 10 - 4 / 4 + (6 - 4), and 3 for a goal that is reached.
    for seen, paid in ((feedback(), 21.0), (feedback(reached=True), 24.0)):
        pending = gathered(PLAIN, chosen(PLAIN, 1), (outcome(), seen))
        assert pending.reward.tolist() == [paid]
        assert pending.discount.tolist() == [0.5]


def test_an_accident_leaves_the_external_reward_alone():
    result = outcome(terminated=True)
    pending = gathered(PLAIN, chosen(PLAIN, 1), (result, feedback(reached=True)))
    assert pending.reward.tolist() == [20.0]
    ended = gathered(PLAIN, chosen(PLAIN, 1), (outcome(truncated=True), feedback(reached=True)))
    assert ended.reward.tolist() == [24.0]


def test_later_rewards_count_less():
    twice = ((outcome(), feedback()),) * 2
    pending = gathered(PLAIN, chosen(PLAIN, 1), *twice)
    assert pending.reward.tolist() == [21.0 + 0.5 * 21.0]
    assert emitted(PLAIN, pending).discount.tolist() == [0.25]
    per_goal = replace(PLAIN, discount_across_goal="per-goal")
    pending = gathered(per_goal, chosen(per_goal, 1), *twice)
    assert pending.reward.tolist() == [42.0]
    assert emitted(per_goal, pending).discount.tolist() == [0.5]


def test_choices_back_count_their_place():
    level_settings = replace(PLAIN, returns=3, discount_across_goal="per-goal")
    pending = gathered(level_settings, chosen(level_settings, 4), (outcome(), feedback()))
    assert pending.choice.tolist() == [4, 3, 2]
    np.testing.assert_allclose(pending.reward, [21.0, 10.5, 5.25])
    found = emitted(level_settings, pending)
    np.testing.assert_allclose(found.discount, [0.5, 0.25, 0.125])
    assert found.features[:, 0].tolist() == [4.0, 3.0, 2.0]
    assert found.next_features.tolist() == [AFTER.tolist()] * 3


def test_only_choices_of_this_episode_are_complete_the_oldest_first():
    level_settings = replace(PLAIN, returns=3)
    done = outcome(truncated=True)
    for count, ready, at_end in (
        (1, [False] * 3, [True, False, False]),
        (2, [False] * 3, [True, True, False]),
        (5, [False, False, True], [True] * 3),
    ):
        pending = chosen(level_settings, count)
        assert int(pending.count) == min(count, 3)
        assert complete(level_settings, pending) == [False] * 3
        assert complete(level_settings, pending, ready=True) == ready
        assert complete(level_settings, pending, done) == at_end


@pytest.mark.parametrize(
    ("changes", "endings"),
    [
        ({}, {"terminated"}),
        ({"time_out": "terminal"}, {"terminated", "truncated"}),
        ({"goal_end": "terminal"}, {"terminated", "reached"}),
    ],
)
def test_what_ends_the_future(changes, endings):
    level_settings = replace(PLAIN, **changes)
    pending = chosen(level_settings, 1)
    for name, result, seen in (
        ("none", outcome(), feedback()),
        ("terminated", outcome(terminated=True), feedback()),
        ("truncated", outcome(truncated=True), feedback()),
        ("reached", outcome(), feedback(reached=True)),
    ):
        discount = float(emitted(level_settings, pending, result, seen).discount[0])
        assert discount == (0.0 if name in endings else 1.0), name
