"""The workloads in JAX that are timed.

Each function prepares (compiles, warms up) and returns a function that works for ``seconds`` and
returns ``{"value": …, "unit": …, "detail": {…}}``.
"""

import time
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from itertools import pairwise
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from lanewise import config
from lanewise.controllers.registry import CONTROLLERS
from lanewise.driving import actions, observation
from lanewise.envs import functional
from lanewise.envs.single import TrapEnv
from lanewise.evaluation.settings import EvaluationSettings
from lanewise.learning import learner, replay
from lanewise.learning.learner import Learner
from lanewise.learning.replay import Replay, Transition
from lanewise.learning.settings import LearnerSettings
from lanewise.system import pinned
from lanewise.training import recipe, stage, trainer
from lanewise.training.rollout import StageConfig
from lanewise.training.stage import ChunkMetrics, StageState
from lanewise.training.trainer import StagePlan

Timed = Callable[[], dict[str, Any]]
CHUNK = 50
"""Decisions in a compiled call of `world`."""
UPDATES = 100
"""In a compiled call of `update`."""
WARM_UP, NEVER = 1_000, 1_000_000_000
"""Environment steps before the first update of a training, and of one that only drives."""
ENDINGS = ("collision", "off_road", "stopped", "truncated")
"""How an episode ends; the accidents in the order of their codes (`driving.accidents`)."""


def world(worlds: int, vehicles: int, lanes: int, seconds: float, seed: int = 0) -> Timed:
    """Vehicle-ticks/s of random driving in compiled chunks, observations and starts included."""
    trap = functional.make(vehicles_ahead=vehicles - 3, lanes=lanes)
    ticks = trap.driving.ticks_per_decision

    def decide(batch: Any, _: None) -> tuple[Any, Any]:
        states, _observations, key = batch
        key, act, start = jax.random.split(key, 3)
        action = jax.random.randint(act, (worlds,), 0, actions.COUNT)
        states, steps = jax.vmap(partial(functional.step, trap))(states, action)
        code = jnp.where(steps.truncated, len(ENDINGS), steps.accident)
        keys = jax.random.split(start, worlds)
        states, observations = functional.restarted(trap, states, steps, keys)
        return (states, observations, key), (code[:, None] == jnp.arange(1, 5)).sum(0)

    def chunk(batch: Any) -> tuple[Any, Any]:
        batch, ended = jax.lax.scan(decide, batch, length=CHUNK)
        return batch, ended.sum(0)

    key, start = jax.random.split(jax.random.key(seed))
    states, steps = jax.vmap(partial(functional.reset, trap))(jax.random.split(start, worlds))
    batch = states, steps.observation, key
    began = time.perf_counter()
    advance = jax.jit(chunk, donate_argnums=0).lower(batch).compile()
    compiling = time.perf_counter() - began
    endings = np.zeros(len(ENDINGS), np.int64)

    def call() -> None:
        nonlocal batch, endings
        batch, ended = advance(batch)
        endings = endings + np.asarray(ended)  # Waits for the chunk.

    # The first episodes begin together; random driving ends most within two chunks.
    call()
    call()

    def timed() -> dict[str, Any]:
        nonlocal endings
        endings = np.zeros_like(endings)
        rate = _calls_per_second(call, seconds) * CHUNK * worlds
        return _result(
            rate * ticks * vehicles,
            "vehicle-ticks/s",
            decisions_per_second=rate,
            vehicles=vehicles,
            lanes=lanes,
            ticks_per_decision=ticks,
            episodes=int(endings.sum()),
            ended=dict(zip(ENDINGS, (endings / max(1, endings.sum())).tolist(), strict=True)),
            compile_seconds=compiling,
        )

    return timed


def decision(vehicles: int, lanes: int, seconds: float, seed: int = 0) -> Timed:
    """Microseconds a decision of one world, through its Gymnasium environment, with resets."""
    env = TrapEnv(vehicles_ahead=vehicles - 3, lanes=lanes)
    drawn = iter(np.random.default_rng(seed).integers(0, actions.COUNT, 10_000_000, np.int8))
    slowest = 0.0
    env.reset(seed=seed)
    env.step(next(drawn))
    env.reset()

    def call() -> None:
        nonlocal slowest
        began = time.perf_counter()
        _, _, terminated, truncated, _ = env.step(next(drawn))
        slowest = max(slowest, time.perf_counter() - began)
        if terminated or truncated:
            env.reset()

    def timed() -> dict[str, Any]:
        mean = 1e6 / _calls_per_second(call, seconds)
        return _result(mean, "microseconds a decision", slowest_seconds=slowest)

    return timed


def update(seconds: float, seed: int = 0) -> Timed:
    """Double DQN updates/s, sampling from a filled replay included, in one compiled loop."""
    settings = LearnerSettings()
    key = jax.random.key(seed)
    memory = _filled_replay(settings, key)
    state = learner.begin(key, settings, observation.SIZE, actions.COUNT)

    @partial(jax.jit, donate_argnums=0)
    def updates(current: Learner, memory: Replay, key: Any) -> tuple[Learner, Any]:
        def one(number: Any, carry: tuple[Learner, Any]) -> tuple[Learner, Any]:
            current, loss = carry
            batch = replay.sample(memory, jax.random.fold_in(key, number), settings.batch_size)
            current, metrics = learner.update(settings, current, batch)
            return current, loss + metrics.loss

        found: tuple[Learner, Any] = jax.lax.fori_loop(0, UPDATES, one, (current, jnp.float32(0.0)))
        return found

    def call() -> None:
        nonlocal state, key
        key, now = jax.random.split(key)
        state, loss = updates(state, memory, now)
        loss.block_until_ready()

    began = time.perf_counter()
    call()
    compiling = time.perf_counter() - began
    work = update_flops(observation.SIZE, settings.hidden, actions.COUNT, settings.batch_size)

    def timed() -> dict[str, Any]:
        rate = _calls_per_second(call, seconds) * UPDATES
        gflops = rate * work / 1e9
        return _result(rate, "updates/s", gflop_per_second=gflops, compile_seconds=compiling)

    return timed


