"""Lane keeping: a lateral gain inside a heading gain, as the sine of a slip angle.

``highway_env.vehicle.controller.ControlledVehicle.steering_control`` turns the slip angle into a
steering angle, and the bicycle model turns it back; the sine of the slip angle is all that is left.
"""

from math import comb

import jax.numpy as jnp
from jax import Array

from lanewise.world import road as roads
from lanewise.world.motion import not_zero
from lanewise.world.state import World

LATERAL_GAIN = 1 / 0.6
"""1/s."""
HEADING_GAIN = 1 / 0.2
"""1/s."""
SINE_OF_STEEPEST = 0.5**0.5
"""Sine of the steepest heading a lane keeper asks for, 45 degrees."""
ARCSINE = tuple(comb(2 * k, k) / (4**k * (2 * k + 1)) for k in range(18))
"""Coefficients of asin(s) / s in powers of s^2."""


def slip_sine(steering: Array) -> Array:
    """Sine of the slip angle of a steering angle within pi/2, rad: sin(atan(tan(steering) / 2))."""
    half_tangent = jnp.tan(steering) / 2
    return half_tangent / jnp.sqrt(1 + half_tangent * half_tangent)


def from_slip_sine(sine: Array) -> Array:
    """The steering angle of a slip angle's sine, the inverse of `slip_sine`; rad, any shape."""
    return jnp.arctan(2 * sine / jnp.sqrt(1 - sine * sine))


def arcsine(sine: Array) -> Array:
    """The angle of a sine of at most `SINE_OF_STEEPEST` in size, seven times faster than XLA's.

    asin(s) = 2 asin(h) with the sine h = s / sqrt(2 (1 + sqrt(1 - s^2))) of half the angle, whose
    Taylor series ends below the rounding of float64: h^2 is at most 0.15.
    """
    half = sine / jnp.sqrt(2 * (1 + jnp.sqrt(1 - sine * sine)))
    square = half * half
    series = jnp.full_like(square, ARCSINE[-1])
    for coefficient in reversed(ARCSINE[:-1]):
        series = series * square + coefficient
    return 2 * half * series


def wrapped(angle: Array) -> Array:
    """An angle brought into [-pi, pi), rad; any shape."""
    return angle - 2 * jnp.pi * jnp.floor((angle + jnp.pi) / (2 * jnp.pi))


def keep_lane(world: World, target_lane: Array) -> Array:
    """Sine of the slip angle, [N], with which vehicles steer to the centres of their target lanes.

    sin(reference) = clip(-k_y offset / v, sin 45 deg); sin(slip) = clip(L / (2 v) k_psi
    wrap(reference - heading)), limited by the steering limit.
    """
    vehicles = world.vehicles
    speed = not_zero(vehicles.speed)
    offset = roads.lateral_offset(world.road, target_lane, vehicles.y)
    reference = arcsine(
        jnp.clip(-LATERAL_GAIN * offset / speed, -SINE_OF_STEEPEST, SINE_OF_STEEPEST)
    )
    turn_rate = HEADING_GAIN * wrapped(reference - vehicles.heading)
    limit = world.drivers.slip_limit
    return jnp.clip(world.drivers.length / 2 / speed * turn_rate, -limit, limit)
