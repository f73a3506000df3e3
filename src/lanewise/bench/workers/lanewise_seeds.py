"""Our training of many seeds at once, in one compiled loop."""

import time
from collections.abc import Callable
from typing import Any

import jax

from lanewise.bench.workers.lanewise_training import WARM_UP, plan
from lanewise.training import seeds as seeds_at_once
from lanewise.training import stage


def prepare(seeds: int, worlds: int, seconds: float, seed: int = 0) -> Callable[[], dict[str, Any]]:
    """Compiles and trains past the warm-up; the result trains for ``seconds``."""
    course = plan(worlds, WARM_UP).course
    began = time.perf_counter()
    advance = seeds_at_once.advance(course)
    state = seeds_at_once.begin(course, jax.random.split(jax.random.key(seed), seeds))
    for _ in range(1 + WARM_UP // (worlds * stage.CHUNK)):
        state, metrics = advance(state)
    metrics.finished.done.block_until_ready()
    compiling = time.perf_counter() - began

    def measure() -> dict[str, Any]:
        current, chunks = state, 0
        began = time.perf_counter()
        while time.perf_counter() - began < seconds:
            current, metrics = advance(current)
            metrics.finished.done.block_until_ready()
            chunks += 1
        steps = chunks * stage.CHUNK * worlds * seeds
        return {
            "steps": steps,
            "seconds": time.perf_counter() - began,
            "compile_seconds": compiling,
        }

    return measure
