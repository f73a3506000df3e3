"""One of our worlds stepped from Python: one compiled call a decision, its observation in NumPy."""

import time
from collections.abc import Callable
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from lanewise.bench import random_driving
from lanewise.bench.random_driving import ENDINGS, Drive
from lanewise.driving import episode, percept


def prepare(vehicles: int, lanes: int, seconds: float, seed: int) -> Callable[[], dict[str, Any]]:
    """Compiles start and step; the result drives for ``seconds``, with fresh starts."""
    drive = Drive(vehicles, lanes)
    actions = np.random.default_rng(seed).integers(0, 9, 10_000, np.int32)

    @jax.jit
    def start(index: Any) -> Any:
        return random_driving.fresh(drive, seed, index)

    @partial(jax.jit, donate_argnums=0)
    def step(before: Any, action: Any) -> Any:
        after, outcome = episode.step(drive.driving, before, action, drive.duration)
        features = percept.of(drive.driving.observation, after.world).features
        done = outcome.terminated | outcome.truncated
        # One array to fetch instead of three.
        facts = jnp.stack([outcome.reward, done, outcome.accident])
        return after, jnp.concatenate([features, facts])

    def decide(state: Any, number: int) -> Any:
        state, seen = step(state, actions[number % len(actions)])
        return state, np.asarray(seen)

    decide(start(0)[0], 0)

    def measure() -> dict[str, Any]:
        ended = [0] * len(ENDINGS)
        decisions, episodes, slowest = 0, 0, 0.0
        state = start(0)[0]
        began = time.perf_counter()
        while time.perf_counter() - began < seconds:
            asked = time.perf_counter()
            state, seen = decide(state, decisions)
            slowest = max(slowest, time.perf_counter() - asked)
            decisions += 1
            if seen[-2]:
                ended[int(seen[-1]) - 1] += 1  # code 0, no accident, is the last: truncated
                episodes += 1
                state = start(episodes)[0]
        return {
            "decisions": decisions,
            "seconds": time.perf_counter() - began,
            "ticks_per_decision": drive.driving.ticks_per_decision,
            "ended": dict(zip(ENDINGS, ended, strict=True)),
            "slowest_seconds": slowest,
        }

    return measure
