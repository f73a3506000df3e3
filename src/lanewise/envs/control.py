"""What an action of an environment is: a low-level action, a goal, or acceleration and steering."""

from dataclasses import dataclass
from typing import Any, Protocol

import jax
import jax.numpy as jnp
from jax import Array

from lanewise.controllers.planned import Planned
from lanewise.controllers.settings import GoalSettings, PlannerSettings
from lanewise.driving import actions, episode, percept
from lanewise.driving.episode import Episode, Outcome
from lanewise.driving.parts import Parts
from lanewise.driving.settings import DrivingSettings

Memory = Any
"""A control's own pytree, carried from step to step."""


@dataclass(frozen=True)
class Rules:
    """What every control needs to know of the episode. Static."""

    driving: DrivingSettings
    parts: Parts
    duration: int
    """Decisions after which an episode is truncated."""


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Driven:
    """What an environment's step led to, one or several decisions later."""

    outcome: Outcome
    """Of the last decision; its reward is the sum over the decisions."""
    timestep_reward: Array
    """[] of these, what counts in the paper's sum: one reward a second, and an accident's."""


class Control(Protocol):
    """How actions drive, written for one world. Static."""

    def begin(self, rules: Rules, state: Episode) -> Memory:
        """The memory at an episode's start."""

    def drive(
        self, rules: Rules, state: Episode, memory: Memory, action: Array
    ) -> tuple[Episode, Memory, Driven]:
        """(the episode after the action, the memory, what the action led to)."""


@dataclass(frozen=True)
class LowLevel:
    """One of the nine low-level actions; int32 []."""

    def begin(self, rules: Rules, state: Episode) -> tuple[()]:
        """Nothing to remember."""
        return ()

    def drive(
        self, rules: Rules, state: Episode, memory: tuple[()], action: Array
    ) -> tuple[Episode, tuple[()], Driven]:
        """One decision."""
        after, outcome = episode.step(rules.driving, state, action, rules.duration, rules.parts)
        return after, memory, of_decision(rules, after, outcome)


@dataclass(frozen=True)
class Continuous:
    """Acceleration and steering as shares of the sizes of the low-level actions; [2], -1 to 1."""

    def begin(self, rules: Rules, state: Episode) -> tuple[()]:
        """Nothing to remember."""
        return ()

    def drive(
        self, rules: Rules, state: Episode, memory: tuple[()], action: Array
    ) -> tuple[Episode, tuple[()], Driven]:
        """One decision."""
        commands = actions.shared(rules.driving.actions, action)
        after, outcome = episode.drive(rules.driving, state, *commands, rules.duration, rules.parts)
        return after, memory, of_decision(rules, after, outcome)


@dataclass(frozen=True)
class Goals:
    """A high-level action: the goal it sets, then the planner until the goal critic ends it."""

    goals: GoalSettings
    planner: PlannerSettings

    def begin(self, rules: Rules, state: Episode) -> Memory:
        """No goal yet."""
        seen = percept.of(rules.driving.observation, state.world)
        return self._planned(rules).start(seen)

    def drive(
        self, rules: Rules, state: Episode, memory: Memory, action: Array
    ) -> tuple[Episode, Memory, Driven]:
        """As many decisions as the goal lasts."""
        planned = self._planned(rules)
        seen = percept.of(rules.driving.observation, state.world)
        (level,) = planned.levels
        memory = level.choose(memory, seen, action)

        def lasts(carry: tuple[Episode, Memory, Driven]) -> Array:
            _, memory, driven = carry
            over = driven.outcome.terminated | driven.outcome.truncated
            goes_on: Array = ~(memory.goal.due | over)
            return goes_on

        def decide(carry: tuple[Episode, Memory, Driven]) -> tuple[Episode, Memory, Driven]:
            state, memory, before = carry
            seen = percept.of(rules.driving.observation, state.world)
            low_level, memory = planned.act(memory, seen)
            state, outcome = episode.step(
                rules.driving, state, low_level, rules.duration, rules.parts
            )
            memory = planned.perceive(memory, percept.of(rules.driving.observation, state.world))
            return state, memory, _sum(before, of_decision(rules, state, outcome))

        found: tuple[Episode, Memory, Driven] = jax.lax.while_loop(
            lasts, decide, decide((state, memory, _nothing(state)))
        )
        return found

    def _planned(self, rules: Rules) -> Planned:
        return Planned(rules.driving, self.goals, self.planner, renewal="critic")


def of_decision(rules: Rules, after: Episode, outcome: Outcome) -> Driven:
    """What a single decision led to."""
    counts = episode.ends_timestep(rules.driving, after, outcome)
    return Driven(outcome, jnp.where(counts, outcome.reward, 0.0))


def _nothing(state: Episode) -> Driven:
    """Before the first decision."""
    zero, no = jnp.zeros_like(state.world.vehicles.x[0]), jnp.bool_(False)
    return Driven(Outcome(zero, jnp.int32(0), no, no), zero)


def _sum(before: Driven, now: Driven) -> Driven:
    """Several decisions as one."""
    return Driven(
        Outcome(
            reward=before.outcome.reward + now.outcome.reward,
            accident=now.outcome.accident,
            terminated=now.outcome.terminated,
            truncated=now.outcome.truncated,
        ),
        before.timestep_reward + now.timestep_reward,
    )
