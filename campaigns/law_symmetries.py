"""Laws of symmetry: shift the road, mirror the lanes, reorder the vehicles.

Each gives back the largest difference and every breach. Where highway-env breaks a law itself, the
quirk is found in the world, removed by the least change, and the whole world is compared.
"""

from dataclasses import replace

import numpy as np
from law_worlds import (
    DECISIONS,
    NUMBERS,
    PUSHES,
    TICK,
    Found,
    Law,
    after,
    compare,
    lane_distances,
    lane_of,
    road_with,
    taken,
    vehicles_with,
)

from lanewise.world.state import RULE_BASED, World

EPSILON = np.finfo(float).eps
ROUNDING = 1e-12
"""By so much a push may differ whose two vehicles changed places in the list, m."""
ALIGNED = 1e-9
"""Centres nearer than this along a direction count as level with one another, m."""


def shifted(worlds, along):
    """Worlds with road and vehicles further along, [W] m."""
    along = along[:, None]
    worlds = vehicles_with(worlds, x=worlds.vehicles.x + along)
    return road_with(worlds, start=worlds.road.start + along, end=worlds.road.end + along)


def shift(worlds, rng):
    """A world further along the road does the same, to the bit, but for the places themselves.

    Shifting by any s rounds each place to a neighbour of x + s; rounded beforehand, everything
    that is decided and commanded is equal, and places and pushes differ by their own rounding.
    """
    count = worlds.vehicles.x.shape[0]
    along = rng.choice([-1.0, 1.0], count) * 10.0 ** rng.uniform(0, 6, count)
    # Of 24 bits, so that shifting back is exact.
    along = along.astype(np.float32).astype(float)
    rounded = shifted(shifted(worlds, along), -along)
    found, first = Found(count), after(rounded)
    second = after(shifted(rounded, along))
    second = replace(second, x=second.x - along[:, None])
    ulp = EPSILON * (np.abs(first.x).max(axis=1) + np.abs(along) + 100)[:, None]
    allowed = {"x": 2 * ulp, "impact_x": 4 * ulp, "impact_y": 4 * ulp}
    compare(found, first, second, worlds.vehicles.present, allowed)
    return found


def mirrored_vehicles(vehicles, lanes):
    """Vehicles of mirrored worlds; lanes [W] is their number."""
    return replace(
        vehicles,
        y=-vehicles.y,
        heading=-vehicles.heading,
        slip_sine=-vehicles.slip_sine,
        impact_y=-vehicles.impact_y,
        target_lane=(lanes[:, None] - 1 - vehicles.target_lane).astype(np.int32),
    )


def mirrored(worlds):
    """Worlds with right and left exchanged: y to -y, lanes in reverse order."""
    road = worlds.road
    lanes = road.present.sum(axis=1)
    index = np.arange(road.present.shape[1])
    order = np.where(index < lanes[:, None], lanes[:, None] - 1 - index, index)
    turned = {name: np.take_along_axis(value, order, 1) for name, value in vars(road).items()}
    turned["centre"] = -turned["centre"]
    vehicles = mirrored_vehicles(worlds.vehicles, lanes)
    return World(type(road)(**turned), worlds.drivers, vehicles)


