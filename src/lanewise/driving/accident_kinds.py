"""What kind of accident happened: who ran into whom, and after whose change of lane.

`accidents` says that an accident happened and what ends an episode. Here a collision is told by the
two worlds around the decision in which it happened, and by when vehicles last changed lane. Two
rectangles meet once they overlap along the road and across it: the one of the two that came last
tells a rear-end collision from a side-swipe.
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
class LaneHistory:
    """When each vehicle last changed lane."""

    lane: Array
    """int32 [N] the nearest lane now."""
    since: Array
    """int32 [N] decisions since it became the nearest."""


def begin(world: World) -> LaneHistory:
    """The history at a start, where nobody has changed lane."""
    lane = road.closest_lane(world.road, world.vehicles.x, world.vehicles.y)
    return LaneHistory(lane, jnp.full(lane.shape, _NEVER, jnp.int32))


def follow(history: LaneHistory, world: World) -> LaneHistory:
    """The history one decision later, in ``world``."""
    lane = road.closest_lane(world.road, world.vehicles.x, world.vehicles.y)
    return LaneHistory(lane, jnp.where(lane == history.lane, history.since + 1, 0))


def kind(
    accident: Array, before: World, after: World, history: LaneHistory, decision: float
) -> Array:
    """The kind of an accident, int32 [].

    Args:
        accident: int32 [] code of `accidents`.
        before: the world before the decision in which it happened.
        after: the world after it.
        history: of lanes, after it.
        decision: simulated length of a decision, s.
    """
    plain = jnp.where(accident == accidents.STOPPED, STOPPED, NONE)
    plain = jnp.where(accident == accidents.OFF_ROAD, OFF_ROAD, plain)
    met = _collision(before, after, history, RECENT / decision)
    return jnp.where(accident == accidents.COLLISION, met, plain).astype(jnp.int32)


def partner(after: World) -> Array:
    """The vehicle that the ego collided with: of those that crashed the nearest; int32 []."""
    along, across = _gaps(after, jnp.arange(after.vehicles.x.shape[0]))
    others = jnp.arange(along.shape[0]) > 0
    crashed = after.vehicles.crashed & after.vehicles.present & others
    return jnp.argmin(jnp.where(crashed, jnp.maximum(along, across), jnp.inf)).astype(jnp.int32)


def _collision(before: World, after: World, history: LaneHistory, recent: float) -> Array:
    """The kind of a collision, from how the ego and the other vehicle came together."""
    other = partner(after)
    gaps = zip(_gaps(before, other), _gaps(after, other), strict=True)
    along, across = (_contact(first, then) for first, then in gaps)
    ego_changed, other_changed = history.since[0], select_by_index(history.since, other)
    ahead = jnp.where(ego_changed <= recent, OWN_LANE_CHANGE, CAR_AHEAD)
    cut_in = (other_changed <= recent) & (other_changed < ego_changed)
    ahead = jnp.where(cut_in, CUT_IN, ahead)
    apart_x, apart_y = (_of(before, other, name) - _of(before, 0, name) for name in ("x", "y"))
    rear_end = jnp.where(apart_x > 0, ahead, HIT_FROM_BEHIND)
    # Positive where a vehicle moves towards the other one.
    mine = jnp.sign(apart_y) * _sideways(before, after, jnp.int32(0))
    theirs = -jnp.sign(apart_y) * _sideways(before, after, other)
    return jnp.where(across > along, jnp.where(mine >= theirs, SIDE_SWIPE, SIDE_SWIPED), rear_end)


def _gaps(world: World, other: Array) -> tuple[Array, Array]:
    """Distances between the ego's rectangle and others', along and across the road, m; [Q].

    Negative where they overlap. Headings are small, so rectangles count as lying along the road.
    """
    vehicles, drivers = world.vehicles, world.drivers
    length, width = ((of + of[0]) / 2.0 for of in (drivers.length, drivers.width))
    along = jnp.abs(vehicles.x - vehicles.x[0]) - length
    across = jnp.abs(vehicles.y - vehicles.y[0]) - width
    return select_by_index(along, other), select_by_index(across, other)


def _contact(before: Array, after: Array) -> Array:
    """When a gap closed, in decisions since the one before: 0 if it was closed, inf if it grew.

    A predicted collision moves vehicles apart, so the gap may be a little open afterwards.
    """
    closing = jnp.maximum(before - after, 0.0)
    return jnp.where(before <= 0, 0.0, jnp.where(closing > 0, before / closing, jnp.inf))


def _sideways(before: World, after: World, vehicle: Array) -> Array:
    """How far a vehicle moved to the right, m; []."""
    return _of(after, vehicle, "y") - _of(before, vehicle, "y")


def _of(world: World, vehicle: Array | int, name: str) -> Array:
    return select_by_index(getattr(world.vehicles, name), jnp.asarray(vehicle))
