"""Laws of company: who is absent, far away, or in another world of the batch has no part in it."""

from dataclasses import replace

import jax
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
    drivers_with,
    road_with,
    taken,
    vehicles_with,
)

from lanewise.world.state import RULE_BASED, World

FASTEST = 42.0
"""No random vehicle is faster, m/s."""
ROUNDING = 1e-12


def alone(worlds, rng):
    """A world in a batch is the world alone, to the bit."""
    found = Found(worlds.vehicles.x.shape[0])
    together = after(worlds)
    for world in range(found.examples):
        only = slice(world, world + 1)
        one = after(jax.tree.map(lambda leaf: leaf[only], worlds))  # noqa: B023
        mine = jax.tree.map(lambda leaf: leaf[only], together)  # noqa: B023
        compare(found, one, mine, worlds.vehicles.present[only])
    return found


def absent(worlds, rng):
    """What stands in the places of absent vehicles and lanes changes nothing, to the bit.

    They hold anything, not-a-number and infinity too; and whoever is absent stays as it was.
    """
    present = worlds.vehicles.present
    found, first = Found(present.shape[0]), after(worlds)
    lanes = worlds.road.present
    held = replace(_strange(rng, worlds.vehicles, present), present=present)
    other = World(
        replace(_strange(rng, worlds.road, lanes), present=lanes),
        _strange(rng, worlds.drivers, present),
        held,
    )
    second = after(other)
    compare(found, first, second, present)
    for name in NUMBERS:
        mine, kept = getattr(second, name), getattr(held, name)
        found.require(f"absent {name}", (mine == kept) | (mine != mine), ~present)
    found.require("absent target_lane", second.target_lane == held.target_lane, ~present)
    return found


def _strange(rng, tree, present):
    """A struct whose absent members hold anything."""

    def strange(values):
        if values.dtype == bool:
            other = rng.random(values.shape) < 0.5
        elif values.dtype == np.int32:
            other = rng.integers(0, 3, values.shape).astype(np.int32)
        else:
            usual = rng.permuted(values, axis=1)
            odd = rng.choice([np.nan, np.inf, -np.inf, 0.0, 1e300], values.shape)
            other = np.where(rng.random(values.shape) < 0.7, usual, odd)
        return np.where(present, values, other)

    return jax.tree.map(strange, tree)


def _influence(worlds):
    """How far any driver's desired gap may reach, m, and its factor a, m/s^2; [W]."""
    drivers = worlds.drivers
    root = 2 * np.sqrt(drivers.comfort_acceleration * drivers.comfort_deceleration)
    reach = drivers.jam_distance + FASTEST * drivers.time_gap + 2 * FASTEST**2 / root
    return reach.max(axis=1), drivers.comfort_acceleration.max(axis=1)


def _with_another(worlds, rng, ahead):
    """Worlds with one more car, its distance at least 1.1 times everybody's desired gap.

    Returns:
        The worlds, and the bound a (d* / D)^2 of what it may add to an acceleration, [W] m/s^2.
    """
    vehicles, count = worlds.vehicles, worlds.vehicles.x.shape[0]
    reach, factor = _influence(worlds)
    away = 1.1 * reach * 10 ** rng.uniform(0, 3, count)
    nobody = np.where(ahead, -np.inf, np.inf)
    x = np.where(vehicles.present, vehicles.x, nobody)
    values = {
        "present": True,
        "x": x.max(axis=1) + away if ahead else x.min(axis=1) - away,
        "y": worlds.road.centre[:, 0],
        "heading": 0.0,
        "speed": rng.uniform(0, 30, count),
        "target_lane": 0,
        "crashed": False,
        "impacted": False,
        "timer": 0.5,
    }
    return vehicles_with(worlds, **_last(vehicles, values)), factor * (reach / away) ** 2


def _last(tree, values):
    """Arrays [W, N] with other values for the last."""
    changed = {}
    for name, value in values.items():
        changed[name] = getattr(tree, name).copy()
        changed[name][:, -1] = value
    return changed


def _endless(worlds):
    """Worlds on lanes without an end in sight."""
    far = np.full_like(worlds.road.start, 1e8)
    return road_with(worlds, start=-far, end=far)


def _roomy(worlds):
    """Worlds whose last vehicle is absent, on endless lanes."""
    present = worlds.vehicles.present.copy()
    present[:, -1] = False
    return _endless(vehicles_with(worlds, present=present))


