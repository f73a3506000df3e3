"""Keeps XLA from computing a value anew in every place that uses it.

On CPUs XLA makes a loop of its own for each result and copies into it all that leads to the result,
unless that is a division or a root. The nearest vehicle, found by a hundred comparisons, would be
found again for each of its properties. A conditional is where XLA stops copying.
"""

from collections.abc import Callable
from typing import TypeVar

import jax
import jax.numpy as jnp
from jax import Array, lax

Tree = TypeVar("Tree")


def materialize(present: Array, compute: Callable[[], Tree]) -> Tree:
    """What ``compute`` returns, computed once, however often it is used.

    Where no vehicle is present the result is zeros.
    """
    if not on_cpu():
        # A conditional costs more than it saves there, and waits for the host.
        return compute()
    # Traced once: such steps lie within one another, and each would double those inside it.
    traced = jax.jit(compute, inline=True)
    shapes = jax.eval_shape(traced)
    result: Tree = lax.cond(
        jnp.any(present),
        traced,
        lambda: jax.tree.map(lambda leaf: jnp.zeros(leaf.shape, leaf.dtype), shapes),
    )
    return result


def rounded(present: Array, compute: Callable[[], Array]) -> Array:
    """What ``compute`` returns, in float64 rounded before anything is added to it, as in NumPy.

    XLA adds a product without rounding it first, which is faster and all that float32 needs. To
    decide as highway-env does at an edge takes its rounding (`top-speed-edge`). Where no vehicle is
    present the result is zeros.
    """
    exact = jax.eval_shape(compute).dtype == jnp.float64
    return materialize(present, compute) if exact else compute()


def on_cpu() -> bool:
    """Whether programs are compiled for CPUs.

    Asked while tracing and not of `lax.platform_dependent`, which traces for every platform.
    """
    return jax.default_backend() == "cpu"