def mirror(worlds, rng):
    """A mirrored world does the mirrored thing.

    Set aside: `ties-between-lanes` (a vehicle exactly between two lanes is moved by 1 mm),
    `right-overwrites-left` (a driver for whom both sides pass, seen by closing the right one, does
    not think in this tick), `push-of-equals` (who is level with another is pushed left).
    """
    present = worlds.vehicles.present
    found = Found(present.shape[0])
    nearest = np.sort(lane_distances(worlds), axis=-1)
    tied = present & (nearest[..., 0] == nearest[..., 1])
    found.quirks["ties-between-lanes"] += int(tied.sum())
    worlds = vehicles_with(worlds, y=np.where(tied, worlds.vehicles.y + 1e-3, worlds.vehicles.y))
    lanes = worlds.road.present.sum(axis=1)
    lane = lane_of(worlds)
    for _ in range(present.shape[1]):
        first = after(worlds)
        second = mirrored_vehicles(after(mirrored(worlds)), lanes)
        right, left = first.target_lane == lane + 1, second.target_lane == lane - 1
        torn = present & right & left & (worlds.vehicles.target_lane == lane)
        if not torn.any():
            break
        found.require("left passes too", _left_passes(worlds, torn), torn)
        found.quirks["right-overwrites-left"] += int(torn.sum())
        worlds = vehicles_with(worlds, timer=np.where(torn, 0.0, worlds.vehicles.timer))
    pushed = present & (first.impact_y != second.impact_y) & _level(first)
    found.quirks["push-of-equals"] += int(pushed.sum())
    compare(found, first, second, present, names=NUMBERS + DECISIONS)
    compare(found, first, second, present & ~pushed, names=PUSHES)
    return found


def _left_passes(worlds, torn):
    """Whether each torn driver goes left once the lane to its right is closed; [W, N]."""
    lane, passes = lane_of(worlds), np.zeros_like(torn)
    for vehicle in np.flatnonzero(torn.any(axis=0)):
        closed = np.arange(worlds.road.present.shape[1]) == lane[:, vehicle, None] + 1
        open_to_change = worlds.road.open_to_change & ~closed
        alone = road_with(worlds, open_to_change=open_to_change)
        passes[:, vehicle] = after(alone).target_lane[:, vehicle] == lane[:, vehicle] - 1
    return passes


def _level(vehicles):
    """Who is pushed at a right angle to the line to another's centre; [W, N]."""
    size = np.hypot(vehicles.impact_x, vehicles.impact_y)
    along = vehicles.impact_x / np.maximum(size, EPSILON)
    across = vehicles.impact_y / np.maximum(size, EPSILON)
    apart_x = vehicles.x[:, :, None] - vehicles.x[:, None]
    apart_y = vehicles.y[:, :, None] - vehicles.y[:, None]
    level = np.abs(apart_x * along[..., None] + apart_y * across[..., None]) <= ALIGNED
    other = vehicles.impacted[:, None] & ~np.eye(size.shape[1], dtype=bool)
    return (level & other).any(axis=-1) & vehicles.impacted


def reorder(worlds, rng):
    """Vehicles in any other order of the list do the same, to the bit (pushes within 1e-12 m).

    Set aside: `ties-between-neighbours` (equal places are moved apart by millimetres),
    `decisions-in-list-order` (a driver who gives up for a rival in one order keeps its lane),
    `lower-index-reach`, `last-impact-wins`, `push-of-equals` (see `_pushed_otherwise`).
    """
    present = worlds.vehicles.present
    count, size = present.shape
    found = Found(count)
    order = rng.permuted(np.tile(np.arange(size), (count, 1)), axis=1)
    back = order.argsort(axis=1)
    worlds = _untied(worlds, found)
    lane = lane_of(worlds)
    for _ in range(size):
        first = after(worlds)
        other = World(worlds.road, taken(worlds.drivers, order), taken(worlds.vehicles, order))
        second = taken(after(other), back)
        differ = present & (first.target_lane != second.target_lane)
        if not differ.any():
            break
        found.require("target_lane", _contested(worlds, first, second), differ)
        found.quirks["decisions-in-list-order"] += int(differ.sum())
        worlds = vehicles_with(
            worlds,
            target_lane=np.where(differ, lane, worlds.vehicles.target_lane),
            timer=np.where(differ, 0.0, worlds.vehicles.timer),
        )
    compare(found, first, second, present, names=(*NUMBERS, "target_lane"))
    swapped = (back[:, :, None] < back[:, None]) != np.tri(size, k=-1, dtype=bool).T
    reach, push = _pushed_otherwise(worlds, first, swapped)
    unlike = (first.crashed != second.crashed) | (first.impacted != second.impacted)
    found.quirks["lower-index-reach"] += int((unlike & reach & present).sum())
    compare(found, first, second, present & ~reach, names=("crashed", "impacted"))
    change = np.hypot(first.impact_x - second.impact_x, first.impact_y - second.impact_y)
    differ = change > ROUNDING
    aside = np.zeros_like(present)
    for name, which in push.items():
        found.quirks[name] += int((present & differ & ~reach & ~aside & which).sum())
        aside |= which
    found.expect("impact", change, ROUNDING, present & ~reach & ~aside)
    return found


