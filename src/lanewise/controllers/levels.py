"""The two levels of the paper: the high level sets goals, the low level drives to them."""

from dataclasses import dataclass, replace

import jax
import jax.numpy as jnp
from jax import Array

from lanewise.controllers import goal_critic, goals
from lanewise.controllers.controller import Feedback
from lanewise.controllers.goal_critic import GoalMemory
from lanewise.controllers.settings import GoalSettings
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
    """Sets a goal whenever one is due; it sees the 26 features."""

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
        return replace(
            memory, goal=goal_critic.maybe_renew_goal(self.goals, memory.goal, percept, choice)
        )


@dataclass(frozen=True)
class LowLevel:
    """Chooses the low-level action; it sees the features and the two of the goal."""

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


def start(settings: GoalSettings, percept: Percept) -> TwoLevelMemory:
    """No goal yet, and none chosen."""
    return TwoLevelMemory(goal=goal_critic.start(settings, percept), action=jnp.int32(0))


def update_goal_status(
    settings: GoalSettings,
    driving: DrivingSettings,
    renewal: str,
    memory: TwoLevelMemory,
    percept: Percept,
) -> TwoLevelMemory:
    """The goal critic looks at the goal."""
    goal = goal_critic.update_goal_status(settings, driving, renewal, memory.goal, percept)
    return replace(memory, goal=goal)


def feedback(settings: GoalSettings, memory: TwoLevelMemory, percept: Percept) -> Feedback:
    """How far from its goal the ego is, and whether that counts as reached."""
    goal = memory.goal.goal
    return Feedback(
        distance=goals.tracking(goal, percept),
        reached=goal_critic.reached(settings, goal, percept),
    )


def increment_age(memory: TwoLevelMemory) -> TwoLevelMemory:
    """The memory one decision later."""
    return replace(memory, goal=goal_critic.increment_age(memory.goal))
