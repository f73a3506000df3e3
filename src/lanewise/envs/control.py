"""What an action of an environment is: a low-level action, a goal, or acceleration and steering."""

from dataclasses import dataclass
from typing import Any, Protocol

import jax
import jax.numpy as jnp
from jax import Array

from lanewise.controllers.planned import Planned
from lanewise.controllers.settings import GoalSettings, PlannerSettings
from lanewise.driving import actions, episode, percept
from lanewise.driving.episode import Episode
from lanewise.driving.settings import DrivingSettings
from lanewise.driving.task_functions import TaskFunctions

Memory = Any
"""A control's own pytree, carried from step to step."""


@dataclass(frozen=True)
class Rules:
    """What every control needs to know of the episode. Static."""

    driving: DrivingSettings
    task: TaskFunctions
    duration: int
    """Decisions after which an episode is truncated."""


class Control(Protocol):
    """How actions drive, written for one world. Static."""

    def begin(self, rules: Rules, state: Episode) -> Memory:
        """The memory at an episode's start."""

    def drive(
        self, rules: Rules, state: Episode, memory: Memory, action: Array
    ) -> tuple[Episode, Memory, Array]:
        """(the episode after the action, the memory, the reward of its decisions, [])."""


@dataclass(frozen=True)
class LowLevelControl:
    """One of the nine low-level actions; int32 []."""

    def begin(self, rules: Rules, state: Episode) -> tuple[()]:
        """Nothing to remember."""
        return ()

    def drive(
        self, rules: Rules, state: Episode, memory: tuple[()], action: Array
    ) -> tuple[Episode, tuple[()], Array]:
        """One decision."""
        after = episode.step(rules.driving, state, action, rules.duration, rules.task)
        return after, memory, after.outcome.reward


@dataclass(frozen=True)
class ContinuousControl:
    """Acceleration and steering as shares of the sizes of the low-level actions; [2], -1 to 1."""

    def begin(self, rules: Rules, state: Episode) -> tuple[()]:
        """Nothing to remember."""
        return ()

    def drive(
        self, rules: Rules, state: Episode, memory: tuple[()], action: Array
    ) -> tuple[Episode, tuple[()], Array]:
        """One decision."""
        commands = actions.shared(rules.driving.actions, action)
        after = episode.step_with_commands(
            rules.driving, state, *commands, rules.duration, rules.task
        )
        return after, memory, after.outcome.reward


@dataclass(frozen=True)
class GoalControl:
    """A high-level action: the goal it sets, then the planner until the goal critic ends it."""

    goals: GoalSettings
    planner: PlannerSettings

    def begin(self, rules: Rules, state: Episode) -> Memory:
        """No goal yet."""
        seen = percept.perceive(rules.driving.observation, state.world)
        return self._planned(rules).start(seen)

    def drive(
        self, rules: Rules, state: Episode, memory: Memory, action: Array
    ) -> tuple[Episode, Memory, Array]:
        """As many decisions as the goal lasts."""
        planned = self._planned(rules)
        seen = percept.perceive(rules.driving.observation, state.world)
        (level,) = planned.levels
        memory = level.choose(memory, seen, action)

        def lasts(carry: tuple[Episode, Memory, Array]) -> Array:
            state, memory, _ = carry
            goes_on: Array = ~(memory.goal.due | state.outcome.over)
            return goes_on

        def decide(carry: tuple[Episode, Memory, Array]) -> tuple[Episode, Memory, Array]:
            state, memory, reward = carry
            seen = percept.perceive(rules.driving.observation, state.world)
            low_level, memory = planned.act(memory, seen)
            state = episode.step(rules.driving, state, low_level, rules.duration, rules.task)
            memory = planned.perceive(
                memory, percept.perceive(rules.driving.observation, state.world)
            )
            return state, memory, reward + state.outcome.reward

        begun = (state, memory, jnp.zeros_like(state.outcome.reward))
        found: tuple[Episode, Memory, Array] = jax.lax.while_loop(lasts, decide, decide(begun))
        return found

    def _planned(self, rules: Rules) -> Planned:
        return Planned(rules.driving, self.goals, self.planner, renewal="critic")