def _untied(worlds, found):
    """Worlds in which no two vehicles are at the same place along the road."""
    x, size = worlds.vehicles.x, worlds.vehicles.x.shape[1]
    equal = (x[:, :, None] == x[:, None]) & ~np.eye(size, dtype=bool)
    equal &= worlds.vehicles.present[:, None] & worlds.vehicles.present[:, :, None]
    tied = equal.any(axis=-1)
    found.quirks["ties-between-neighbours"] += int(tied.sum())
    return vehicles_with(worlds, x=np.where(tied, x + 1e-3 * np.arange(size), x))


def _contested(worlds, first, second):
    """Who is changing to a lane that another one ahead is bound for, in either order; [W, N]."""
    vehicles, lane = worlds.vehicles, lane_of(worlds)
    target = vehicles.target_lane[..., None]
    bound = [v.target_lane[:, None] == target for v in (vehicles, first, second)]
    rival = (vehicles.present & (worlds.drivers.kind == RULE_BASED))[:, None]
    ahead = vehicles.x[:, None] > vehicles.x[..., None]
    contests = np.any(bound, axis=0) & rival & ahead & (lane[:, None] != target)
    return contests.any(axis=-1) & (vehicles.target_lane != lane)


def _pushed_otherwise(worlds, vehicles, swapped):
    """Whose collisions may depend on the order, [W, N]: for the reach, and by name for the push.

    `lower-index-reach`: the other is within the reach of one of the two only, and who comes first
    changed. `last-impact-wins`: of two others in reach the last one changed. `push-of-equals`: who
    comes first changed, and the two are level.
    """
    apart_x = vehicles.x[:, :, None] - vehicles.x[:, None]
    apart_y = vehicles.y[:, :, None] - vehicles.y[:, None]
    distance = np.hypot(apart_x, apart_y)
    diagonal = np.hypot(worlds.drivers.length, worlds.drivers.width) / 2
    base = diagonal[:, :, None] + diagonal[:, None]
    mine = base + (vehicles.speed * TICK)[..., None]
    theirs = base + (vehicles.speed * TICK)[:, None]
    both = vehicles.present[:, :, None] & vehicles.present[:, None]
    both &= ~np.eye(distance.shape[1], dtype=bool)
    near = both & (distance <= np.maximum(mine, theirs) + ALIGNED)
    one_only = near & swapped & (distance >= np.minimum(mine, theirs) - ALIGNED)
    cosine, sine = np.cos(vehicles.heading)[..., None], np.sin(vehicles.heading)[..., None]
    level = np.minimum(
        np.abs(apart_x * cosine + apart_y * sine), np.abs(apart_y * cosine - apart_x * sine)
    )
    pair = near & swapped & (level <= ALIGNED)
    last = (near[..., None] & near[:, :, None] & swapped[:, None]).any(axis=(2, 3))
    return one_only.any(axis=-1), {
        "last-impact-wins": last,
        "push-of-equals": pair.any(axis=-1),
    }


LAWS = (
    Law(
        "shift",
        "A world shifted along the road by any distance s does the same",
        "equal to the bit once places are rounded to those of x + s; places and pushes within "
        "4 units in the last place of |x| + |s|",
        shift,
    ),
    Law(
        "mirror",
        "A world with left and right exchanged does the mirrored thing",
        "equal to the bit",
        mirror,
    ),
    Law(
        "reorder",
        "The order of the list does not matter",
        "equal to the bit; pushes within 1e-12 m",
        reorder,
    ),
)
