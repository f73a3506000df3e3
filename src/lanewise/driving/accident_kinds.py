"""What kind of accident happened: who ran into whom, and after whose change of lane.

`accidents` ends an episode. This module classifies the accident afterwards. It compares where the
vehicles were before and after the decision in which a collision happened, and it knows when they
last changed lane. Two rectangles collide once they overlap both along the road and across it. If
the overlap across the road came last, it is a side-swipe; otherwise it is a rear-end collision.
"""

from dataclasses import dataclass

import jax
import jax.numpy as jnp
from jax import Array

from lanewise.driving import accidents
from lanewise.world import road
from lanewise.world.state import World, select_by_index

NONE, CAR_AHEAD, OWN_LANE_CHANGE, CUT_IN, SIDE_SWIPE, SIDE_SWIPED = range(6)
HIT_FROM_BEHIND, OFF_ROAD, STOPPED = range(6, 9)
"""Codes of the kinds: the ego ran into the car ahead, into it after its own lane change, into a car
that cut in; side-swiped a car, was side-swiped; was hit from behind; left the road; stopped."""
RECENT = 4.0
"""A change of lane counts as the reason for this long, s; a change takes about 3 s."""
_NEVER = 1 << 20


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class History:
    """When each vehicle last changed lane, and where it was a decision ago."""

    lane: Array
    """int32 [N] the nearest lane now."""
    since: Array
    """int32 [N] decisions since it became the nearest."""
    x: Array
    """[N] before the last decision, m."""
    y: Array
    """[N] m."""


def begin(world: World) -> History:
    """The history at a start, where nobody has changed lane."""
    x, y = world.vehicles.x, world.vehicles.y
    lane = road.closest_lane(world.road, x, y)
    return History(lane, jnp.full(lane.shape, _NEVER, jnp.int32), x, y)


def follow(history: History, before: World, after: World) -> History:
    """The history after a decision that led from one world to the next."""
    lane = road.closest_lane(after.road, after.vehicles.x, after.vehicles.y)
    since = jnp.where(lane == history.lane, history.since + 1, 0)
    return History(lane, since, before.vehicles.x, before.vehicles.y)


def kind(accident: Array, world: World, history: History, decision: float) -> Array:
    """The kind of an accident, int32 [].

    Args:
        accident: int32 [] code of `accidents`.
        world: after the decision in which it happened.
        history: after that decision.
        decision: simulated length of a decision, s.
    """
    plain = jnp.where(accident == accidents.STOPPED, STOPPED, NONE)
    plain = jnp.where(accident == accidents.OFF_ROAD, OFF_ROAD, plain)
    met = _collision(world, history, RECENT / decision)
    return jnp.where(accident == accidents.COLLISION, met, plain).astype(jnp.int32)


def partner(world: World) -> Array:
    """The vehicle that the ego collided with: of those that crashed the nearest; int32 []."""
    vehicles = world.vehicles
    along, across = _gaps(world, vehicles.x, vehicles.y)
    crashed = vehicles.crashed & vehicles.present & (jnp.arange(along.shape[0]) > 0)
    return jnp.argmin(jnp.where(crashed, jnp.maximum(along, across), jnp.inf)).astype(jnp.int32)


def _collision(world: World, history: History, recent: float) -> Array:
    """The kind of a collision, from how the ego and the other vehicle came together."""
    other, vehicles = partner(world), world.vehicles

    def of_both(values: Array) -> tuple[Array, Array]:
        return values[0], select_by_index(values, other)

    before = _gaps(world, history.x, history.y)
    after = _gaps(world, vehicles.x, vehicles.y)
    along, across = (
        select_by_index(_contact(first, then), other)
        for first, then in zip(before, after, strict=True)
    )
    ego_changed, other_changed = of_both(history.since)
    ahead = jnp.where(ego_changed <= recent, OWN_LANE_CHANGE, CAR_AHEAD)
    cut_in = (other_changed <= recent) & (other_changed < ego_changed)
    ahead = jnp.where(cut_in, CUT_IN, ahead)
    (x, other_x), (y, other_y) = of_both(history.x), of_both(history.y)
    rear_end = jnp.where(other_x > x, ahead, HIT_FROM_BEHIND)
    # How far each moved towards the other one.
    moved, other_moved = of_both(vehicles.y - history.y)
    mine, theirs = jnp.sign(other_y - y) * moved, jnp.sign(y - other_y) * other_moved
    return jnp.where(across > along, jnp.where(mine >= theirs, SIDE_SWIPE, SIDE_SWIPED), rear_end)


def _gaps(world: World, x: Array, y: Array) -> tuple[Array, Array]:
    """Distances between the ego's rectangle and each other's, along and across the road, m; [N].

    Negative where they overlap. Headings are small, so rectangles count as lying along the road.
    """
    length, width = ((of + of[0]) / 2.0 for of in (world.drivers.length, world.drivers.width))
    return jnp.abs(x - x[0]) - length, jnp.abs(y - y[0]) - width


def _contact(before: Array, after: Array) -> Array:
    """When a gap closed, in decisions since the one before: 0 if it was closed, inf if it grew.

    A predicted collision moves vehicles apart, so the gap may be a little open afterwards.
    """
    closing = jnp.maximum(before - after, 0.0)
    return jnp.where(before <= 0, 0.0, jnp.where(closing > 0, before / closing, jnp.inf))
