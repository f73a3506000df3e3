"""The laws of the world in docs/numerics.md, on small worlds that Hypothesis makes.

Where highway-env breaks a law, `test_law_breaks.py` shows it; here such worlds are left out.
"""

import itertools
from dataclasses import replace

import jax
import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from lanewise.world import tick
from lanewise.world.state import CONSTANT, EXTERNAL, RULE_BASED
from small_worlds import (
    ALL,
    DECISIONS,
    NUMBERS,
    PUSHES,
    SIZE,
    TICK,
    after,
    assert_same,
    change,
    check,
    lane_distances,
    mirrored,
    mirrored_vehicles,
    profile,
    reordered,
    shifted,
    taken,
    worlds,
)

ROUNDING = 1e-12
ALIGNED = 1e-9
"""Centres nearer than this along a direction count as level with one another, m."""
FASTEST = 42.0
"""No vehicle of these worlds is faster, m/s."""
TOP = 40.0
"""Beyond this speed accelerations are cut, m/s; see `world.settings.TOP_SPEED`."""


def shift(world, rng):
    """Shifted along the road it does the same, once places are rounded to those of x + s.

    Left out: pushes of vehicles that are level or equally deep in one another, whose direction
    rounding decides.
    """
    along = float(np.float32(rng.choice([-1, 1]) * 10 ** rng.uniform(0, 6)))
    world = shifted(shifted(world, along), -along)
    first, second = after(world), after(shifted(world, along))
    second = replace(second, x=second.x - along)
    ulp = np.finfo(float).eps * (np.abs(first.x).max() + abs(along) + 100)
    present = world.vehicles.present
    assert_same(first, second, present, NUMBERS + DECISIONS, x=2 * ulp)
    if not (level(first, present & first.impacted) or equally_deep(world, first)):
        assert_same(first, second, present, PUSHES, impact_x=4 * ulp, impact_y=4 * ulp)


def mirror(world, rng):
    """Mirrored it does the mirrored thing, to the bit.

    Left out: `ties-between-lanes`, `right-overwrites-left`, `push-of-equals`.
    """
    present, lanes = world.vehicles.present, int(world.road.present.sum())
    distances = np.sort(lane_distances(world))
    assume(not (present & (distances[:, 0] == distances[:, 1])).any())
    lane = lane_distances(world).argmin(axis=1)
    first, second = after(world), mirrored_vehicles(after(mirrored(world)), lanes)
    torn = present & (world.vehicles.target_lane == lane)
    torn &= (first.target_lane == lane + 1) & (second.target_lane == lane - 1)
    for vehicle in np.flatnonzero(torn):
        closed = world.road.open_to_change & (np.arange(len(distances[0])) != lane[vehicle] + 1)
        alone = after(change(world, "road", open_to_change=closed))
        assert alone.target_lane[vehicle] == lane[vehicle] - 1, "its left lane must do too"
    assume(not torn.any())
    assert_same(first, second, present, NUMBERS + DECISIONS)
    if not level(first, present & first.impacted):
        assert_same(first, second, present, PUSHES)


def level(vehicles, which):
    """Whether two of these vehicles are level with one another, along or across a heading."""
    x = vehicles.x[:, None] - vehicles.x
    y = vehicles.y[:, None] - vehicles.y
    cosine, sine = np.cos(vehicles.heading)[:, None], np.sin(vehicles.heading)[:, None]
    apart = np.minimum(np.abs(x * cosine + y * sine), np.abs(y * cosine - x * sine))
    pairs = which[:, None] & which & ~np.eye(SIZE, dtype=bool)
    return (apart[pairs] <= ALIGNED).any()


def equally_deep(world, vehicles):
    """Whether a nudge pushes somebody in another direction, to whom they were equally deep."""
    nudge = ALIGNED * np.random.default_rng(0).choice([-1, 1], (2, SIZE))
    for x, y in (nudge, -nudge) if (world.vehicles.present & vehicles.impacted).any() else ():
        nudged = after(change(world, x=world.vehicles.x + x, y=world.vehicles.y + y))
        push = np.hypot(nudged.impact_x - vehicles.impact_x, nudged.impact_y - vehicles.impact_y)
        if (push > 1e3 * ALIGNED).any():
            return True
    return False


