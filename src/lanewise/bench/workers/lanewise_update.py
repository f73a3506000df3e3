"""Our double DQN update, sampling from the replay included, in one compiled loop."""

import time
from collections.abc import Callable
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp

from lanewise.learning import learner, replay
from lanewise.learning.learner import Learner
from lanewise.learning.replay import Replay, Transition
from lanewise.learning.settings import LearnerSettings

UPDATES = 100
"""In a compiled call."""


def prepare(
    inputs: int, outputs: int, seconds: float, seed: int = 0
) -> Callable[[], dict[str, Any]]:
    """Fills a replay and compiles; the result updates for ``seconds``, called again it goes on."""
    settings = LearnerSettings()
    keys = jax.random.split(jax.random.key(seed), 3)
    memory = _filled(settings, keys[0], inputs, outputs)
    state = learner.begin(keys[1], settings, inputs, outputs)

    @partial(jax.jit, donate_argnums=0)
    def updates(current: Learner, memory: Replay, key: Any) -> tuple[Learner, Any]:
        def one(number: Any, carry: tuple[Learner, Any]) -> tuple[Learner, Any]:
            current, loss = carry
            batch = replay.sample(memory, jax.random.fold_in(key, number), settings.batch_size)
            current, metrics = learner.update(settings, current, batch)
            return current, loss + metrics.loss

        found: tuple[Learner, Any] = jax.lax.fori_loop(0, UPDATES, one, (current, jnp.float32(0.0)))
        return found

    began = time.perf_counter()
    state, loss = updates(state, memory, keys[2])
    loss.block_until_ready()
    compiling = time.perf_counter() - began

    def measure() -> dict[str, Any]:
        nonlocal state
        done, began = 0, time.perf_counter()
        while time.perf_counter() - began < seconds:
            state, loss = updates(state, memory, jax.random.fold_in(keys[2], done))
            loss.block_until_ready()
            done += UPDATES
        return {
            "updates": done,
            "seconds": time.perf_counter() - began,
            "compile_seconds": compiling,
        }

    return measure


def _filled(settings: LearnerSettings, key: Any, inputs: int, outputs: int) -> Replay:
    count = settings.replay_capacity
    keys = jax.random.split(key, 4)
    return replay.add(
        replay.empty(count, inputs),
        Transition(
            features=jax.random.normal(keys[0], (count, inputs)),
            action=jax.random.randint(keys[1], (count,), 0, outputs),
            reward=jax.random.normal(keys[2], (count,)),
            discount=jnp.full(count, settings.discount),
            next_features=jax.random.normal(keys[3], (count, inputs)),
        ),
        jnp.ones(count, bool),
    )
