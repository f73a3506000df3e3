"""The three accidents that end an episode: collision, leaving the road, coming to a stop."""

import jax.numpy as jnp
from jax import Array

from lanewise.world import road
from lanewise.world.state import World, select_by_index

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
    lane = road.closest_lane(world.road, x, y)
    aside = jnp.abs(road.lateral_offset(world.road, lane, y))
    along = x - select_by_index(world.road.start, lane)
    length = select_by_index(world.road.end, lane) - select_by_index(world.road.start, lane)
    on_lane = (
        (aside <= select_by_index(world.road.width, lane) / 2)
        & (along >= -road.END_MARGIN)
        & (along < length + road.END_MARGIN)
    )
    return ~on_lane
