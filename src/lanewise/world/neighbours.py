"""The nearest vehicle ahead and behind, on the lanes a driver cares about.

``Road.neighbour_vehicles`` of highway-env: among the other vehicles on a lane, ahead is the nearest
with x_other >= x, the last in the list of equals; behind is the nearest with x_other < x, the first
of equals.
"""

from typing import NamedTuple

import jax.numpy as jnp
from jax import Array

from lanewise.world import road as roads
from lanewise.world.materialize import materialize
from lanewise.world.motion import Motion
from lanewise.world.observers import Observers
from lanewise.world.state import World


class Front(NamedTuple):
    """The nearest vehicle ahead of each vehicle on some lane, arrays [Q] or [L, Q]."""

    exists: Array
    """bool."""
    x: Array
    """m; meaningless where none exists, as are all other values."""
    velocity_x: Array
    """m/s."""
    velocity_y: Array
    """m/s."""
    speed: Array | None
    """m/s; None without linear drivers, who alone need it."""


class Rear(NamedTuple):
    """The nearest vehicle behind each vehicle on some lane, arrays [Q] or [L, Q]."""

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
    shortfall: Array | None
    """Its target speed minus its speed, m/s; None without linear drivers."""


class Pair(NamedTuple):
    """Both neighbours on one lane."""

    front: Front
    rear: Rear


def as_front(world: World, motion: Motion) -> Front:
    """Every vehicle as the one behind it observes it, [N]."""
    vehicles = world.vehicles
    speed = None if world.drivers.linear is None else vehicles.speed
    return Front(vehicles.present, vehicles.x, motion.velocity_x, motion.velocity_y, speed)


def as_rear(world: World, motion: Motion) -> Rear:
    """Every vehicle as the one ahead of it observes it, [N]."""
    vehicles = world.vehicles
    return Rear(
        *(vehicles.present, vehicles.x, vehicles.speed, motion.cosine, motion.sine),
        *(motion.effort, motion.shortfall),
    )


def front(world: World, motion: Motion, observers: Observers, lane: Array) -> Front:
    """The vehicle ahead of each vehicle of some observers, on a lane.

    Each looks at one lane, int32 [Q], or at several, [L, Q]; outside the road nobody is found.
    """
    vehicles, count = world.vehicles, world.vehicles.x.shape[0]
    found = materialize(vehicles.present, lambda: _nearest(observers, lane, ahead=True))
    return Front(
        exists=found < count,
        x=observers.at(vehicles.x, found),
        velocity_x=observers.at(motion.velocity_x, found),
        velocity_y=observers.at(motion.velocity_y, found),
        speed=None if world.drivers.linear is None else observers.at(vehicles.speed, found),
    )


def rear(world: World, motion: Motion, observers: Observers, lane: Array) -> Rear:
    """The vehicle behind each vehicle of some observers, on a lane; as `front`."""
    vehicles, count = world.vehicles, world.vehicles.x.shape[0]
    found = materialize(vehicles.present, lambda: _nearest(observers, lane, ahead=False))
    return Rear(
        exists=found < count,
        x=observers.at(vehicles.x, found),
        speed=observers.at(vehicles.speed, found),
        cosine=observers.at(motion.cosine, found),
        sine=observers.at(motion.sine, found),
        effort=observers.at(motion.effort, found),
        shortfall=None if motion.shortfall is None else observers.at(motion.shortfall, found),
    )


def both(world: World, motion: Motion, observers: Observers, lane: Array) -> Pair:
    """Both neighbours of each vehicle of some observers, on a lane; as `front` and `rear`."""
    return Pair(front(world, motion, observers, lane), rear(world, motion, observers, lane))


def _nearest(observers: Observers, lane: Array, ahead: bool) -> Array:
    """Index of the nearest vehicle, int32 in the shape of ``lane``; N without one."""
    own = observers.world.vehicles.x
    x, occupied = observers.x, observers.occupied
    bit = roads.lane_bit(lane)
    count = x.shape[0]
    none = jnp.inf if ahead else -jnp.inf
    found, nearest = jnp.full(lane.shape, count), jnp.full(lane.shape, none, own.dtype)
    for other in range(count):
        nearer = (occupied[other] & bit) != 0
        if ahead:
            nearer &= (x[other] >= own) & (x[other] <= nearest) & (observers.number != other)
        else:
            nearer &= (x[other] < own) & (x[other] > nearest)
        found = jnp.where(nearer, other, found)
        nearest = jnp.where(nearer, x[other], nearest)
    return found
