"""The nine low-level actions: pairs of acceleration and steering, in highway-env's order."""

from typing import Any

import jax.numpy as jnp
import numpy as np
from jax import Array
from numpy.typing import NDArray

from lanewise.driving.settings import ActionSettings
from lanewise.errors import ActionError, brief

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
    """Commands of an action: (acceleration in m/s^2, steering in rad, positive to the right).

    A low-level action is an index, int32 []. A continuous one, float [2], holds shares of the sizes
    in the settings; they are clipped to [-1, 1].
    """
    if jnp.issubdtype(action.dtype, jnp.floating):
        acceleration, steering = jnp.clip(action, -1.0, 1.0)
    else:
        acceleration, steering = (sign.astype(dtype) for sign in signs(action))
    return acceleration * settings.acceleration, steering * settings.steering


def checked(given: Any, count: int, shape: tuple[int, ...], wanted: str) -> NDArray[Any]:
    """Actions from outside as compiled functions take them, int32, or float32 for continuous ones.

    Args:
        given: an array, or what NumPy makes one of.
        count: number of discrete actions; 0 for continuous ones, [..., 2] from -1 to 1.
        shape: of the actions.
        wanted: how an error begins: what they must be.

    Raises:
        ActionError: one does not exist. JAX would take another one instead.
    """
    try:
        found = np.asarray(given)
    except Exception as error:  # A ragged list, or a tensor of another device.
        reason = str(error).strip().partition("\n")[0]
        raise ActionError(f"{wanted}, got something that is no array: {brief(reason)}") from error
    if found.shape != shape:
        raise ActionError(f"{wanted}, got {brief(given)} of shape {found.shape}")
    if not are_numbers(found.dtype, count):
        raise ActionError(f"{wanted}, got {brief(found.flat[0])} of type {found.dtype}")
    # What float32 cannot hold becomes infinite, and is out of range.
    with np.errstate(over="ignore"):
        narrow = found if count else found.astype(np.float32)
    exist = (narrow >= 0) & (narrow < count) if count else np.abs(narrow) <= 1.0
    if not exist.all():
        raise ActionError(f"{wanted}, got {found[~exist].flat[0].item()}")
    return narrow.astype(np.int32 if count else np.float32)


def are_numbers(dtype: Any, count: int) -> bool:
    """Whether a type holds whole numbers, as discrete actions are, or for a count of 0 any real."""
    whole = jnp.issubdtype(dtype, jnp.integer) and dtype.kind != "m"  # NumPy's durations.
    return bool(whole or (count == 0 and jnp.issubdtype(dtype, jnp.floating)))
