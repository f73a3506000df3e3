"""The nearest vehicle ahead and behind, on the lanes a driver cares about.

Vehicles are ranked by position once; then a lane is a set of ranks, and the nearest vehicle on
either side is the next member of that set.
"""

from operator import itemgetter
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jax import Array, lax

from lanewise.world import road as roads
from lanewise.world import sets
from lanewise.world.motion import Motion
from lanewise.world.state import World


class Front(NamedTuple):
    """The nearest vehicle ahead of each vehicle on some lane, arrays [N]."""

    exists: Array
    """bool."""
    x: Array
    """m; meaningless where none exists, as are all other values."""
    velocity_x: Array
    """m/s."""
    velocity_y: Array
    """m/s."""


class Rear(NamedTuple):
    """The nearest vehicle behind each vehicle on some lane, arrays [N]."""

    exists: Array
    """bool."""
    x: Array
    """m; meaningless where none exists, as are all other values."""
    speed: Array
    """m/s."""
    cosine: Array
    """Of its heading."""
    sine: Array
    """Of its heading."""
    effort: Array
    """Its speed over its target speed."""


class Pair(NamedTuple):
    """Both neighbours on one lane."""

    front: Front
    rear: Rear


class Neighbours(NamedTuple):
    """Neighbours of every vehicle on three lanes."""

    own: Pair
    """On its lane."""
    left: Pair
    """On the lane to its left or, while it changes lanes, on its target lane."""
    right: Pair
    """On the lane to its right."""


class Order(NamedTuple):
    """The vehicles sorted by x, of equals the last in the list first; arrays [N]."""

    place: Array
    """int32: how many vehicles stand before this one in the order."""
    behind: Array
    """int32: how many vehicles have a smaller x."""
    vehicle: Array
    """int32: which vehicle stands at a place."""


def sort(x: Array) -> Order:
    """Sort vehicles by position.

    Args:
        x: [N] m.

    Returns:
        Their order.
    """
    index = jnp.arange(x.shape[0])
    behind = jnp.sum(x[None, :] < x[:, None], axis=1, dtype=jnp.int32)
    equal = (x[None, :] == x[:, None]) & (index[None, :] > index[:, None])
    place = behind + jnp.sum(equal, axis=1, dtype=jnp.int32)
    stands = place[None, :] == index[:, None]
    vehicle = jnp.sum(jnp.where(stands, index[None, :], 0), axis=1, dtype=jnp.int32)
    return Order(place, behind, vehicle)


def lane_members(world: World, order: Order) -> sets.Words:
    """For each lane the set of places of the vehicles on it.

    Args:
        world: one world.
        order: of its vehicles.

    Returns:
        Words of shape [M].
    """
    vehicles = world.vehicles
    occupied = roads.occupied_lanes(world.road, vehicles.x, vehicles.y)
    occupied = jnp.where(vehicles.present, occupied, 0)
    bit = 1 << jnp.arange(world.road.present.shape[0], dtype=jnp.int32)
    here = (occupied[None, :] & bit[:, None]) != 0
    bits = sets.single(order.place, vehicles.x.shape[0])
    # Places differ, so that a sum of bits is their union.
    return tuple(
        jnp.sum(jnp.where(here, word[None, :], jnp.uint32(0)), axis=1, dtype=jnp.uint32)
        for word in bits
    )


def search(world: World, motion: Motion, lanes: Array) -> Pair:
    """Neighbours of every vehicle on given lanes.

    ``Road.neighbour_vehicles``: among the other vehicles on the lane, ahead is the nearest with
    x_other >= x, the last in the list winning ties; behind is the nearest with x_other < x, the
    first winning ties. In the `Order` these are the next members of the lane's set on either side.

    Args:
        world: one world.
        motion: its motion.
        lanes: int32 [Q, N], the lane of each query; outside the road nobody is found.

    Returns:
        Neighbours, arrays [Q, N].
    """
    x, speed = world.vehicles.x, world.vehicles.speed
    count = x.shape[0]
    order = sort(x)
    members = lane_members(world, order)

    def look(lane: Array) -> tuple[Array, Array]:
        outside = (lane < 0) | (lane >= members[0].shape[0])
        here = tuple(jnp.where(outside, 0, roads.pick(word, lane)) for word in members)
        behind_me = sets.below(order.behind, count)
        ahead = sets.without(sets.without(here, behind_me), sets.single(order.place, count))
        return sets.smallest(ahead), sets.largest(sets.both(here, behind_me))

    # A loop keeps its results; without it XLA would compute them anew in every use.
    first, last = lax.map(look, lanes)

    def of(place: Array, values: Array) -> Array:
        return sets.member(values, sets.member(order.vehicle, place))

    front = Front(
        exists=first >= 0,
        x=of(first, x),
        velocity_x=of(first, motion.velocity_x),
        velocity_y=of(first, motion.velocity_y),
    )
    rear = Rear(
        exists=last >= 0,
        x=of(last, x),
        speed=of(last, speed),
        cosine=of(last, motion.cosine),
        sine=of(last, motion.sine),
        effort=of(last, motion.effort),
    )
    return Pair(front, rear)


def find(world: World, motion: Motion) -> Neighbours:
    """The neighbours a driver needs to follow its lane, to finish a change or to think of one.

    Args:
        world: one world.
        motion: its motion.

    Returns:
        Neighbours on the own lane, the left (or target) lane and the right lane.
    """
    target = world.vehicles.target_lane
    aside = jnp.where(motion.lane == target, motion.lane - 1, target)
    lanes = jnp.stack([motion.lane, aside, motion.lane + 1])
    found = search(world, motion, lanes)
    return Neighbours(*(jax.tree.map(itemgetter(query), found) for query in range(3)))
