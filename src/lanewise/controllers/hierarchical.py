"""The controllers with goals: the high level sets them, and what is below drives to them.

Below is the planner in step 1, `Planned`, and a low level from then on, `Hierarchical`. The latter
is h-DQN's too: the two differ in training alone (see `lanewise.training.recipe`).
"""

from dataclasses import dataclass, replace
from typing import Any, Self

import jax
import jax.numpy as jnp
from jax import Array

from lanewise.controllers import goal_critic, goals, planner
from lanewise.controllers.controller import Feedback
from lanewise.controllers.goal_critic import GoalMemory
from lanewise.controllers.settings import GoalSettings, PlannerSettings
from lanewise.driving import actions, observation
from lanewise.driving.percept import Percept
from lanewise.driving.settings import DrivingSettings


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class TwoLevelMemory:
    """What a controller with goals remembers."""

    goal: GoalMemory
    """The goal under way."""
    action: Array
    """int32 [] what the low level chose last; a planner below the goals leaves it alone."""


@dataclass(frozen=True)
class HighLevel:
    """Sets a goal whenever one is due; it observes the 26 features."""

    goals: GoalSettings
    name: str = "high_level"
    feature_count: int = observation.SIZE

    @property
    def choice_count(self) -> int:
        """High-level actions."""
        return goals.action_count(self.goals)

    def ready(self, memory: TwoLevelMemory) -> Array:
        """When a goal is due."""
        return memory.goal.due

    def features(self, memory: TwoLevelMemory, percept: Percept) -> Array:
        """The observation, [26]."""
        return percept.features

    def choose(self, memory: TwoLevelMemory, percept: Percept, choice: Array) -> TwoLevelMemory:
        """A new goal, where one is due."""
        goal = goal_critic.maybe_renew_goal(self.goals, memory.goal, percept, choice)
        return replace(memory, goal=goal)


@dataclass(frozen=True)
class LowLevel:
    """Chooses the low-level action; it observes the features and the two of the goal."""

    observed: int = observation.SIZE
    """Features observed."""
    name: str = "low_level"
    choice_count: int = actions.COUNT

    @property
    def feature_count(self) -> int:
        """What is observed, and the goal."""
        return self.observed + goals.FEATURES

    def ready(self, memory: TwoLevelMemory) -> Array:
        """At every decision."""
        return jnp.asarray(True)

    def features(self, memory: TwoLevelMemory, percept: Percept) -> Array:
        """The observation and the goal features, [28]."""
        return jnp.concatenate([percept.features, goals.features(memory.goal.goal, percept)])

    def choose(self, memory: TwoLevelMemory, percept: Percept, choice: Array) -> TwoLevelMemory:
        """The choice is the low-level action."""
        return replace(memory, action=choice)


def increment_age(memory: TwoLevelMemory) -> TwoLevelMemory:
    """The memory once the goal is a decision older."""
    return replace(memory, goal=replace(memory.goal, age=memory.goal.age + 1))


class _WithGoals:
    """What both have in common: a goal, and the goal critic, which looks at it."""

    driving: DrivingSettings
    goals: GoalSettings
    renewal: str

    def start(self, percept: Percept) -> TwoLevelMemory:
        """No goal yet, and no action."""
        return TwoLevelMemory(goal_critic.start(self.goals, percept), action=jnp.int32(0))

    def perceive(self, memory: TwoLevelMemory, percept: Percept) -> TwoLevelMemory:
        """The goal critic looks at the goal."""
        goal = goal_critic.update_goal_status(
            self.goals, self.driving, self.renewal, memory.goal, percept
        )
        return replace(memory, goal=goal)

    def feedback(self, memory: TwoLevelMemory, percept: Percept) -> Feedback:
        """How far from its goal the ego is, and whether that counts as reached."""
        goal = memory.goal.goal
        return Feedback(
            distance=goals.tracking(goal, percept),
            reached=goal_critic.reached(self.goals, goal, percept),
        )

    def goal(self, memory: TwoLevelMemory) -> GoalMemory:
        """The goal under way."""
        return memory.goal


@dataclass(frozen=True)
class Planned(_WithGoals):
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
    def from_settings(cls, settings: Any, *, name: str, renewal: str, observed: int) -> Self:
        """See `registry.make`."""
        return cls(settings.driving, settings.goals, settings.planner, renewal, observed=observed)

    @property
    def levels(self) -> tuple[HighLevel]:
        """The high level alone."""
        return (HighLevel(self.goals, feature_count=self.observed),)

    def act(self, memory: TwoLevelMemory, percept: Percept) -> tuple[Array, TwoLevelMemory]:
        """The planner's action."""
        action = planner.act(self.planner, self.driving, memory.goal.goal, percept)
        return action, increment_age(memory)


@dataclass(frozen=True)
class Hierarchical(_WithGoals):
    """Two networks, one above the other."""

    driving: DrivingSettings
    goals: GoalSettings
    renewal: str
    """When goals are renewed, see `GoalSettings`."""
    name: str = "hierarchical"
    observed: int = observation.SIZE
    """Features observed."""

    @classmethod
    def from_settings(cls, settings: Any, *, name: str, renewal: str, observed: int) -> Self:
        """See `registry.make`."""
        return cls(settings.driving, settings.goals, renewal, name, observed)

    @property
    def levels(self) -> tuple[HighLevel, LowLevel]:
        """First the goal, then the action."""
        return (HighLevel(self.goals, feature_count=self.observed), LowLevel(self.observed))

    def act(self, memory: TwoLevelMemory, percept: Percept) -> tuple[Array, TwoLevelMemory]:
        """The low level's action."""
        return memory.action, increment_age(memory)
