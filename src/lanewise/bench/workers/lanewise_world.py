"""Our world under random driving, in compiled chunks."""

import time
from collections.abc import Callable
from functools import partial
from typing import Any

import jax
import numpy as np

from lanewise.bench import random_driving
from lanewise.bench.random_driving import CHUNK, Drive


def prepare(
    worlds: int, vehicles: int, lanes: int, seconds: float, seed: int
) -> Callable[[], dict[str, Any]]:
    """Compiles and drives a first chunk; the result drives for ``seconds``."""
    drive = Drive(vehicles, lanes)
    batch = jax.jit(partial(random_driving.begin, drive, seed, worlds))()
    began = time.perf_counter()
    chunk = jax.jit(partial(random_driving.chunk, drive, seed), donate_argnums=0)
    advance = chunk.lower(batch).compile()
    compiling = time.perf_counter() - began
    # The first episodes begin together; random driving ends most within two chunks.
    for _ in range(2):
        batch, _ended = advance(batch)
    batch[1].block_until_ready()

    def measure() -> dict[str, Any]:
        current, decisions, ended = batch, 0, np.zeros(5, np.int64)
        began = time.perf_counter()
        while decisions == 0 or time.perf_counter() - began < seconds:
            current, counts = advance(current)
            ended += np.asarray(counts)  # waits for the chunk
            decisions += worlds * CHUNK
        return {
            "decisions": decisions,
            "seconds": time.perf_counter() - began,
            "ticks_per_decision": drive.driving.ticks_per_decision,
            "ended": dict(zip(random_driving.ENDINGS, ended[1:].tolist(), strict=True)),
            "compile_seconds": compiling,
        }

    return measure
