"""The intelligent driver model: how hard to accelerate behind a vehicle.

Treiber, Hennecke, Helbing, "Congested traffic states in empirical observations and microscopic
simulations", 2000; in the form of ``highway_env.vehicle.behavior.IDMVehicle``.
"""

import jax.numpy as jnp
from jax import Array

from lanewise.world import neighbours
from lanewise.world.materialize import materialize
from lanewise.world.motion import Motion, not_zero
from lanewise.world.neighbours import Front
from lanewise.world.observers import Observers, all_vehicles, masked_apply
from lanewise.world.state import Drivers, World

CHANGING_COMPACTION = 20
"""One driver in so many is changing lanes; see docs/speed.md."""


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


def following(world: World, motion: Motion, front: Front) -> Array:
    """Deceleration of every vehicle because of its leader, 0 without one, m/s^2; [N]."""
    vehicles = world.vehicles
    leader_speed = front.velocity_x * motion.cosine + front.velocity_y * motion.sine
    braking = interaction(
        world.drivers, vehicles.speed, vehicles.speed - leader_speed, front.x - vehicles.x
    )
    return jnp.where(front.exists, braking, 0)


def accelerate(world: World, motion: Motion, target_lane: Array) -> Array:
    """Acceleration every rule-based driver commands, within its limit, m/s^2; [N].

    While it changes lanes, to the target lane int32 [N] of this tick, the smaller of two lanes'.
    """

    def behind_both(observers: Observers) -> Array:
        front = neighbours.front(world, motion, observers, observers.own(target_lane))
        return jnp.maximum(
            observers.own(braking), following(observers.world, observers.motion, front)
        )

    front = neighbours.front(world, motion, all_vehicles(world, motion), motion.lane)
    braking = materialize(world.vehicles.present, lambda: following(world, motion, front))
    changes = motion.decides & (target_lane != motion.lane)
    braking = masked_apply(world, motion, changes, braking, behind_both, one_in=CHANGING_COMPACTION)
    limit = world.drivers.acceleration_limit
    return jnp.clip(free_road(world.drivers, motion.effort) - braking, -limit, limit)
