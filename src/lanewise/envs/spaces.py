"""The spaces of actions and observations."""

from typing import Any

import numpy as np
from gymnasium.spaces import Box, Discrete, Space
from numpy.typing import NDArray

from lanewise.controllers import goals
from lanewise.driving import actions, observation
from lanewise.driving.parts import OURS
from lanewise.envs.control import GoalControl, LowLevelControl
from lanewise.envs.functional import Trap
from lanewise.system import pinned


def of_actions(task: Trap) -> Discrete | Box:
    """What `functional.step` takes."""
    if isinstance(task.control, LowLevelControl):
        return Discrete(actions.COUNT)
    if isinstance(task.control, GoalControl):
        return Discrete(goals.action_count(task.control.goals))
    return Box(-1.0, 1.0, (2,), np.float32)


def count(space: Space[Any]) -> int:
    """Number of actions in a space of `of_actions`; 0 for continuous ones."""
    return int(space.n) if isinstance(space, Discrete) else 0


@pinned.switches()
def of_observations(task: Trap) -> Space[NDArray[np.float32]]:
    """What `functional.step` shows; without limits where a user's own function observes."""
    limit = np.inf
    if task.rules.parts.observe is OURS.observe:
        fine = task.rules.driving.observation.scaling == "fine"
        limit = observation.FINE_LIMIT if fine else 1.0
    size = task.rules.parts.try_out(task.scenario, task.rules.driving)
    box: Any = Box(-limit, limit, (size,), np.float32)
    return box  # type: ignore[no-any-return]
