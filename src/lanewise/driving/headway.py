"""How near the ego is to whoever drives ahead of it in its lane."""

from dataclasses import dataclass

import jax
import jax.numpy as jnp
from jax import Array

from lanewise.world import road
from lanewise.world.state import World, select_by_index


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Headway:
    """The ego's lane, and its distance in space and time from the nearest vehicle ahead there."""

    lane: Array
    """int32 [] nearest lane, from 0 at the left."""
    gap: Array
    """[] m, bumper to bumper; infinite where nobody is ahead, negative beside a vehicle between two
    lanes whose centre is ahead."""
    time_to_collision: Array
    """[] s, at the speeds of the moment along the road; infinite where the gap does not shrink, 0
    once it is gone."""


def of_ego(world: World) -> Headway:
    """The headway of vehicle 0.

    As in highway-env's ``Road.neighbour_vehicles``, a vehicle is on each lane it reaches into, |y -
    centre| <= width / 2 + 1 m, and ahead if its centre is not behind the ego's. Of several whose
    centres are level the longest and the slowest count.
    """
    vehicles, length = world.vehicles, world.drivers.length
    x, y = vehicles.x, vehicles.y
    lane = road.closest_lane(world.road, x[0], y[0])
    beyond = jnp.abs(y - select_by_index(world.road.centre, lane)) - road.NEIGHBOUR_MARGIN
    on_lane = beyond <= select_by_index(world.road.width, lane) / 2
    others = jnp.arange(x.shape[0]) > 0
    ahead = others & vehicles.present & on_lane & (x >= x[0])
    distance = jnp.min(jnp.where(ahead, x - x[0], jnp.inf))
    nearest = ahead & (x - x[0] == distance)
    along = vehicles.speed * jnp.cos(vehicles.heading)
    gap = distance - (length[0] + jnp.max(jnp.where(nearest, length, 0.0))) / 2
    closing = along[0] - jnp.min(jnp.where(nearest, along, jnp.inf))
    shrinks = closing > 0.0
    seconds = jnp.maximum(gap, 0.0) / jnp.where(shrinks, closing, 1.0)
    return Headway(lane, gap, jnp.where(shrinks, seconds, jnp.inf))
