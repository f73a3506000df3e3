"""Actions that are not finite, or do not exist, are refused and change nothing."""

import jax
import numpy as np
import pytest
from gymnasium.error import ResetNeeded

from lanewise.envs import functional
from lanewise.envs.single import TrapContinuousEnv, TrapEnv, checked
from lanewise.envs.vector import TrapContinuousVectorEnv, TrapVectorEnv
from lanewise.errors import LanewiseError

NONE = (np.nan, np.inf, -np.inf, 1.5, -1.001)


@pytest.mark.parametrize("value", NONE, ids=str)
def test_continuous_actions(value):
    space = TrapContinuousEnv().action_space
    for action in ([value, 0.0], [0.0, value]):
        with pytest.raises(ValueError, match="action must be in"):
            checked(space, np.array(action, np.float32))
    env = TrapContinuousVectorEnv(3)
    actions = np.zeros((3, 2), np.float32)
    assert env._checked(actions) is not None
    actions[1, 1] = value
    with pytest.raises(ValueError, match="actions must be 3 of"):
        env._checked(actions)


@pytest.mark.parametrize("value", [np.nan, np.inf, 2.5, 9, -1], ids=str)
def test_low_level_actions(value):
    with pytest.raises(ValueError, match="action must be in"):
        checked(TrapEnv().action_space, value)
    env = TrapVectorEnv(2)
    with pytest.raises(ValueError, match="actions must be 2 of"):
        env._checked(np.array([4, value]))


OF_NO_KIND = {
    "None": None,
    "text": "0",
    "truth": True,
    "complex": 0j,
    "object": np.array(0, object),
    "a duration": np.timedelta64(0),
    "too long": 2**70,
    "ragged": [[0], [0, 0]],
}
"""Neither whole numbers nor floats, though NumPy makes numbers of most."""


@pytest.mark.parametrize("value", OF_NO_KIND.values(), ids=list(OF_NO_KIND))
def test_what_is_no_number_is_not_made_one(value):
    for space in (TrapEnv().action_space, TrapContinuousEnv().action_space):
        action = [value, value] if space.shape else value
        with pytest.raises(ValueError, match="action must be in") as refused:
            checked(space, action)
        assert len(str(refused.value).splitlines()) == 1
    for env in (TrapVectorEnv(2), TrapContinuousVectorEnv(2)):
        with pytest.raises(ValueError, match="actions must be 2 of"):
            env._checked([[value, value]] * 2 if env.action_space.shape[1:] else [value] * 2)


def test_what_float32_cannot_hold_is_refused_before_it_becomes_infinite():
    for action in ([1e39, 0.0], [0.0, -1e300], [np.longdouble("1e4000"), 0.0]):
        with pytest.raises(ValueError, match="action must be in"):
            checked(TrapContinuousEnv().action_space, action)
        with pytest.raises(ValueError, match="actions must be 1 of"):
            TrapContinuousVectorEnv(1)._checked([action])


def test_what_rounds_to_the_limit_is_in_range():
    assert checked(TrapContinuousEnv().action_space, [1.0 + 1e-12, 0]).tolist() == [1.0, 0.0]


@pytest.mark.parametrize(
    ("kind", "actions"),
    [("low-level", [1.5, True, 4j, [4]]), ("continuous", [0.5, [True, True], [1j, 0.0]])],
)
def test_a_compiled_step_refuses_what_is_of_another_kind(kind, actions):
    task = functional.make(kind)
    state, _ = functional.reset(task, jax.random.key(0))
    for action in actions:
        with pytest.raises(LanewiseError, match="action must be"):
            functional.step(task, state, np.asarray(action))


def test_a_step_wants_a_reset_first():
    with pytest.raises(ResetNeeded):
        TrapContinuousEnv().step([np.nan, 0.0])
