"""The nearest vehicle ahead and behind, on the lanes a driver cares about.

Vehicles are ranked by position once; then the nearest on a lane is the next rank on it.
"""

from collections.abc import Sequence
from typing import NamedTuple

import jax.numpy as jnp
from jax import Array

from lanewise.world import road as roads
from lanewise.world.motion import Motion
from lanewise.world.once import once
from lanewise.world.select import pick
from lanewise.world.state import World, numbered


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
    """Where vehicles stand in the order of their x, of equals the last in the list first; [N]."""

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
    me = numbered(x)
    behind = place = jnp.zeros(x.shape, jnp.int32)
    for other in range(x.shape[0]):
        behind += x[other] < x
        place += (x[other] == x) & (me < other)
    return Order(place + behind, behind)


class Places(NamedTuple):
    """The places of both neighbours of each vehicle on some lane, int32 [N]."""

    front: Array
    """N where there is none."""
    rear: Array
    """-1 where there is none."""


def nearest(order: Order, occupied: Array, lane: Array) -> Places:
    """Both neighbours of every vehicle on a lane.

    ``Road.neighbour_vehicles``: among the other vehicles on the lane, ahead is the nearest with
    x_other >= x, the last in the list winning ties; behind is the nearest with x_other < x, the
    first winning ties. In the `Order` these are the next on either side.

    Args:
        order: of the vehicles.
        occupied: int32 [N], the lanes each vehicle is on, as a set of `lane_bit`.
        lane: int32 [N], the lane each looks at, as a `lane_bit`.

    Returns:
        Their places.
    """
    me, count = numbered(lane), lane.shape[0]
    front, rear = jnp.full(lane.shape, count), jnp.full(lane.shape, -1)
    for other in range(count):
        here = (occupied[other] & lane) != 0
        place = order.place[other]
        ahead = here & (place >= order.behind) & (me != other)
        front = jnp.where(ahead, jnp.minimum(front, place), front)
        rear = jnp.where(here & (place < order.behind), jnp.maximum(rear, place), rear)
    return Places(front, rear)


def search(world: World, motion: Motion, lanes: Sequence[Array]) -> list[Pair]:
    """Neighbours of every vehicle on given lanes.

    Args:
        world: one world.
        motion: its motion.
        lanes: int32 [N] each, a lane for each vehicle; outside the road nobody is found.

    Returns:
        Neighbours on each of them.
    """
    vehicles, x = world.vehicles, world.vehicles.x
    occupied = roads.occupied_lanes(world.road, x, vehicles.y)
    occupied = jnp.where(vehicles.present, occupied, 0)
    bits = [roads.lane_bit(world.road, lane) for lane in lanes]
    order = once(vehicles.present, lambda: sort(x))
    places = once(vehicles.present, lambda: [nearest(order, occupied, bit) for bit in bits])

    def pair(at: Places) -> Pair:
        def front(values: Array) -> Array:
            return pick(values, at.front, order.place)

        def rear(values: Array) -> Array:
            return pick(values, at.rear, order.place)

        return Pair(
            Front(
                exists=at.front < x.shape[0],
                x=front(x),
                velocity_x=front(motion.velocity_x),
                velocity_y=front(motion.velocity_y),
            ),
            Rear(
                exists=at.rear >= 0,
                x=rear(x),
                speed=rear(vehicles.speed),
                cosine=rear(motion.cosine),
                sine=rear(motion.sine),
                effort=rear(motion.effort),
            ),
        )

    return once(vehicles.present, lambda: [pair(at) for at in places])


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
    return Neighbours(*search(world, motion, [motion.lane, aside, motion.lane + 1]))