def reorder(world, rng):
    """In another order of the list it does the same, to the bit; pushes within 1e-12 m.

    Left out: `ties-between-neighbours`, `decisions-in-list-order`, `push-of-equals`,
    `lower-index-reach`, `last-impact-wins`.
    """
    vehicles = world.vehicles
    world = change(world, x=vehicles.x + 1e-3 * np.arange(SIZE))
    order = rng.permutation(SIZE)
    first, second = after(world), taken(after(reordered(world, order)), order.argsort())
    present, lane = vehicles.present, lane_distances(world).argmin(axis=1)
    differ = present & (first.target_lane != second.target_lane)
    for one in np.flatnonzero(differ):
        # Only who is changing lanes, to a lane that another one ahead is changing to as well.
        target = vehicles.target_lane[one]
        bound = (vehicles.target_lane, first.target_lane, second.target_lane)
        rivals = present & (world.drivers.kind == RULE_BASED) & (lane != target)
        rivals &= world.vehicles.x > world.vehicles.x[one]
        rivals &= np.any([lanes_of == target for lanes_of in bound], axis=0)
        assert rivals.any()
        assert target != lane[one]
    assume(not differ.any())
    assert_same(first, second, present, (*NUMBERS, "target_lane"))
    if collisions_keep_order(world, first):
        bounds = dict.fromkeys(PUSHES, ROUNDING)
        assert_same(first, second, present, ("crashed", "impacted", *PUSHES), **bounds)


def collisions_keep_order(world, vehicles):
    """Whether no collision depends on the order of the list."""
    distance = np.hypot(
        vehicles.x[:, None] - vehicles.x, vehicles.y[:, None] - vehicles.y
    ) + np.diag(np.full(SIZE, np.inf))
    diagonal = np.hypot(world.drivers.length, world.drivers.width) / 2
    reach = diagonal[:, None] + diagonal + (vehicles.speed * TICK)[:, None]
    both = vehicles.present[:, None] & vehicles.present
    near = both & (distance <= np.maximum(reach, reach.T) + ALIGNED)
    certain = distance < np.minimum(reach, reach.T) - ALIGNED
    alone = near.sum(axis=1).max() <= 1
    tied = level(vehicles, near.any(axis=1)) or equally_deep(world, vehicles)
    return alone and certain[near].all() and not tied


