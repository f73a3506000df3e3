"""The nearest vehicle ahead and behind, on the lanes a driver cares about.

One pass over the vehicles answers three queries for every vehicle at once, carrying what drivers
need of the nearest so far: no sorting, no gather.
"""

from typing import NamedTuple

import jax.numpy as jnp
from jax import Array

from lanewise.world import road as roads
from lanewise.world.motion import Motion, over_vehicles
from lanewise.world.state import World


class Front(NamedTuple):
    """The nearest vehicle ahead of each vehicle on some lane, arrays [N]."""

    exists: Array
    """bool."""
    x: Array
    """m; infinite where none exists."""
    velocity_x: Array
    """m/s."""
    velocity_y: Array
    """m/s."""


class Rear(NamedTuple):
    """The nearest vehicle behind each vehicle on some lane, arrays [N]."""

    exists: Array
    """bool."""
    x: Array
    """m; minus infinite where none exists."""
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


def search(world: World, motion: Motion, lane_bits: tuple[Array, ...]) -> tuple[Pair, ...]:
    """Neighbours of every vehicle on given lanes.

    ``Road.neighbour_vehicles``: among the other vehicles on the lane, ahead is the nearest with
    x_other >= x, the last in the list winning ties; behind is the nearest with x_other < x, the
    first winning ties.

    Args:
        world: one world.
        motion: its motion.
        lane_bits: for each query int32 [N], the lane as a bit, 0 for none.

    Returns:
        One `Pair` per query.
    """
    vehicles = world.vehicles
    x, speed = vehicles.x, vehicles.speed
    occupied = roads.occupied_lanes(world.road, x, vehicles.y)
    occupied = jnp.where(vehicles.present, occupied, 0)
    index = jnp.arange(x.shape[0])
    zero, no = jnp.zeros_like(x), jnp.zeros(x.shape, bool)
    nobody = Pair(
        Front(no, jnp.full_like(x, jnp.inf), zero, zero),
        Rear(no, jnp.full_like(x, -jnp.inf), zero, zero, zero, zero),
    )

    def meet(other: Array | int, found: tuple[Pair, ...]) -> tuple[Pair, ...]:
        place = x[other]
        ahead = place >= x
        elsewhere = index != other
        as_front = Front(jnp.array(True), place, motion.velocity_x[other], motion.velocity_y[other])
        as_rear = Rear(
            jnp.array(True),
            place,
            speed[other],
            motion.cosine[other],
            motion.sine[other],
            motion.effort[other],
        )
        result = []
        for bit, pair in zip(lane_bits, found, strict=True):
            on_lane = ((occupied[other] & bit) != 0) & elsewhere
            nearer = on_lane & ahead & (place <= pair.front.x)
            front = Front(*map(lambda new, old, n=nearer: jnp.where(n, new, old), as_front, pair.front))
            nearer = on_lane & ~ahead & (place > pair.rear.x)
            rear = Rear(*map(lambda new, old, n=nearer: jnp.where(n, new, old), as_rear, pair.rear))
            result.append(Pair(front, rear))
        return tuple(result)

    return over_vehicles(x.shape[0], meet, tuple(nobody for _ in lane_bits))


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
    bits = tuple(
        roads.lane_bit(world.road, lane) for lane in (motion.lane, aside, motion.lane + 1)
    )
    return Neighbours(*search(world, motion, bits))
