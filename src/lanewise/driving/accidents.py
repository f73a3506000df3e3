"""The three accidents that end an episode: collision, leaving the road, coming to a stop."""

import jax.numpy as jnp
from jax import Array

from lanewise.world import road
from lanewise.world.state import World

NONE, COLLISION, OFF_ROAD, STOPPED = 0, 1, 2, 3
"""Accident codes; where several happen at once the first of the list is reported."""


def ego_accident(world: World, stopped_speed: float) -> Array:
    """Code of the accident the ego is in, or NONE; int32 [].

    Off the road is highway-env's ``not vehicle.on_road``: the centre is farther from the nearest
    lane's centre than half that lane's width, or beyond its ends by a car length.
    """
    vehicles = world.vehicles
    code = jnp.where(vehicles.speed[0] < stopped_speed, STOPPED, NONE)
    code = jnp.where(off_road(world), OFF_ROAD, code)
    return jnp.where(vehicles.crashed[0], COLLISION, code).astype(jnp.int32)


def off_road(world: World) -> Array:
    """Whether the ego's centre is outside its nearest lane; bool []."""
    x, y = world.vehicles.x[0], world.vehicles.y[0]
    on_lanes = road.lanes_within(world.road, x, y, world.road.width / 2)
    nearest = road.lane_bit(road.closest_lane(world.road, x, y))
    return (on_lanes & nearest) == 0
