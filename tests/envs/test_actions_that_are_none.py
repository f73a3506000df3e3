"""Actions that are not finite, or do not exist, are refused and change nothing."""

import numpy as np
import pytest
from gymnasium.error import ResetNeeded

from lanewise.envs.single import TrapContinuousEnv, TrapEnv, checked
from lanewise.envs.vector import TrapContinuousVectorEnv, TrapVectorEnv

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


def test_a_step_wants_a_reset_first():
    with pytest.raises(ResetNeeded):
        TrapContinuousEnv().step([np.nan, 0.0])
