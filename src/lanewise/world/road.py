"""Where a vehicle is on the road: its lane, and its place relative to any lane."""

from dataclasses import replace

import jax.numpy as jnp
from jax import Array

from lanewise.world.settings import FARTHEST
from lanewise.world.state import Road, select_by_index

END_MARGIN = 5.0
"""A vehicle counts as on a lane up to this far beyond either end, m."""
NEIGHBOUR_MARGIN = 1.0
"""A vehicle is a neighbour on a lane up to this far beyond the lane's edge, m."""
MOST_LANES = 31
"""Sets of lanes are the bits of an int32, and right of the last there is nobody."""
REACHABLE_WIDTHS = 2.0
"""A lane can be changed into from at most this many of its widths away."""


def straight_road(
    lanes: int | Array,
    width: float = 4.0,
    speed_limit: float = 30.0,
    lanes_max: int | None = None,
) -> Road:
    """Parallel lanes along x, `FARTHEST` m both ways, float32, lane 0 centred on y = 0.

    Args:
        lanes: how many lanes exist; may be traced where `lanes_max` is given.
        width: of every lane, m.
        speed_limit: of every lane, m/s.
        lanes_max: static number of lanes of the arrays; absent lanes fill the rest.
    """
    size = int(lanes) if lanes_max is None else lanes_max
    index = jnp.arange(size)
    present = index < lanes

    def every_lane(value: float) -> Array:
        return jnp.full(size, value, jnp.float32)

    return Road(
        present=present,
        centre=index.astype(jnp.float32) * every_lane(width),
        width=every_lane(width),
        start=every_lane(-FARTHEST),
        end=every_lane(FARTHEST),
        speed_limit=every_lane(speed_limit),
        open_to_change=present,
    )


def closest_lane(road: Road, x: Array, y: Array) -> Array:
    """The lane nearest to each position, the first of equals; int32 [N].

    The distance is |y - centre| plus the overshoot beyond either end (``AbstractLane.distance``).
    highway-env adds the angle to the lane; on a straight road it is the same for all lanes.
    """
    lane = jnp.zeros(x.shape, jnp.int32)
    nearest = jnp.full(x.shape, jnp.inf, x.dtype)
    for index in range(road.centre.shape[0]):
        beyond = jnp.maximum(x - road.end[index], 0) + jnp.maximum(road.start[index] - x, 0)
        distance = jnp.abs(y - road.centre[index]) + beyond
        closer = road.present[index] & (distance < nearest)
        lane = jnp.where(closer, index, lane)
        nearest = jnp.where(closer, distance, nearest)
    return lane


def lateral_offset(road: Road, lane: Array, y: Array) -> Array:
    """Distance of each vehicle from the centre line of a lane, positive to the right, m; [N]."""
    return y - select_by_index(road.centre, lane)


def lane_bit(lane: Array) -> Array:
    """A lane as one bit of an int32, 0 for a lane outside the road, to be looked up in a set.

    The sets hold only lanes that exist: -1 is left of the road, and nobody is right of lane 30.
    """
    return jnp.where(lane >= 0, jnp.int32(1) << jnp.maximum(lane, 0).astype(jnp.int32), 0)


def occupied_lanes(road: Road, x: Array, y: Array) -> Array:
    """The lanes each vehicle is a neighbour on, as a set of `lane_bit`, int32 [N].

    A vehicle between two lanes is on both: |lateral| <= width / 2 + 1 m and within 5 m of the
    lane's ends (``AbstractLane.on_lane`` with margin 1).
    """
    return lanes_within(road, x, y, road.width / 2 + NEIGHBOUR_MARGIN)


def reachable_lanes(road: Road, x: Array, y: Array) -> Array:
    """The lanes each vehicle may change into from where it is, as a set of `lane_bit`, int32 [N].

    ``AbstractLane.is_reachable_from``: open to change, |lateral| <= 2 widths, 0 <= along < length
    + 5 m.
    """
    open_lanes = replace(road, present=road.present & road.open_to_change)
    return lanes_within(open_lanes, x, y, REACHABLE_WIDTHS * road.width, before_start=0.0)


def lanes_within(
    road: Road, x: Array, y: Array, aside: Array, before_start: float = END_MARGIN
) -> Array:
    """The lanes whose centre lines are at most ``aside``, [M] m, away, as a set of `lane_bit`.

    A lane extends ``before_start`` m beyond its start, and `END_MARGIN` beyond its end. int32 [N].
    """
    lanes = jnp.zeros(x.shape, jnp.int32)
    for index in range(road.centre.shape[0]):
        along = x - road.start[index]
        length = road.end[index] - road.start[index]
        inside = (
            road.present[index]
            & (jnp.abs(y - road.centre[index]) <= aside[index])
            & (along >= -before_start)
            & (along < length + END_MARGIN)
        )
        lanes = jnp.where(inside, lanes | (1 << index), lanes)
    return lanes
