"""A training stage: its state, and the compiled chunk that advances it.

The host advances a stage chunk by chunk; inside a chunk there is no input, output or choice of
the host's. All randomness comes from the stage's key and the iteration's number, so a stage that
is stopped between chunks and continued later runs to the same bits.
"""

from dataclasses import dataclass, replace
from functools import partial
from math import floor

import jax
import jax.numpy as jnp
from jax import Array

from lanewise.controllers.controller import Parameters
from lanewise.driving import restarting
from lanewise.driving.episode import EpisodeStats
from lanewise.learning import exploration, learner, replay
from lanewise.learning.learner import Learner
from lanewise.learning.replay import Replay
from lanewise.system import pinned
from lanewise.training import finite_checks, rollout
from lanewise.training.finite_checks import ChunkFinite, IterationFinite, Sums
from lanewise.training.rollout import Rollout, StageConfig
from lanewise.training.settings import LevelSettings

CHUNK = 50
"""Iterations in a compiled chunk; an iteration is one decision in every world."""
LEVEL_STREAM = 1_000_000
"""First random stream of the levels after the first that learns."""


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class StageState:
    """Everything a stage needs to go on."""

    key: Array
    """The stage's random key; never consumed, only folded with named streams."""
    iteration: Array
    """int32 [] iterations done."""
    learners: dict[str, Learner]
    """By level that learns."""
    replays: dict[str, Replay]
    """By level that learns."""
    rollouts: Rollout
    """Every field with a leading axis over the worlds."""


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class LevelMetrics:
    """What a chunk reports of a level that learns."""

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


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class ChunkMetrics:
    """What a chunk reports; the host makes records and curves of it."""

    episodes: EpisodeStats
    """[CHUNK, worlds] after each decision; whole episodes where ``outcome.over``."""
    levels: dict[str, LevelMetrics]
    """By level that learns."""
    finite: ChunkFinite
    """Whether all numbers were."""


@pinned.jit(static_argnums=0)
def begin(config: StageConfig, frozen: Parameters, key: Array) -> StageState:
    """The state before the first decision; ``frozen`` are the levels that do not learn here."""
    network_key, start_key = (jax.random.fold_in(key, stream) for stream in (0, 1))
    learners, replays = {}, {}
    for number, (name, settings) in enumerate(config.learning):
        level = config.level(name)
        level_key, sizes = _of_level(network_key, number), (level.feature_count, level.choice_count)
        learners[name] = learner.begin(level_key, settings.learner, *sizes)
        replays[name] = replay.empty(settings.learner.replay_capacity, level.feature_count)
    parameters = frozen | online(learners)
    start_keys = jax.random.split(start_key, config.budget.worlds)
    return StageState(
        # A copy, because `advance` consumes the state it is given and the caller keeps its key.
        key=jax.random.clone(key),  # type: ignore[no-untyped-call]
        iteration=jnp.int32(0),
        learners=learners,
        replays=replays,
        rollouts=jax.vmap(partial(rollout.begin, config, parameters))(start_keys),
    )


def online(learners: dict[str, Learner]) -> Parameters:
    """The online parameters of the levels that learn."""
    return {name: state.online for name, state in learners.items()}


def _of_level(key: Array, number: int) -> Array:
    """The random key of the level of that number; the first takes the key itself."""
    return jax.random.fold_in(key, LEVEL_STREAM + number) if number else key


@pinned.jit(static_argnums=0, donate_argnums=2)
def advance(
    config: StageConfig, frozen: Parameters, state: StageState
) -> tuple[StageState, ChunkMetrics]:
    """Advance a stage by `CHUNK` iterations; ``state`` is consumed."""
    return iterate(config, frozen, state, CHUNK)


def iterate(
    config: StageConfig, frozen: Parameters, state: StageState, count: int
) -> tuple[StageState, ChunkMetrics]:
    """As `advance`, by any number of iterations, to be compiled by the caller."""
    zero = jnp.float32(0.0)
    nothing: dict[str, Sums] = {name: (zero, zero, zero) for name, _ in config.learning}
    (state, sums), (episodes, looks) = jax.lax.scan(
        partial(_iterate, config, frozen), (state, nothing), length=count
    )
    levels = {
        name: _level_metrics(config, settings, state, name, sums[name])
        for name, settings in config.learning
    }
    found = finite_checks.of_chunk(
        looks, episodes, state.rollouts, sums, state.learners, state.replays
    )
    return state, ChunkMetrics(episodes=episodes, levels=levels, finite=found)