def reorder_distant(world, rng):
    """Vehicles beyond each other's desired gaps change places in the list: the same, to the bit."""
    later = np.arange(SIZE) >= SIZE // 2
    away = 1000 + 1.1 * desired_gap(world) * 10 ** rng.uniform(0, 2)
    world = change(endless(world), x=world.vehicles.x + away * later)
    order = np.empty(SIZE, int)
    places = rng.permutation(SIZE)
    order[np.sort(places[: SIZE // 2])] = np.flatnonzero(~later)
    order[np.sort(places[SIZE // 2 :])] = np.flatnonzero(later)
    second = taken(after(reordered(world, order)), order.argsort())
    assert_same(after(world), second, world.vehicles.present)


def absent(world, rng):
    """What the places of absent vehicles and lanes hold changes nothing, to the bit."""

    def strange(values, present):
        if values.dtype.kind == "f":
            odd = rng.choice([np.nan, np.inf, -np.inf, 0.0, 1e300, 5.0], len(values))
        else:
            odd = rng.integers(0, 2, len(values)).astype(values.dtype)
        return np.where(present, values, odd)

    def held(part, present):
        part = jax.tree.map(lambda values: strange(values, present), part)
        return replace(part, present=present) if hasattr(part, "present") else part

    present, lanes = world.vehicles.present, world.road.present
    other = type(world)(
        held(world.road, lanes), held(world.drivers, present), held(world.vehicles, present)
    )
    second = after(other)
    assert_same(after(world), second, present)
    assert_same(other.vehicles, second, ~present, (*NUMBERS, "target_lane"))


def far_ahead(world, rng):
    """A car D ahead of everybody changes accelerations by a (d* / D)^2 at most.

    Lanes change only where the gain is within (2 + 2 p) a (d* / D)^2 of its threshold.
    """
    world, more, bound = with_another(world, rng, ahead=True)
    compare_company(world, more, bound, own=2.0, allowed=bound)


def far_behind(world, rng):
    """A rule-based car D behind, not above its target speed, changes no acceleration, to the bit.

    Lanes change only where the gain is within 2 p a (d* / D)^2 of its threshold. Left out:
    `missing-target-speed`, `speeding-car-behind`, and braking imposed to within a (d* / D)^2.
    """
    world, more, bound = with_another(world, rng, ahead=False)
    assume((world.drivers.imposed_braking > bound).all())
    compare_company(world, more, bound, own=0.0, allowed=0.0)


def desired_gap(world):
    """The largest gap that any driver may want, m."""
    drivers = world.drivers
    root = 2 * np.sqrt(drivers.comfort_acceleration * drivers.comfort_deceleration)
    return np.max(drivers.jam_distance + FASTEST * drivers.time_gap + 2 * FASTEST**2 / root)


def endless(world):
    """The world on lanes without an end in sight."""
    return change(world, "road", start=-1e8, end=1e8)


def with_another(world, rng, ahead):
    """(the world without its last vehicle, the same with a car D away, and a (d* / D)^2)."""
    last, vehicles, drivers = np.arange(SIZE) == SIZE - 1, world.vehicles, world.drivers
    world = change(endless(world), present=vehicles.present & ~last)
    assume(world.vehicles.present.any())
    x = vehicles.x[world.vehicles.present]
    away = 1.1 * desired_gap(world) * 10 ** rng.uniform(0, 3)
    place = x.max() + away if ahead else x.min() - away
    values = {"x": place, "y": world.road.centre[0], "heading": 0.0, "target_lane": 0}
    values |= {"speed": min(rng.uniform(0, 30), world.road.speed_limit[0]), "timer": 0.5}
    values |= {"present": True, "crashed": False, "impacted": False}
    more = {name: np.where(last, v, getattr(world.vehicles, name)) for name, v in values.items()}
    more = change(world, **more)
    if not ahead:
        kind = np.where(last, RULE_BASED, drivers.kind)
        wanted = np.where(last, 35.0, drivers.target_speed)
        more = change(more, "drivers", kind=kind, target_speed=wanted)
    return world, more, drivers.comfort_acceleration.max() * (desired_gap(world) / away) ** 2


def compare_company(world, more, bound, own, allowed):
    """The vehicles of a world do the same with one more car, but for what is allowed, m/s^2."""
    gain = (own + 2 * world.drivers.politeness) * bound * (1 + ROUNDING) + ROUNDING
    least = world.drivers.minimum_gain
    easier, harder = (
        after(change(world, "drivers", minimum_gain=least + d)) for d in (-gain, gain)
    )
    first, second, present = after(world), after(more), world.vehicles.present
    assume((easier.target_lane == harder.target_lane)[present].all())
    allowed = allowed * (1 + 1e-9) + ROUNDING * (allowed > 0)
    bounds = {"acceleration": allowed, "speed": allowed * TICK}
    bounds |= dict.fromkeys(PUSHES, 2 * allowed * TICK**2)
    assert_same(first, second, present, ALL, **bounds)


def motion(world, rng):
    """Nobody leaps, spins or leaves the numbers."""
    before, now, drivers = world.vehicles, after(world), world.drivers
    present = before.present
    for name in NUMBERS + PUSHES:
        assert np.isfinite(getattr(now, name)[present]).all(), name
    pushed = np.where(before.impacted, np.hypot(before.impact_x, before.impact_y), 0)
    moved = np.hypot(now.x - before.x, now.y - before.y)
    assert (moved <= np.abs(before.speed) * TICK + pushed + ROUNDING)[present].all()
    slip = np.where(before.crashed, 0, now.slip_sine)
    turned = before.speed * slip / (drivers.length / 2) * TICK
    assert np.abs(now.heading - before.heading - turned)[present].max(initial=0) <= ROUNDING
    steers = present & (drivers.kind == RULE_BASED) & ~before.crashed & ~now.crashed
    assert (np.abs(now.slip_sine) <= drivers.slip_limit * (1 + ROUNDING))[steers].all()


def speed(world, rng):
    """Speeds change as commanded, and no command is beyond a driver's limit.

    Above 40 m/s the limit gives way (`clipped-command-persists`); the IDM may reverse
    (`drivers-may-reverse`).
    """
    before, now, drivers = world.vehicles, after(world), world.drivers
    present, usual = before.present, np.abs(before.speed) <= TOP
    change_of_speed = now.speed - before.speed
    assert np.abs(change_of_speed - now.acceleration * TICK)[present].max(initial=0) <= ROUNDING
    crashed = present & before.crashed & usual
    assert np.abs(now.acceleration + before.speed)[crashed].max(initial=0) <= ROUNDING
    by_rules = present & (drivers.kind == RULE_BASED) & ~before.crashed & usual
    assert (np.abs(now.acceleration) <= drivers.acceleration_limit)[by_rules].all()
    obeys = present & (drivers.kind != RULE_BASED) & ~before.crashed & usual
    assert (now.acceleration == before.acceleration)[obeys].all()
    idle = obeys & (drivers.kind == CONSTANT) & (before.acceleration == 0)
    assert (now.speed == before.speed)[idle].all()
    largest = np.maximum(np.abs(before.acceleration), drivers.acceleration_limit)
    most = np.maximum(np.abs(before.speed), TOP + largest * TICK)
    assert (np.abs(now.speed) <= most + ROUNDING)[present].all()


def lanes(world, rng):
    """Lanes exist; a change goes to a neighbour or back, at 1 m/s or faster; timers go on."""
    before, now, drivers = world.vehicles, after(world), world.drivers
    present, count = before.present, world.road.present.sum()
    lane, target = lane_distances(world).argmin(axis=1), before.target_lane
    assert (lane_distances(change(world, x=now.x, y=now.y)).argmin(axis=1) < count)[present].all()
    assert ((now.target_lane >= 0) & (now.target_lane < count))[present].all()
    chooses = (drivers.kind == RULE_BASED) & drivers.changes_lanes & ~before.crashed
    changed = present & (now.target_lane != target)
    assert not (changed & ~chooses).any()
    began = changed & (target == lane)
    assert (np.abs(now.target_lane - lane) == 1)[began].all()
    assert (np.abs(before.speed) >= 1)[began].all()
    assert (now.timer == TICK)[began].all()
    assert (now.target_lane == lane)[changed & (target != lane)].all()
    restarts = (now.timer == TICK) & (before.timer > drivers.change_delay) & (target == lane)
    goes_on = now.timer == before.timer + TICK * (drivers.kind == RULE_BASED)
    assert (goes_on | (restarts & chooses))[present].all()


def crashes(world, rng):
    """Crashed stays crashed, who was hit crashes, and the pushes of two are equal and opposite.

    Of more than two: `last-impact-wins`. Who touches nobody does not crash.
    """
    before, now = world.vehicles, after(world)
    present = before.present
    assert now.crashed[present & (before.crashed | before.impacted)].all()
    hit = now.impacted & present
    if hit.sum() == 2:
        assert now.impact_x[hit].sum() == 0
        assert now.impact_y[hit].sum() == 0
    apart = np.hypot(now.x[:, None] - now.x, now.y[:, None] - now.y)
    apart = np.where(present & ~np.eye(SIZE, dtype=bool), apart, np.inf).min(axis=1)
    clear = present & (apart > np.hypot(world.drivers.length, world.drivers.width).max())
    assert not now.crashed[clear & ~before.impacted & ~before.crashed].any()


def straight(world, rng):
    """In the middle of its lane, heading 0, no change of lane: it stays there, to the bit."""
    lane = lane_distances(world).argmin(axis=1)
    world = change(
        world, y=world.road.centre[lane], heading=0, slip_sine=0, target_lane=lane, impacted=False
    )
    before, now = world.vehicles, after(world)
    stays = before.present & (now.target_lane == lane)
    assert_same(before, now, stays, ("y", "heading"))
    plain = stays & np.isin(world.drivers.kind, (EXTERNAL, CONSTANT))
    assert np.abs(now.x - before.x - before.speed * TICK)[plain].max(initial=0) <= ROUNDING


def free_road(world, rng):
    """Alone, a driver nears its target speed and never passes it, as long as a delta dt <= v0."""
    target = np.maximum(world.drivers.target_speed, 2.0)
    share = rng.choice([0.0, 1.0, rng.random()], SIZE)
    world = change(world, "drivers", kind=RULE_BASED, target_speed=target)
    world = change(change(world, "road", speed_limit=40), speed=target * share, crashed=False)
    world, drivers = change(world, present=np.arange(SIZE) == 0), world.drivers
    assume(drivers.comfort_acceleration[0] * drivers.exponent[0] * TICK <= target[0])
    now = after(world).speed[0]
    assert world.vehicles.speed[0] <= now <= target[0] * (1 + ROUNDING)


def assert_halved(world, names, noise, which):
    """Half the tick halves the error of these numbers after a second: a method of first order."""
    found = []
    for parts in (1, 2, 4):
        later = world
        for _ in range(10 * parts):
            later = change(later, **vars(after(later, TICK / parts)))
        found.append(np.stack([getattr(later.vehicles, name) for name in names]))
    coarse, fine = (np.hypot.reduce(one - two) for one, two in itertools.pairwise(found))
    told = which & (fine > noise)
    assert ((coarse[told] > 1.8 * fine[told]) & (coarse[told] < 2.2 * fine[told])).all()


def halve_bicycle(world, rng):
    """With constant commands half the tick halves the error of the place; speeds are exact."""
    world = change(world, "drivers", kind=EXTERNAL, checks_collisions=False)
    slip = rng.uniform(-0.3, 0.3, SIZE) * rng.choice([0.0, 0.05, 1.0], SIZE)
    v, a = rng.uniform(-5, 30, SIZE), rng.uniform(-3, 3, SIZE)
    world = change(world, speed=v, acceleration=a, slip_sine=slip, crashed=False, impacted=False)
    present, now = world.vehicles.present, after(world)
    assert np.abs(now.speed - v - a * TICK)[present].max() < ROUNDING
    smooth = (np.abs(v) + np.abs(a)) * np.abs(slip) / world.drivers.length * 2 * TICK < 0.05
    assert_halved(world, ("x", "y"), 1e-6, present & smooth)


def halve_idm(world, rng):
    """On a free road half the tick halves the error of the IDM's speed."""
    target, apart = rng.uniform(10, 30, SIZE), 1e9 * np.arange(SIZE)
    world = change(world, "drivers", kind=RULE_BASED, target_speed=target, acceleration_limit=10)
    world = change(world, "road", speed_limit=40, start=-1e11, end=1e11)
    slow = target * rng.uniform(0, 1, SIZE)
    world = change(world, x=apart, speed=slow, crashed=False, impacted=False)
    assert_halved(world, ("speed",), 1e-4, world.vehicles.present)


LAWS = {
    law.__name__.replace("_", "-"): law
    for law in (
        shift, mirror, reorder, reorder_distant, absent, far_ahead, far_behind, motion, speed,
        lanes, crashes, straight, free_road, halve_bicycle, halve_idm,
    )
}  # fmt: skip


@pytest.mark.parametrize("examples", [60, pytest.param(400, marks=pytest.mark.slow)])
@pytest.mark.parametrize("law", LAWS)
def test_law(law, examples):
    check(LAWS[law], examples // 15 if law.startswith("halve") else examples)


@pytest.mark.parametrize("examples", [60, pytest.param(400, marks=pytest.mark.slow)])
@pytest.mark.parametrize(
    "law", [law for law in LAWS if not law.startswith(("far", "halve", "free"))]
)
def test_law_with_linear_drivers(law, examples):
    """Not how far they see, nor how they near their target speed: those are laws of the IDM."""
    check(LAWS[law], examples, linear=True)


@pytest.mark.slow
@profile(3)
@given(several=st.lists(worlds(), min_size=16, max_size=16))
def test_a_world_in_a_batch_is_the_world_alone(several):
    batch = jax.tree.map(lambda *leaves: np.stack(leaves), *several)
    with jax.enable_x64(True):
        together = jax.jit(jax.vmap(lambda world: tick.tick(world, TICK).vehicles))(batch)
    for number, world in enumerate(several):
        mine = jax.tree.map(lambda leaf, n=number: np.asarray(leaf[n]), together)
        assert_same(after(world), mine, world.vehicles.present)
