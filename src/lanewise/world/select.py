"""Values picked by elementwise selection.

Vehicles and lanes are few. A gather is slower on a CPU, and keeps XLA from using vector
instructions in all that is computed from it.
"""

import jax.numpy as jnp
from jax import Array


def pick(values: Array, wanted: Array, keys: Array | None = None) -> Array:
    """The value that has the wanted key: ``values[wanted]``, where the keys are the indices.

    Args:
        values: [K, ...], of each vehicle or lane.
        wanted: int [Q, ...]; where no key is wanted, the result is any of the values.
        keys: int [K, ...], all different; None for the indices.

    Returns:
        [Q, ...].
    """
    result = jnp.broadcast_to(values[0], wanted.shape)
    for index in range(1, values.shape[0]):
        key = index if keys is None else keys[index]
        result = jnp.where(wanted == key, values[index], result)
    return result