def reorder_distant(worlds, rng):
    """Vehicles out of each other's reach may change places in the list, to the bit.

    The later half of the list stands beyond the desired gap of everybody; the two halves are mixed
    in any way, each in its own order. No quirk is set aside.
    """
    vehicles, (count, size) = worlds.vehicles, worlds.vehicles.x.shape
    found = Found(count)
    later = np.arange(size) >= size // 2
    away = 1000 + 1.1 * _influence(worlds)[0] * 10 ** rng.uniform(0, 2, count)
    worlds = vehicles_with(
        _endless(worlds), x=np.where(later, vehicles.x + away[:, None], vehicles.x)
    )
    # A rising series of ranks for each half, mixed.
    ranks = rng.random((count, size))
    ranks = np.where(later, np.sort(ranks, axis=1), np.sort(rng.random((count, size)), axis=1))
    order = ranks.argsort(axis=1)
    other = World(worlds.road, taken(worlds.drivers, order), taken(worlds.vehicles, order))
    second = taken(after(other), order.argsort(axis=1))
    compare(found, after(worlds), second, worlds.vehicles.present)
    return found


def far_ahead(worlds, rng):
    """A car D ahead of everybody changes an acceleration by a (d* / D)^2 at most.

    d* is the largest desired gap. Nobody is moved by it in this tick, and a lane is chosen
    otherwise only within (2 + 2 p) a (d* / D)^2 of the threshold of the gain.
    """
    worlds = _roomy(worlds)
    more, bound = _with_another(worlds, rng, ahead=True)
    return _compare_company(worlds, more, bound, 2.0, bound)


def far_behind(worlds, rng):
    """A rule-based car D behind everybody changes no acceleration, to the bit.

    A lane is chosen otherwise only within 2 p a (d* / D)^2 of the threshold of the gain, as long
    as the imposed braking allowed is more than a (d* / D)^2. Set aside by construction, for they
    hold at any distance: `missing-target-speed` and `speeding-car-behind`; it is no plain vehicle
    and no faster than it wants to be.
    """
    worlds = _roomy(worlds)
    more, bound = _with_another(worlds, rng, ahead=False)
    imposed = np.maximum(worlds.drivers.imposed_braking, bound[:, None])
    wanted = {"kind": RULE_BASED, "target_speed": 35.0}
    # The limit of the lane it is on cuts its target speed, so that it drives below that.
    limit = worlds.road.speed_limit[:, 0]
    speed = {"speed": np.minimum(more.vehicles.speed[:, -1], limit)}
    worlds = drivers_with(worlds, imposed_braking=imposed)
    more = vehicles_with(more, **_last(more.vehicles, speed))
    more = drivers_with(more, imposed_braking=imposed, **_last(more.drivers, wanted))
    return _compare_company(worlds, more, bound, 0.0, np.zeros_like(bound))


def _compare_company(worlds, more, bound, own, allowed):
    """Hold worlds against those with one more car.

    Args:
        worlds: without it.
        more: with it.
        bound: [W] of one interaction with it, m/s^2.
        own: how often it may count in a driver's own gain.
        allowed: [W] change of an acceleration, m/s^2.
    """
    present = worlds.vehicles.present
    found = Found(present.shape[0])
    gain = (own + 2 * worlds.drivers.politeness) * bound[:, None] * (1 + ROUNDING) + ROUNDING
    easier, harder = (
        after(drivers_with(worlds, minimum_gain=worlds.drivers.minimum_gain + change))
        for change in (-gain, gain)
    )
    first, second = after(worlds), after(more)
    close = (present & (easier.target_lane != harder.target_lane)).any(axis=1)
    found.quirks["within the bound of the threshold"] += int(close.sum())
    compared = present & ~close[:, None]
    allowed = (allowed * (1 + 1e-9) + ROUNDING * (allowed > 0))[:, None]
    shift = 2 * allowed * TICK**2
    numbers = {"acceleration": allowed, "speed": allowed * TICK}
    compare(found, first, second, compared, numbers, (*NUMBERS, "target_lane"))
    compare(found, first, second, compared, names=DECISIONS[1:])
    compare(found, first, second, compared, {"impact_x": shift, "impact_y": shift}, PUSHES)
    return found


LAWS = (
    Law(
        "absent",
        "Absent vehicles and lanes change nothing and stay as they are",
        "equal to the bit, whatever stands in their places",
        absent,
    ),
    Law(
        "far-ahead",
        "A car far ahead hardly matters; the IDM looks ahead without an end",
        "|change of acceleration| <= a (d*/D)^2; lanes equal unless the gain is within "
        "(2 + 2p) a (d*/D)^2 of its threshold",
        far_ahead,
    ),
    Law(
        "far-behind",
        "A car far behind does not matter, if rule-based and not above its target speed",
        "equal to the bit; lanes equal unless the gain is within 2p a (d*/D)^2 of its threshold",
        far_behind,
    ),
    Law(
        "reorder-distant",
        "The order of vehicles beyond each other's desired gaps does not matter",
        "equal to the bit, no exception",
        reorder_distant,
    ),
    Law("alone", "A world in a batch is the world alone", "equal to the bit", alone),
)
