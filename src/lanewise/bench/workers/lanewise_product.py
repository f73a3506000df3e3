"""XLA's matrix product in the shape of the update's largest one."""

import time
from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp

REPEATS = 1000


def prepare(
    rows: int, inner: int, columns: int, seconds: float, seed: int = 0
) -> Callable[[], dict[str, Any]]:
    """Compiles a chain of products; the result multiplies for ``seconds``.

    Every product depends on the one before, so that none can be left out.
    """
    keys = jax.random.split(jax.random.key(seed), 2)
    left = jax.random.normal(keys[0], (rows, inner))
    right = jax.random.normal(keys[1], (inner, columns)) / inner**0.5

    @jax.jit
    def chain(left: Any, right: Any) -> Any:
        return jax.lax.fori_loop(0, REPEATS, lambda _, x: jnp.dot(x, right), left)

    chain(left, right).block_until_ready()

    def measure() -> dict[str, Any]:
        done, began = 0, time.perf_counter()
        while time.perf_counter() - began < seconds:
            chain(left, right).block_until_ready()
            done += REPEATS
        took = time.perf_counter() - began
        return {"products": done, "seconds": took, "flops": 2.0 * rows * inner * columns * done}

    return measure
