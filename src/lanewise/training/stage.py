"""A training stage: its state, and the compiled chunk that advances it.

The host advances a stage chunk by chunk; inside a chunk there is no input, output or choice of
the host's. All randomness comes from the stage's key and the iteration's number, so a stage that
is stopped between chunks and continued later runs to the same bits.
"""

from dataclasses import dataclass
from functools import partial
from math import floor

import jax
import jax.numpy as jnp
from jax import Array

from lanewise.controllers.controller import Parameters
from lanewise.learning import exploration, learner, replay
from lanewise.learning.learner import Learner
from lanewise.learning.replay import Replay
from lanewise.training import rollout
from lanewise.training.rollout import Course, Finished, Rollout
from lanewise.training.settings import StageSettings

CHUNK = 50
"""Iterations in a compiled chunk; an iteration is one decision in every world."""


Sums = tuple[Array, Array, Array]
"""Over the updates of a chunk: their number, their losses, their mean Q-values."""


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class StageState:
    """Everything a stage needs to go on."""

    key: Array
    """The stage's random key; never consumed, only folded with named streams."""
    iteration: Array
    """int32 [] iterations done."""
    learner: Learner
    replay: Replay
    rollouts: Rollout
    """Every field with a leading axis over the worlds."""


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class ChunkMetrics:
    """What a chunk reports; the host makes lines and curves of it."""

    finished: Finished
    """[CHUNK, worlds] facts about episodes, meaningful where ``done``."""
    epsilon: Array
    """[] at the chunk's end."""
    loss: Array
    """[] mean over the chunk's updates; NaN if there was none."""
    mean_q: Array
    """[] mean Q-value of the replayed choices; NaN if there was no update."""
    transitions: Array
    """int32 [] written to the replay so far."""
    updates: Array
    """int32 [] so far."""


@partial(jax.jit, static_argnums=0)
def begin(course: Course, frozen: Parameters, key: Array) -> StageState:
    """The state before the first decision.

    Args:
        course: the stage's static settings.
        frozen: parameters of levels that do not learn here; may be empty.
        key: the stage's random key.
    """
    controller, settings = course.controller, course.stage
    network_key, start_key = (jax.random.fold_in(key, stream) for stream in (0, 1))
    state = learner.begin(
        network_key, settings.learner, controller.feature_count, controller.choice_count
    )
    parameters = frozen | {controller.learns: state.online}
    start_keys = jax.random.split(start_key, settings.worlds)
    return StageState(
        # A copy, because `advance` consumes the state it is given and the caller keeps its key.
        key=jax.random.clone(key),  # type: ignore[no-untyped-call]
        iteration=jnp.int32(0),
        learner=state,
        replay=replay.empty(settings.learner.replay_capacity, controller.feature_count),
        rollouts=jax.vmap(partial(rollout.begin, course, parameters))(start_keys),
    )


@partial(jax.jit, static_argnums=0, donate_argnums=2)
def advance(
    course: Course, frozen: Parameters, state: StageState
) -> tuple[StageState, ChunkMetrics]:
    """Advance a stage by `CHUNK` iterations; ``state`` is consumed.

    Returns:
        The state afterwards, and the chunk's metrics.
    """
    zero = jnp.float32(0.0)
    (state, sums), finished = jax.lax.scan(
        partial(_iterate, course, frozen), (state, (zero, zero, zero)), length=CHUNK
    )
    updates, loss, mean_q = sums
    metrics = ChunkMetrics(
        finished=finished,
        epsilon=epsilon(course.stage, state.iteration),
        loss=loss / updates,
        mean_q=mean_q / updates,
        transitions=state.replay.position,
        updates=state.learner.updates,
    )
    return state, metrics


def epsilon(settings: StageSettings, iteration: Array) -> Array:
    """Epsilon at an iteration, counted over all worlds or in each (row 15 of the reading)."""
    steps = iteration
    if settings.exploration.counted == "all-worlds":
        steps = iteration * settings.worlds
    return exploration.epsilon(settings.exploration, steps)


def _iterate(
    course: Course, frozen: Parameters, carry: tuple[StageState, Sums], _: None
) -> tuple[tuple[StageState, Sums], Finished]:
    """One decision in every world, then the updates that are due."""
    state, sums = carry
    step_key, update_key = jax.random.split(jax.random.fold_in(state.key, state.iteration + 2))
    state, finished = _drive(course, frozen, state, step_key)
    state, sums = _learn(course, state, sums, update_key)
    return (state, sums), finished


def _drive(
    course: Course, frozen: Parameters, state: StageState, key: Array
) -> tuple[StageState, Finished]:
    """One decision in every world; complete transitions go to the replay."""
    parameters = frozen | {course.controller.learns: state.learner.online}
    now = epsilon(course.stage, state.iteration)
    rollouts, transitions, emitted, finished = jax.vmap(
        lambda world, world_key: rollout.step(course, parameters, world, now, world_key)
    )(state.rollouts, jax.random.split(key, course.stage.worlds))
    after = StageState(
        key=state.key,
        iteration=state.iteration + 1,
        learner=state.learner,
        replay=replay.add(state.replay, transitions, emitted),
        rollouts=rollouts,
    )
    return after, finished


def _learn(course: Course, state: StageState, sums: Sums, key: Array) -> tuple[StageState, Sums]:
    """The updates due after this iteration: a loop of traced length, none during the warm-up.

    A loop and not a conditional: a conditional inside a compiled loop may copy its whole carry,
    the replay included.
    """
    settings = course.stage

    def update(index: Array, carry: tuple[Learner, Sums]) -> tuple[Learner, Sums]:
        current, (count, loss, mean_q) = carry
        batch = replay.sample(
            state.replay, jax.random.fold_in(key, index), settings.learner.batch_size
        )
        current, metrics = learner.update(settings.learner, current, batch)
        return current, (count + 1.0, loss + metrics.loss, mean_q + metrics.mean_q)

    due = updates_due(settings, state.iteration)
    after, sums = jax.lax.fori_loop(0, due, update, (state.learner, sums))
    return StageState(state.key, state.iteration, after, state.replay, state.rollouts), sums


def updates_due(settings: StageSettings, iteration: Array) -> Array:
    """Updates after iteration number ``iteration``, the first being 1; int32 [].

    Their running total follows ``updates_per_step``.
    """
    rate = settings.updates_per_step * settings.worlds
    whole, part = floor(rate), rate - floor(rate)
    # The whole part apart, so that a float32 product of the count stays exact enough.
    extra = jnp.floor(iteration * part) - jnp.floor((iteration - 1) * part)
    warm = iteration * settings.worlds > settings.learner.warm_up
    return jnp.where(warm, whole + extra, 0).astype(jnp.int32)
