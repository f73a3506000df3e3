"""The planned controller of step 1: the high level sets goals, the planner drives to them."""

from dataclasses import dataclass

from jax import Array

from lanewise.controllers import goal_critic, goals, planner
from lanewise.controllers.controller import Parameters
from lanewise.controllers.goal_critic import GoalMemory
from lanewise.controllers.settings import GoalSettings, PlannerSettings
from lanewise.driving import observation
from lanewise.driving.percept import Percept
from lanewise.driving.settings import DrivingSettings


@dataclass(frozen=True)
class Planned:
    """The high-level network learns; it chooses when the goal critic says that a goal is due."""

    driving: DrivingSettings
    goals: GoalSettings
    planner: PlannerSettings
    renewal: str
    """When goals are renewed, see `GoalSettings`."""
    name: str = "planned"
    learns: str = "high_level"
    feature_count: int = observation.SIZE

    @property
    def choice_count(self) -> int:
        """High-level actions."""
        return goals.action_count(self.goals)

    def start(self, parameters: Parameters, percept: Percept) -> GoalMemory:
        """No goal yet."""
        return goal_critic.start(self.goals, percept)

    def perceive(self, parameters: Parameters, memory: GoalMemory, percept: Percept) -> GoalMemory:
        """The goal critic looks at the goal."""
        frequency = self.driving.decision_frequency
        return goal_critic.review(self.goals, frequency, self.renewal, memory, percept)

    def ready(self, memory: GoalMemory) -> Array:
        """The network chooses when a goal is due."""
        return memory.due

    def features(self, memory: GoalMemory, percept: Percept) -> Array:
        """The observation, [26]."""
        return percept.features

    def decide(
        self, memory: GoalMemory, percept: Percept, choice: Array
    ) -> tuple[Array, GoalMemory]:
        """Set the goal where one is due; the planner acts on it."""
        memory = goal_critic.renew(self.goals, memory, percept, choice)
        action = planner.act(self.planner, self.driving, memory.goal, percept)
        return action, goal_critic.grown(memory)

    def penalty(self, memory: GoalMemory, percept: Percept) -> Array:
        """Distance from the goal (row 21 of the reading)."""
        return goals.tracking(memory.goal, percept)
