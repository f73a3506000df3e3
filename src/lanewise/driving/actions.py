"""The nine low-level actions: pairs of acceleration and steering, in highway-env's order."""

import jax.numpy as jnp
from jax import Array

from lanewise.driving.settings import ActionSettings

COUNT = 9
"""Number of low-level actions; index = 3 * (acceleration + 1) + (steering + 1), signs in
{-1, 0, 1} (highway-env's ``DiscreteAction``)."""

IDLE = 4
"""The action that neither accelerates nor steers."""


def signs(action: Array) -> tuple[Array, Array]:
    """Signs of (acceleration, steering) of an action index, each in {-1, 0, 1}; int32."""
    return action // 3 - 1, action % 3 - 1


def index(acceleration_sign: Array, steering_sign: Array) -> Array:
    """Index of the action with these signs, the inverse of `signs`; int32."""
    return (3 * (acceleration_sign + 1) + steering_sign + 1).astype(jnp.int32)


def commands(settings: ActionSettings, action: Array, dtype: jnp.dtype) -> tuple[Array, Array]:
    """Commands of an action: (acceleration in m/s^2, steering in rad, positive to the right)."""
    acceleration, steering = signs(action)
    return (
        acceleration.astype(dtype) * settings.acceleration,
        steering.astype(dtype) * settings.steering,
    )


def shared(settings: ActionSettings, shares: Array) -> tuple[Array, Array]:
    """Commands of a continuous action: (acceleration in m/s^2, steering in rad).

    Args:
        settings: the sizes that 1 stands for.
        shares: [2] of acceleration and steering, clipped to [-1, 1].
    """
    shares = jnp.clip(shares, -1.0, 1.0)
    return shares[0] * settings.acceleration, shares[1] * settings.steering
