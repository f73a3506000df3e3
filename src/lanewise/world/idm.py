"""The intelligent driver model: how hard to accelerate behind a vehicle.

Treiber, Hennecke, Helbing, "Congested traffic states in empirical observations and microscopic
simulations", 2000; in the form of ``highway_env.vehicle.behavior.IDMVehicle``.
"""

import jax.numpy as jnp
from jax import Array

from lanewise.world.motion import not_zero
from lanewise.world.state import Drivers


def power(base: Array, exponent: Array) -> Array:
    """exp(exponent * log(base)), for base >= 0 and exponent > 0 faster than the general power."""
    return jnp.exp(exponent * jnp.log(base))


def free_road(drivers: Drivers, effort: Array) -> Array:
    """Acceleration on an empty lane, a (1 - effort^delta), m/s^2; [N].

    The effort is of the vehicle that would accelerate, a and delta are of ``drivers``.
    """
    return drivers.comfort_acceleration * (1 - power(effort, drivers.exponent))


def desired_gap(drivers: Drivers, speed: Array, closing_speed: Array) -> Array:
    """Distance a driver wants to a leader, s0 + v T + v dv / (2 sqrt(a b)), m.

    It is not floored: a leader that pulls away fast makes it negative (`unfloored-desired-gap`).
    The closing speed dv, m/s, is along the follower's direction and positive when closing in.
    """
    brake = 2 * jnp.sqrt(drivers.comfort_acceleration * drivers.comfort_deceleration)
    return drivers.jam_distance + speed * drivers.time_gap + speed * closing_speed / brake


def interaction(drivers: Drivers, speed: Array, closing_speed: Array, gap: Array) -> Array:
    """Deceleration because of a leader, a (desired gap / gap)^2, m/s^2, never negative; [N].

    The gap is centre to centre along the lane, m.
    """
    ratio = desired_gap(drivers, speed, closing_speed) / not_zero(gap)
    return drivers.comfort_acceleration * ratio * ratio
