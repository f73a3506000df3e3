"""What an action of an environment is: a low-level action, a goal, or acceleration and steering."""

from dataclasses import dataclass
from typing import Any, Protocol

import jax
import jax.numpy as jnp
from jax import Array

from lanewise.controllers import goals
from lanewise.controllers.hierarchical import Planned
from lanewise.controllers.settings import GoalSettings, PlannerSettings
from lanewise.driving import actions, episode, percept
from lanewise.driving.episode import Episode
from lanewise.driving.settings import DrivingSettings
from lanewise.driving.task_functions import TaskFunctions
from lanewise.scenario.settings import TrapSettings

Memory = Any
"""A control's own pytree, carried from step to step."""
Driven = tuple[Episode, Memory, Array]
"""(the episode after an action, the memory, the reward of its decisions, [])."""


@dataclass(frozen=True)
class EnvConfig:
    """What stays the same through all episodes. Static: an argument of compiled functions."""

    scenario: TrapSettings
    driving: DrivingSettings
    task: TaskFunctions
    control: "Control"
    duration: int
    """Decisions after which an episode is truncated."""
    split: str
    """From which starts: ``training``, ``validation`` or ``test``."""


class Control(Protocol):
    """How actions drive, written for one world. Static."""

    @property
    def count(self) -> int:
        """Number of actions, int32 []; 0 for continuous ones, [2] from -1 to 1."""

    def begin(self, config: EnvConfig, state: Episode) -> Memory:
        """The memory at an episode's start."""

    def drive(self, config: EnvConfig, state: Episode, memory: Memory, action: Array) -> Driven:
        """What becomes of an action."""


@dataclass(frozen=True)
class DirectControl:
    """Commands for one decision: a low-level action, or shares of the sizes of these."""

    count: int = actions.COUNT

    def begin(self, config: EnvConfig, state: Episode) -> tuple[()]:
        """Nothing to remember."""
        return ()

    def drive(self, config: EnvConfig, state: Episode, memory: tuple[()], action: Array) -> Driven:
        """One decision."""
        after = episode.step(
            *(config.driving, state, action, config.duration, config.task),
            training=config.split != "test",
        )
        return after, memory, after.outcome.reward


@dataclass(frozen=True)
class GoalControl:
    """A high-level action: the goal it sets, then the planner until the goal critic ends it."""

    goals: GoalSettings
    planner: PlannerSettings

    @property
    def count(self) -> int:
        """High-level actions."""
        return goals.action_count(self.goals)

    def planned(self, driving: DrivingSettings) -> Planned:
        """The controller whose high level's place the actions take."""
        return Planned(driving, self.goals, self.planner, renewal="critic")

    def begin(self, config: EnvConfig, state: Episode) -> Memory:
        """No goal yet."""
        seen = percept.perceive(config.driving.observation, state.world)
        return self.planned(config.driving).start(seen)

    def drive(self, config: EnvConfig, state: Episode, memory: Memory, action: Array) -> Driven:
        """As many decisions as the goal lasts."""
        planned = self.planned(config.driving)
        seen = percept.perceive(config.driving.observation, state.world)
        (level,) = planned.levels
        memory = level.choose(memory, seen, action)

        def lasts(carry: Driven) -> Array:
            state, memory, _ = carry
            goes_on: Array = ~(memory.goal.due | state.outcome.over)
            return goes_on

        def decide(carry: Driven) -> Driven:
            state, memory, reward = carry
            seen = percept.perceive(config.driving.observation, state.world)
            low_level, memory = planned.act(memory, seen)
            state = episode.step(
                *(config.driving, state, low_level, config.duration, config.task),
                training=config.split != "test",
            )
            memory = planned.perceive(
                memory, percept.perceive(config.driving.observation, state.world)
            )
            return state, memory, reward + state.outcome.reward

        begun = (state, memory, jnp.zeros_like(state.outcome.reward))
        found: Driven = jax.lax.while_loop(lasts, decide, begun)
        return found