def _level_metrics(
    config: StageConfig, settings: LevelSettings, state: StageState, name: str, sums: Sums
) -> LevelMetrics:
    updates, loss, mean_q = sums
    return LevelMetrics(
        epsilon=epsilon(settings, config.budget.worlds, state.iteration),
        loss=loss / updates,
        mean_q=mean_q / updates,
        transitions=state.replays[name].position,
        updates=state.learners[name].updates,
    )


def epsilon(settings: LevelSettings, worlds: int, iteration: Array) -> Array:
    """Epsilon at an iteration, counted over all worlds or in each (row 15 of the reading)."""
    steps = iteration
    if settings.exploration.counted == "all-worlds":
        steps = iteration * worlds
    return exploration.epsilon(settings.exploration, steps)


def _iterate(
    config: StageConfig, frozen: Parameters, carry: tuple[StageState, dict[str, Sums]], _: None
) -> tuple[tuple[StageState, dict[str, Sums]], tuple[EpisodeStats, IterationFinite]]:
    """One decision in every world, then the updates that are due."""
    state, sums = carry
    looked = finite_checks.between(state.rollouts, sums)
    step_key, update_key = jax.random.split(jax.random.fold_in(state.key, state.iteration + 2))
    state, stats = _drive(config, frozen, state, step_key)
    learners, sums = dict(state.learners), dict(sums)
    for number, (name, settings) in enumerate(config.learning):
        due = updates_due(settings, config.budget.worlds, state.iteration)
        key = _of_level(update_key, number)
        learners[name], sums[name] = _learn(
            settings, learners[name], state.replays[name], sums[name], due, key
        )
    return (replace(state, learners=learners), sums), (stats, looked)


def _drive(
    config: StageConfig, frozen: Parameters, state: StageState, key: Array
) -> tuple[StageState, EpisodeStats]:
    """One decision in every world; complete transitions go to the replays."""
    parameters = frozen | online(state.learners)
    worlds = config.budget.worlds
    now = {name: epsilon(settings, worlds, state.iteration) for name, settings in config.learning}
    keys, start_keys = jax.vmap(jax.random.split, out_axes=1)(jax.random.split(key, worlds))
    rollouts, emitted = jax.vmap(
        lambda world, world_key: rollout.step(config, parameters, world, now, world_key)
    )(state.rollouts, keys)
    stats = rollouts.episode.stats
    rollouts = restarting.restart_finished(
        stats.outcome.over,
        rollouts,
        lambda over: jax.vmap(partial(rollout.begin, config, parameters))(start_keys[over]),
    )
    replays = dict(state.replays)
    for name, _ in config.learning:
        # [worlds, n] in one row.
        flat = jax.tree.map(lambda leaf: leaf.reshape(-1, *leaf.shape[2:]), emitted[name])
        replays[name] = replay.add(replays[name], *flat)
    after = replace(state, iteration=state.iteration + 1, replays=replays, rollouts=rollouts)
    return after, stats


def _learn(
    settings: LevelSettings, state: Learner, memory: Replay, sums: Sums, due: Array, key: Array
) -> tuple[Learner, Sums]:
    """A level's updates after an iteration: a loop of traced length, none during the warm-up.

    A loop and not a conditional: a conditional inside a compiled loop may copy its whole carry,
    the replay included.
    """

    def update(index: Array, carry: tuple[Learner, Sums]) -> tuple[Learner, Sums]:
        current, (count, loss, mean_q) = carry
        batch = replay.sample(memory, jax.random.fold_in(key, index), settings.learner.batch_size)
        current, metrics = learner.update(settings.learner, current, batch)
        return current, (count + 1.0, loss + metrics.loss, mean_q + metrics.mean_q)

    after: tuple[Learner, Sums] = jax.lax.fori_loop(0, due, update, (state, sums))
    return after


def updates_due(settings: LevelSettings, worlds: int, iteration: Array) -> Array:
    """A level's updates after iteration number ``iteration``, the first being 1; int32 [].

    Their running total follows ``updates_per_step``.
    """
    rate = settings.updates_per_step * worlds
    whole, part = floor(rate), rate - floor(rate)
    # The whole part apart, so that a float32 product of the count stays exact enough.
    extra = jnp.floor(iteration * part) - jnp.floor((iteration - 1) * part)
    warm = iteration * worlds > settings.learner.warm_up
    return jnp.where(warm, whole + extra, 0).astype(jnp.int32)
