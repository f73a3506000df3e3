"""The spaces of actions and observations."""

from typing import Any

import numpy as np
from gymnasium.spaces import Box, Discrete, Space
from numpy.typing import NDArray

from lanewise.controllers import goals
from lanewise.driving import actions, observation
from lanewise.driving.task_functions import PAPER_TASK
from lanewise.envs.control import GoalControl, LowLevelControl
from lanewise.envs.functional import EnvConfig
from lanewise.system import pinned


def of_actions(config: EnvConfig) -> Discrete | Box:
    """What `functional.step` takes."""
    if isinstance(config.control, LowLevelControl):
        return Discrete(actions.COUNT)
    if isinstance(config.control, GoalControl):
        return Discrete(goals.action_count(config.control.goals))
    return Box(-1.0, 1.0, (2,), np.float32)


def count(space: Space[Any]) -> int:
    """Number of actions in a space of `of_actions`; 0 for continuous ones."""
    return int(space.n) if isinstance(space, Discrete) else 0


@pinned.switches()
def of_observations(config: EnvConfig) -> Space[NDArray[np.float32]]:
    """What `functional.step` shows; without limits where a user's own function observes."""
    limit = np.inf
    if config.rules.task.observe is PAPER_TASK.observe:
        fine = config.rules.driving.observation.scaling == "fine"
        limit = observation.FINE_LIMIT if fine else 1.0
    size = config.rules.task.validate(config.scenario, config.rules.driving)
    box: Any = Box(-limit, limit, (size,), np.float32)
    return box  # type: ignore[no-any-return]
