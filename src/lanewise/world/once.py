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


def once(present: Array, compute: Callable[[], Tree]) -> Tree:
    """What ``compute`` returns, computed once, however often it is used.

    Args:
        present: bool, any shape, which vehicles exist; where none does, the result is zeros.
        compute: without arguments, returns arrays.

    Returns:
        Its result.
    """

    def nothing() -> Tree:
        shapes = jax.eval_shape(compute)
        zeros: Tree = jax.tree.map(lambda leaf: jnp.zeros(leaf.shape, leaf.dtype), shapes)
        return zeros

    def kept() -> Tree:
        result: Tree = lax.cond(jnp.any(present), compute, nothing)
        return result

    # Elsewhere a conditional costs more than it saves, and waits for the host.
    result: Tree = lax.platform_dependent(cpu=kept, default=compute)
    return result
