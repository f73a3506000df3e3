"""The hierarchical controller: the high level sets goals, the low level drives to them.

Also h-DQN's: the two differ in training alone (see `lanewise.training.recipe`).
"""

from dataclasses import dataclass
from typing import Any

from jax import Array

from lanewise.controllers import levels
from lanewise.controllers.controller import Feedback
from lanewise.controllers.goal_critic import GoalMemory
from lanewise.controllers.levels import HighLevel, LowLevel, TwoLevelMemory
from lanewise.controllers.settings import GoalSettings
from lanewise.driving import observation
from lanewise.driving.percept import Percept
from lanewise.driving.settings import DrivingSettings


@dataclass(frozen=True)
class Hierarchical:
    """Two networks, one above the other."""

    driving: DrivingSettings
    goals: GoalSettings
    renewal: str
    """When goals are renewed, see `GoalSettings`."""
    name: str = "hierarchical"
    observed: int = observation.SIZE
    """Features observed."""

    @classmethod
    def from_settings(
        cls, settings: Any, *, name: str, renewal: str, observed: int
    ) -> "Hierarchical":
        """Makes it from a run's settings, see `lanewise.controllers.registry.make`."""
        return cls(settings.driving, settings.goals, renewal, name, observed)

    @property
    def levels(self) -> tuple[HighLevel, LowLevel]:
        """First the goal, then the action."""
        return (HighLevel(self.goals, feature_count=self.observed), LowLevel(self.observed))

    def start(self, percept: Percept) -> TwoLevelMemory:
        """No goal yet."""
        return levels.start(self.goals, percept)

    def perceive(self, memory: TwoLevelMemory, percept: Percept) -> TwoLevelMemory:
        """The goal critic looks at the goal."""
        return levels.update_goal_status(self.goals, self.driving, self.renewal, memory, percept)

    def act(self, memory: TwoLevelMemory, percept: Percept) -> tuple[Array, TwoLevelMemory]:
        """The low level's action."""
        return memory.action, levels.increment_age(memory)

    def feedback(self, memory: TwoLevelMemory, percept: Percept) -> Feedback:
        """Of the goal."""
        return levels.feedback(self.goals, memory, percept)

    def goal(self, memory: TwoLevelMemory) -> GoalMemory:
        """The goal under way."""
        return memory.goal
