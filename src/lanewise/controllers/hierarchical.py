"""The hierarchical controller: the frozen high level sets goals, the low level drives to them."""

from dataclasses import dataclass

import jax.numpy as jnp
from jax import Array

from lanewise.controllers import goal_critic, goals
from lanewise.controllers.controller import Parameters
from lanewise.controllers.goal_critic import GoalMemory
from lanewise.controllers.settings import GoalSettings
from lanewise.driving import actions, observation
from lanewise.driving.percept import Percept
from lanewise.driving.settings import DrivingSettings
from lanewise.learning import network

FEATURES = observation.SIZE + goals.FEATURES
"""Inputs of the low-level network."""


@dataclass(frozen=True)
class Hierarchical:
    """The low-level network learns; it sees the 26 features and the two of the goal."""

    driving: DrivingSettings
    goals: GoalSettings
    renewal: str
    """When goals are renewed, see `GoalSettings`."""
    name: str = "hierarchical"
    learns: str = "low_level"
    feature_count: int = FEATURES
    choice_count: int = actions.COUNT

    def start(self, parameters: Parameters, percept: Percept) -> GoalMemory:
        """No goal yet."""
        return goal_critic.start(self.goals, percept)

    def perceive(self, parameters: Parameters, memory: GoalMemory, percept: Percept) -> GoalMemory:
        """The goal critic looks at the goal; where one is due, the high level sets it, greedily."""
        frequency = self.driving.decision_frequency
        memory = goal_critic.review(self.goals, frequency, self.renewal, memory, percept)
        values = network.q_values(parameters["high_level"], percept.features)
        return goal_critic.renew(self.goals, memory, percept, jnp.argmax(values))

    def ready(self, memory: GoalMemory) -> Array:
        """The network chooses at every decision."""
        return jnp.asarray(True)

    def features(self, memory: GoalMemory, percept: Percept) -> Array:
        """The observation and the goal features, [28]."""
        return jnp.concatenate([percept.features, goals.features(memory.goal, percept)])

    def decide(
        self, memory: GoalMemory, percept: Percept, choice: Array
    ) -> tuple[Array, GoalMemory]:
        """The choice is the low-level action."""
        return choice, goal_critic.grown(memory)

    def penalty(self, memory: GoalMemory, percept: Percept) -> Array:
        """Distance from the goal (row 21 of the reading)."""
        return goals.tracking(memory.goal, percept)
