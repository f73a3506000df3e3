"""What drivers see of one another: quantities of each vehicle that hold for a whole tick.

Positions change only after everyone has decided, so these are computed once a tick.
"""

from typing import NamedTuple

import jax.numpy as jnp
from jax import Array

from lanewise.world import road as roads
from lanewise.world.materialize import materialize
from lanewise.world.state import RULE_BASED, Vehicles, World, select_by_index

SMALLEST = 1e-2
"""`not_zero` keeps numbers at least this far from zero."""


class HeadingTrig(NamedTuple):
    """Where vehicles are headed, arrays [N].

    It changes once a tick, when they move, and takes as long as any other part of a tick.
    """

    cosine: Array
    """Of the heading."""
    sine: Array
    """Of the heading."""


class Motion(NamedTuple):
    """Derived state of every vehicle, arrays [N]."""

    lane: Array
    """int32: the closest lane."""
    occupied: Array
    """int32: the lanes it is a neighbour on, a set of `road.lane_bit`; none of an absent one."""
    cosine: Array
    """Of the heading."""
    sine: Array
    """Of the heading."""
    velocity_x: Array
    """speed * cosine, m/s (highway-env leaves the slip angle out)."""
    velocity_y: Array
    """speed * sine, m/s."""
    effort: Array
    """Speed over target speed, the base of the IDM's free-road term."""
    decides: Array
    """bool: a rule-based driver that has not crashed."""
    shortfall: Array | None
    """Target speed minus speed, the base of linear drivers' free-road term, m/s; None without."""


def not_zero(value: Array) -> Array:
    """``value`` where its size exceeds 0.01, else plus or minus 0.01 (plus at zero).

    ``highway_env.utils.not_zero``.
    """
    substitute = jnp.where(value >= 0, SMALLEST, -SMALLEST)
    return jnp.where(jnp.abs(value) > SMALLEST, value, substitute.astype(value.dtype))


def heading_trig(vehicles: Vehicles) -> HeadingTrig:
    """Where every vehicle is headed, computed once."""
    return materialize(
        vehicles.present, lambda: HeadingTrig(jnp.cos(vehicles.heading), jnp.sin(vehicles.heading))
    )


def observe(world: World, trig: HeadingTrig) -> Motion:
    """Derive what a tick needs to know of every vehicle.

    The effort is max(speed, 0) / |not_zero(clip(target speed, 0, limit of the own lane))|. The
    shortfall has the target speed unclipped, and is 0 for a plain vehicle without one
    (`content-without-target-speed`).
    """
    vehicles, drivers = world.vehicles, world.drivers
    lane = roads.closest_lane(world.road, vehicles.x, vehicles.y)
    limit = select_by_index(world.road.speed_limit, lane)
    target_speed = jnp.clip(drivers.target_speed, 0, limit)
    cosine, sine = trig
    occupied = roads.occupied_lanes(world.road, vehicles.x, vehicles.y)
    shortfall = None
    if drivers.linear is not None:
        has_target = (drivers.kind == RULE_BASED) | (drivers.target_speed != 0)
        shortfall = jnp.where(has_target, drivers.target_speed - vehicles.speed, 0)
    return Motion(
        lane=lane,
        occupied=jnp.where(vehicles.present, occupied, 0),
        cosine=cosine,
        sine=sine,
        velocity_x=vehicles.speed * cosine,
        velocity_y=vehicles.speed * sine,
        effort=jnp.maximum(vehicles.speed, 0) / jnp.abs(not_zero(target_speed)),
        decides=vehicles.present & (drivers.kind == RULE_BASED) & ~vehicles.crashed,
        shortfall=shortfall,
    )
