"""What a driver observes lane by lane: relative features alone, in NumPy or in JAX.

Every function takes the array namespace, `numpy` or `jax.numpy`, as ``xp``. So the same lines
observe in training and beside an exported policy, which needs a copy of this file alone.
A vehicle is on each lane it reaches into, |lateral offset| <= width / 2 + 1 m, as highway-env's
``Road.neighbour_vehicles`` counts. Distances along the road are from bumper to bumper.
"""

from typing import Any, NamedTuple

Array = Any

MARGIN = 1.0
"""A vehicle is on a lane up to this far beyond its edge, m."""
RANGE = 100.0
"""Vehicles with a larger gap are not observed, m."""
LIMIT = 3.0
"""Features are clipped to plus and minus this."""
SIDES = (("second left", -2), ("left", -1), ("own", 0), ("right", 1), ("second right", 2))
"""The lanes that are observed, by how far they are to the right.

Two to either side: a vehicle of the second lane may change into the next one when the ego does.
"""


class Feature(NamedTuple):
    """Describes one feature. Its value is divided by ``divisor`` and clipped to +-`LIMIT`."""

    name: str
    unit: str
    divisor: float
    meaning: str


EGO = (
    Feature("speed", "m/s", 15.0, "the ego's, along its heading"),
    Feature("lateral speed", "m/s", 2.0, "the ego's, positive to the right"),
    Feature("lane offset", "m", 2.0, "from the centre of the nearest lane, positive to the right"),
    Feature("lanes left", "", 2.0, "number of lanes left of the ego's"),
    Feature("lanes right", "", 2.0, "number of lanes right of the ego's"),
)
NEIGHBOUR = (
    Feature("gap", "m", 40.0, "bumper to bumper; at the limit where nobody is within 100 m"),
    Feature("relative speed", "m/s", 5.0, "along the road, positive where it is faster"),
    Feature("offset", "m", 2.0, "from the centre of that lane, positive to the right"),
    Feature("lateral speed", "m/s", 2.0, "positive to the right"),
)
EXISTS = Feature("exists", "", 1.0, "1 if there is such a lane, else 0 and so are its others")
FEATURES = (
    *EGO,
    *(
        feature._replace(name=f"{side}: {feature.name}")
        for side, _ in SIDES
        for feature in (
            EXISTS,
            *(
                each._replace(name=f"{place}: {each.name}")
                for place in ("ahead", "behind")
                for each in NEIGHBOUR
            ),
        )
    ),
)
"""All of them, in order."""
SIZE = len(FEATURES)


class Surroundings(NamedTuple):
    """A straight road and everyone on it; the ego is vehicle 0."""

    x: Array
    """[N] centre along the road, m."""
    y: Array
    """[N] m, positive to the right."""
    heading: Array
    """[N] rad, positive to the right."""
    speed: Array
    """[N] m/s along the heading."""
    length: Array
    """[N] m."""
    present: Array
    """bool [N]."""
    lane_centre: Array
    """[M] y of each lane's centre, from left to right, m."""
    lane_width: Array
    """[M] m."""
    lane_present: Array
    """bool [M]."""


def observe(xp: Any, seen: Surroundings) -> Array:
    """The features of `FEATURES`, [SIZE]."""
    away = xp.abs(seen.y[0] - seen.lane_centre)
    own = xp.argmin(xp.where(seen.lane_present, away, xp.inf))
    count = xp.sum(seen.lane_present)
    along, across = seen.speed * xp.cos(seen.heading), seen.speed * xp.sin(seen.heading)
    values = [seen.speed[0], across[0], seen.y[0] - seen.lane_centre[own], own, count - 1 - own]
    for _, step in SIDES:
        lane = xp.clip(own + step, 0, len(seen.lane_centre) - 1)
        exists = (own + step >= 0) & (own + step < count)
        offset = seen.y - seen.lane_centre[lane]
        others = xp.arange(len(seen.x)) > 0
        on_lane = xp.abs(offset) <= seen.lane_width[lane] / 2 + MARGIN
        on_lane = on_lane & others & seen.present & exists
        values.append(exists)
        for ahead in (True, False):
            gap, found = _nearest(xp, seen, on_lane, ahead)
            near = gap <= RANGE
            own_values = along[found] - along[0], offset[found], across[found]
            # Where nobody is, the gap is at the limit; where there is no lane, at 0.
            far = LIMIT * NEIGHBOUR[0].divisor
            values.append(xp.where(exists, xp.where(near, gap, far), 0.0))
            values += [xp.where(near, value, 0.0) for value in own_values]
    dtype = seen.x.dtype
    divisors = xp.asarray([feature.divisor for feature in FEATURES], dtype)
    stacked = xp.stack([xp.asarray(value, dtype) for value in values])
    return xp.clip(stacked / divisors, -LIMIT, LIMIT)


def _nearest(xp: Any, seen: Surroundings, on_lane: Array, ahead: bool) -> tuple[Array, Array]:
    """(gap to the nearest vehicle ahead or behind, m, inf without one; its index)."""
    apart = seen.x - seen.x[0]
    there = on_lane & ((apart >= 0) if ahead else (apart < 0))
    distance = xp.where(there, xp.abs(apart), xp.inf)
    found = xp.argmin(distance)
    return distance[found] - (seen.length[found] + seen.length[0]) / 2, found
