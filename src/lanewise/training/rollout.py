"""Driving while learning: one decision in one world, and the transitions it leaves."""

from dataclasses import dataclass
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
from jax import Array

from lanewise.controllers import controller as controllers
from lanewise.controllers.controller import Controller, Level, Parameters
from lanewise.driving import episode, percept
from lanewise.driving.episode import Episode
from lanewise.driving.percept import Percept
from lanewise.driving.settings import DrivingSettings
from lanewise.driving.task_functions import PAPER_TASK, TaskFunctions
from lanewise.learning import exploration, network
from lanewise.learning.replay import Transition
from lanewise.scenario.settings import TrapSettings
from lanewise.training import transitions
from lanewise.training.settings import BudgetSettings, LevelSettings
from lanewise.training.transitions import Pending


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Rollout:
    """One world under way."""

    episode: Episode
    percept: Percept
    memory: Any
    """The controller's memory, which has perceived ``percept``; levels above the first that
    learns have chosen."""
    pending: dict[str, Pending]
    """By level that learns."""


@dataclass(frozen=True)
class StageConfig:
    """What stays the same through a stage. Static."""

    scenario: TrapSettings
    driving: DrivingSettings
    controller: Controller
    """Who drives."""
    budget: BudgetSettings
    learning: tuple[tuple[str, LevelSettings], ...]
    """The levels that learn, in the order in which they choose, and how."""
    task: TaskFunctions = PAPER_TASK
    """How episodes start, and what is observed, rewarded and counted as success."""

    def level(self, name: str) -> Level:
        """A level of the controller."""
        return next(level for level in self.controller.levels if level.name == name)

    @property
    def leading(self) -> int:
        """Number of frozen levels above the first that learns."""
        return [level.name for level in self.controller.levels].index(self.learning[0][0])


def begin(config: StageConfig, parameters: Parameters, key: Array) -> Rollout:
    """A fresh training episode."""
    state = episode.begin(config.task.start(config.scenario, key, "training"))
    seen = percept.perceive(config.driving.observation, state.world, config.task, training=True)
    memory = config.controller.perceive(config.controller.start(seen), seen)
    return Rollout(
        episode=state,
        percept=seen,
        memory=_settle(config, parameters, memory, seen),
        pending={
            name: transitions.empty(settings, config.level(name).feature_count)
            for name, settings in config.learning
        },
    )


def step(
    config: StageConfig,
    parameters: Parameters,
    rollout: Rollout,
    epsilon: dict[str, Array],
    key: Array,
) -> tuple[Rollout, dict[str, tuple[Transition, Array]]]:
    """One decision with exploration; a world whose episode ends is to be begun anew.

    Args:
        config: static settings.
        parameters: of all levels; those of levels that learn are the online ones.
        rollout: the world under way.
        epsilon: by level that learns, [] probability of a random choice.
        key: of this decision's exploration in this world.

    Returns:
        The world after the decision, and by level that learns what `transitions.emit` returns.
    """
    controller = config.controller
    pending, memory = _choose(config, parameters, rollout, epsilon, key)
    before = controller.feedback(memory, rollout.percept).distance
    action, memory = controller.act(memory, rollout.percept)
    state = episode.step(
        config.driving, rollout.episode, action, config.budget.duration, config.task, training=True
    )
    seen = percept.perceive(config.driving.observation, state.world, config.task, training=True)
    feedback = controller.feedback(memory, seen)
    memory = _settle(config, parameters, controller.perceive(memory, seen), seen)

    emitted = {}
    for name, settings in config.learning:
        pending[name] = transitions.accumulate(
            settings, pending[name], state.outcome, feedback, before
        )
        level = config.level(name)
        after, ready = level.features(memory, seen), level.ready(memory)
        emitted[name] = transitions.emit(
            settings, pending[name], state.outcome, feedback, after, ready
        )
    return Rollout(state, seen, memory, pending), emitted


def _settle(config: StageConfig, parameters: Parameters, memory: Any, seen: Percept) -> Any:
    """Let the frozen levels above the learning ones choose.

    Now, so that what a learning level observes after a transition is what it will then act on.
    """
    for level in config.controller.levels[: config.leading]:
        memory, _ = controllers.choose(level, parameters, memory, seen)
    return memory


def _choose(
    config: StageConfig,
    parameters: Parameters,
    rollout: Rollout,
    epsilon: dict[str, Array],
    key: Array,
) -> tuple[dict[str, Pending], Any]:
    """Let the other levels choose, those that learn with exploration: (pending, memory)."""
    seen, memory = rollout.percept, rollout.memory
    pending = dict(rollout.pending)
    for number, level in enumerate(config.controller.levels[config.leading :]):
        if level.name not in pending:
            memory, _ = controllers.choose(level, parameters, memory, seen)
            continue
        level_key = jax.random.fold_in(key, number) if number else key
        features = level.features(memory, seen)
        values = network.q_values(parameters[level.name], features)
        choice = exploration.epsilon_greedy(level_key, values, epsilon[level.name])
        pushed = transitions.push(pending[level.name], features, choice)
        ready = level.ready(memory)
        pending[level.name] = jax.tree.map(partial(jnp.where, ready), pushed, pending[level.name])
        memory = level.choose(memory, seen, choice)
    return pending, memory
