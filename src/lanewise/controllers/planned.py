"""The planned controller of step 1: the high level sets goals, the planner drives to them."""

from dataclasses import dataclass
from typing import Any

from jax import Array

from lanewise.controllers import levels, planner
from lanewise.controllers.controller import Feedback
from lanewise.controllers.goal_critic import GoalMemory
from lanewise.controllers.levels import HighLevel, TwoLevelMemory
from lanewise.controllers.settings import GoalSettings, PlannerSettings
from lanewise.driving import observation
from lanewise.driving.percept import Percept
from lanewise.driving.settings import DrivingSettings


@dataclass(frozen=True)
class Planned:
    """One network, the high level; the planner acts on its goals."""

    driving: DrivingSettings
    goals: GoalSettings
    planner: PlannerSettings
    renewal: str
    """When goals are renewed, see `GoalSettings`."""
    name: str = "planned"
    observed: int = observation.SIZE
    """Features observed."""

    @classmethod
    def from_settings(cls, settings: Any, *, name: str, renewal: str, observed: int) -> "Planned":
        """Makes it from a run's settings, see `lanewise.controllers.registry.make`."""
        return cls(settings.driving, settings.goals, settings.planner, renewal, observed=observed)

    @property
    def levels(self) -> tuple[HighLevel]:
        """The high level alone."""
        return (HighLevel(self.goals, feature_count=self.observed),)

    def start(self, percept: Percept) -> TwoLevelMemory:
        """No goal yet."""
        return levels.start(self.goals, percept)

    def perceive(self, memory: TwoLevelMemory, percept: Percept) -> TwoLevelMemory:
        """The goal critic looks at the goal."""
        return levels.update_goal_status(self.goals, self.driving, self.renewal, memory, percept)

    def act(self, memory: TwoLevelMemory, percept: Percept) -> tuple[Array, TwoLevelMemory]:
        """The planner's action."""
        action = planner.act(self.planner, self.driving, memory.goal.goal, percept)
        return action, levels.increment_age(memory)

    def feedback(self, memory: TwoLevelMemory, percept: Percept) -> Feedback:
        """Of the goal."""
        return levels.feedback(self.goals, memory, percept)

    def goal(self, memory: TwoLevelMemory) -> GoalMemory:
        """The goal under way."""
        return memory.goal
