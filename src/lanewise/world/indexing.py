"""Values picked by elementwise selection.

Vehicles and lanes are few. A gather is slower on a CPU, and keeps XLA from using vector
instructions in all that is computed from it.
"""

import jax.numpy as jnp
from jax import Array


def select_by_index(values: Array, wanted: Array) -> Array:
    """The wanted value, ``values[wanted]``.

    Args:
        values: [K, ...], of each vehicle or lane.
        wanted: int [Q, ...]; where it is no index, the result is any of the values.

    Returns:
        [Q, ...].
    """
    result = jnp.broadcast_to(values[0], wanted.shape)
    for index in range(1, values.shape[0]):
        result = jnp.where(wanted == index, values[index], result)
    return result
