"""The nearest vehicle ahead and behind, on the lanes a driver cares about.

Vehicles are ranked by position once; then a lane is a set of ranks, and the nearest vehicle on
either side is the next member of that set.
"""

from functools import reduce
from operator import or_
from typing import NamedTuple

import jax.numpy as jnp
from jax import Array

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


def sort(x: Array) -> Order:
    """Sort vehicles by position.

    Args:
        x: [N] m.

    Returns:
        Their order.
    """
    index = jnp.arange(x.shape[0])
    behind = jnp.zeros(x.shape, jnp.int32)
    equal = jnp.zeros(x.shape, jnp.int32)
    for other in range(x.shape[0]):
        behind += (x[other] < x).astype(jnp.int32)
        equal += ((x[other] == x) & (other > index)).astype(jnp.int32)
    return Order(behind + equal, behind)


def lane_members(world: World, order: Order) -> tuple[sets.Words, ...]:
    """For each lane the set of places of the vehicles on it.

    Args:
        world: one world.
        order: of its vehicles.

    Returns:
        For each lane words of shape [].
    """
    vehicles = world.vehicles
    count = vehicles.x.shape[0]
    occupied = roads.occupied_lanes(world.road, vehicles.x, vehicles.y)
    occupied = jnp.where(vehicles.present, occupied, 0)
    bits = sets.single(order.place, count)
    members = []
    for lane in range(world.road.present.shape[0]):
        here = (occupied & (1 << lane)) != 0
        words = (jnp.where(here, word, jnp.uint32(0)) for word in bits)
        members.append(tuple(reduce(or_, [word[i] for i in range(count)]) for word in words))
    return tuple(members)


def search(world: World, motion: Motion, lanes: tuple[Array, ...]) -> tuple[Pair, ...]:
    """Neighbours of every vehicle on given lanes.

    ``Road.neighbour_vehicles``: among the other vehicles on the lane, ahead is the nearest with
    x_other >= x, the last in the list winning ties; behind is the nearest with x_other < x, the
    first winning ties. In the `Order` these are the next members of the lane's set on either side.

    Args:
        world: one world.
        motion: its motion.
        lanes: for each query int32 [N]; outside the road nobody is found.

    Returns:
        One `Pair` per query.
    """
    x, speed = world.vehicles.x, world.vehicles.speed
    count = x.shape[0]
    order = sort(x)
    members = lane_members(world, order)
    myself = sets.single(order.place, count)
    behind_me = sets.below(order.behind, count)

    def look(lane: Array) -> Pair:
        here = tuple(jnp.zeros(lane.shape, jnp.uint32) for _ in myself)
        for index, words in enumerate(members):
            on = lane == index
            here = tuple(jnp.where(on, new, old) for new, old in zip(words, here, strict=True))
        ahead = sets.without(sets.without(here, behind_me), myself)
        behind = sets.both(here, behind_me)
        first, last = sets.smallest(ahead), sets.largest(behind)

        def of_front(values: Array) -> Array:
            return sets.chosen(values, order.place, first)

        def of_rear(values: Array) -> Array:
            return sets.chosen(values, order.place, last)

        front = Front(
            exists=first >= 0,
            x=of_front(x),
            velocity_x=of_front(motion.velocity_x),
            velocity_y=of_front(motion.velocity_y),
        )
        rear = Rear(
            exists=last >= 0,
            x=of_rear(x),
            speed=of_rear(speed),
            cosine=of_rear(motion.cosine),
            sine=of_rear(motion.sine),
            effort=of_rear(motion.effort),
        )
        return Pair(front, rear)

    return tuple(look(lane) for lane in lanes)


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
    return Neighbours(*search(world, motion, (motion.lane, aside, motion.lane + 1)))
