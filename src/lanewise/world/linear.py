"""A driver whose commands are linear in its parameters, along the road and across it.

In the form of ``highway_env.vehicle.behavior.LinearVehicle``, of which ``AggressiveVehicle`` and
``DefensiveVehicle`` are other parameters.
"""

import jax.numpy as jnp
from jax import Array

from lanewise.world import road as roads
from lanewise.world.motion import not_zero
from lanewise.world.state import Drivers, Linear, World
from lanewise.world.steering import from_slip_sine, slip_sine, wrapped


def free_road(law: Linear, shortfall: Array) -> Array:
    """Acceleration on an empty lane, k_0 (v_target - v), m/s^2; [N].

    The shortfall v_target - v is of the vehicle that would accelerate, k_0 is of ``law``.
    """
    return law.target_speed_gain * shortfall


def safe_gap(drivers: Drivers, speed: Array) -> Array:
    """Distance below which a driver brakes, d_safe = s0 + max(v, 0) T, m, centre to centre; [N]."""
    return drivers.jam_distance + jnp.maximum(speed, 0) * drivers.time_gap


def interaction(
    drivers: Drivers, law: Linear, speed: Array, leader_speed: Array, gap: Array
) -> Array:
    """Deceleration because of a leader, k_1 max(v - v_l, 0) + k_2 max(d_safe - d, 0), m/s^2; [N].

    Speeds are along each vehicle's own heading (`unprojected-speeds`), m/s. The gap d is centre to
    centre along the lane, m.
    """
    closing = jnp.maximum(speed - leader_speed, 0)
    too_near = jnp.maximum(safe_gap(drivers, speed) - gap, 0)
    return law.relative_speed_gain * closing + law.gap_gain * too_near


def keep_lane(world: World, law: Linear, target_lane: Array) -> Array:
    """Sine of the slip angle, [N], with which vehicles steer to the centres of their target lanes.

    The steering angle is L (k_psi wrap(-heading) / v - k_y offset / v^2), limited by the steering
    limit. No angle is limited before: far from the centre a vehicle turns until it drives across
    (`unlimited-approach`).
    """
    vehicles, drivers = world.vehicles, world.drivers
    speed = not_zero(vehicles.speed)
    offset = roads.lateral_offset(world.road, target_lane, vehicles.y)
    turn = law.heading_gain * wrapped(-vehicles.heading) - law.offset_gain * offset / speed
    limit = from_slip_sine(drivers.slip_limit)
    return slip_sine(jnp.clip(drivers.length / speed * turn, -limit, limit))