def update_flops(inputs: int, hidden: tuple[int, ...], outputs: int, batch: int) -> float:
    """Floating-point operations of an update's matrix products.

    Three forward passes, and backward one product for each weight matrix and one for each layer's
    input except the first's, each of 2 operations a weight and transition.
    """
    weights = [wide * narrow for wide, narrow in pairwise((inputs, *hidden, outputs))]
    return 2.0 * batch * (4 * sum(weights) + sum(weights[1:]))


def _filled_replay(settings: LearnerSettings, key: Any) -> Replay:
    count, size = settings.replay_capacity, observation.SIZE
    features = jax.random.normal(key, (count, size))
    filling = Transition(
        features=features,
        action=jax.random.randint(key, (count,), 0, actions.COUNT),
        reward=features[:, 0],
        discount=jnp.full(count, settings.discount),
        next_features=jnp.roll(features, 1, axis=0),
    )
    return replay.add(replay.empty(count, size), filling, jnp.ones(count, bool))


def training(worlds: int, seconds: float, seed: int = 0) -> Timed:
    """Environment steps/s of the single-level controller, an update every step.

    The same training is timed again without updates; what it takes less, the updates take.
    """
    began = time.perf_counter()
    learning = _chunk_by_chunk(training_plan(worlds, WARM_UP), seed)
    compiling = time.perf_counter() - began
    driving = _chunk_by_chunk(training_plan(worlds, NEVER), seed)
    steps = stage.CHUNK * worlds

    def timed() -> dict[str, Any]:
        rate = _calls_per_second(learning, seconds) * steps
        whole, drive = 1e3 / rate, 1e3 / (_calls_per_second(driving, seconds / 4) * steps)
        split = {"driving": drive, "updates": whole - drive}
        return _result(rate, "steps/s", milliseconds_a_step=split, compile_seconds=compiling)

    return timed


def training_plan(worlds: int, warm_up: int) -> StagePlan:
    """The stage without end and without validation, its first update after ``warm_up`` steps."""
    settings = config.compose()
    (single_level,) = CONTROLLERS["single-level"].stages
    course = recipe.stage_config(settings, single_level)
    ((name, level),) = course.learning
    level = replace(level, updates_per_step=1.0, learner=replace(level.learner, warm_up=warm_up))
    budget = replace(course.budget, worlds=worlds, decisions=2_000_000_000, keep="last")
    return StagePlan(
        name="single-level",
        config=replace(course, budget=budget, learning=((name, level),)),
        validation=recipe.validation_config(settings, single_level),
        tests=EvaluationSettings(validation_interval=1_000_000),
    )


def _chunk_by_chunk(plan: StagePlan, seed: int) -> Callable[[], None]:
    """A function that advances a training, compiled and past `WARM_UP`, by one chunk."""
    progress = trainer.begin(plan, {}, jax.random.key(seed))
    while progress.counters.decisions <= WARM_UP:
        progress, _ = trainer.advance(plan, {}, progress)

    def call() -> None:
        nonlocal progress
        progress, _ = trainer.advance(plan, {}, progress)  # Waits for the chunk's metrics.

    return call


def many_seeds(count: int, worlds: int, seconds: float, seed: int = 0) -> Timed:
    """Steps/s of all trainings of ``count`` seeds in one compiled loop."""
    course = training_plan(worlds, WARM_UP).config
    state, advance = in_one_loop(course, jax.random.split(jax.random.key(seed), count))

    def call() -> None:
        nonlocal state
        state, metrics = advance(state)
        metrics.episodes.outcome.over.block_until_ready()

    began = time.perf_counter()
    for _ in range(1 + WARM_UP // (worlds * stage.CHUNK)):
        call()
    compiling = time.perf_counter() - began

    def timed() -> dict[str, Any]:
        rate = _calls_per_second(call, seconds) * stage.CHUNK * worlds * count
        return _result(rate, "steps/s, all seeds", compile_seconds=compiling)

    return timed


def in_one_loop(
    course: StageConfig, keys: jax.Array
) -> tuple[StageState, Callable[[StageState], tuple[StageState, ChunkMetrics]]]:
    """`stage.begin` and `stage.advance` for several random keys [S]; advancing consumes the states.

    Seeds lie along the first axis of all but the count of iterations. It is one for all of them, so
    that updates are due for all or for none.
    """
    axes: Any = StageState(key=0, iteration=None, learners=0, replays=0, rollouts=0)  # type: ignore[arg-type]
    begun = jax.vmap(partial(stage.begin, course, {}), out_axes=axes)(keys)
    advance = jax.vmap(partial(stage.advance, course, {}), in_axes=(axes,), out_axes=(axes, 0))
    return begun, pinned.jit(donate_argnums=0)(advance)


def _calls_per_second(call: Callable[[], None], seconds: float) -> float:
    """The rate of a call that is repeated until so many seconds have passed."""
    calls, began = 0, time.perf_counter()
    while not calls or time.perf_counter() - began < seconds:
        call()
        calls += 1
    return calls / (time.perf_counter() - began)


def _result(value: float, unit: str, **detail: Any) -> dict[str, Any]:
    return {"value": value, "unit": unit, "detail": detail}
