"""Our training of many seeds at once, in one compiled loop: what a GPU is for."""

import time
from collections.abc import Callable
from functools import partial
from typing import Any

import jax

from lanewise.bench.workers.lanewise_training import WARM_UP, plan
from lanewise.training import stage
from lanewise.training.rollout import Course
from lanewise.training.stage import ChunkMetrics, StageState


def prepare(seeds: int, worlds: int, seconds: float, seed: int = 0) -> Callable[[], dict[str, Any]]:
    """Compiles and trains past the warm-up; the result trains for ``seconds``."""
    course = plan(worlds, WARM_UP).course
    began = time.perf_counter()
    advance = together(course)
    state = begin(course, jax.random.split(jax.random.key(seed), seeds))
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


def begin(course: Course, keys: jax.Array) -> StageState:
    """The states of a stage for several random keys, along the first axis of all but the count."""
    begun: StageState = jax.vmap(partial(stage.begin, course, {}), out_axes=AXES)(keys)
    return begun


def together(course: Course) -> Callable[[StageState], tuple[StageState, ChunkMetrics]]:
    """`stage.advance` for several seeds at once; the states are consumed."""
    one = partial(stage.advance, course, {})
    return jax.jit(jax.vmap(one, in_axes=(AXES,), out_axes=(AXES, 0)), donate_argnums=0)


AXES: Any = StageState(key=0, iteration=None, learners=0, replays=0, rollouts=0)  # type: ignore[arg-type]
"""The count of iterations is one for all seeds, so that updates are due for all or for none."""
