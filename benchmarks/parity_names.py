"""Names for the differences between our world and highway-env's; see docs/numerics.md.

A name is given only where its condition holds in the very state in which the worlds parted. The
state before is taken from the live environment and goes through one tick of our world, without what
earlier ticks left. If that tick equals highway-env's, then rounding of earlier ticks has grown;
otherwise the state must lie on an edge that rounding decides.
"""

from dataclasses import replace

import jax
import numpy as np
from parity_compare import (
    DECISIONS,
    RUN_TOLERANCE,
    STATE_TOLERANCE,
    agree,
    errors_but_flags,
    one_tick,
    stack,
)

from lanewise.world.bicycle import TOP_SPEED
from lanewise.world.motion import SMALLEST
from lanewise.world.state import RULE_BASED

NUDGES = 32
"""Worlds with places changed by rounding that are tried."""
NUDGE = 1e-11
"""Size of such a change, m and rad; the numbers of highway-env's corners are rounded so far
along the road."""
SLOW = 1.0
"""Below this speed, m/s, steering and braking amplify rounding."""
PUSHES = ("crashed", "impacted", "impact_x", "impact_y")
EPSILON = np.finfo(np.float64).eps


def name(world, wanted, errors, drift, rate):
    """Names of a difference, sorted; `None` among them where something is unexplained.

    Args:
        world: the state before, from the live environment, with its commands; padded.
        wanted: highway-env's vehicles a tick later, [n].
        errors: of our world in the free run, by name, [n].
        drift: largest error in the free run before the tick.
        rate: ticks a second, Hz.
    """
    count = wanted.x.shape[0]
    rule_based = world.drivers.kind[:count] == RULE_BASED
    variants = [world, *_other_thresholds(world), *_nudged(world)]
    after = jax.tree.map(np.asarray, one_tick(stack(variants), 1 / rate))
    after = jax.tree.map(lambda values: values[:, :count], after)
    close = errors_but_flags(after, wanted, rule_based)
    exact = agree({n: error[0] for n, error in close.items()}, STATE_TOLERANCE)
    alike = agree(close, RUN_TOLERANCE)
    thresholds, nudged = np.split(alike[1:], [len(alike) - 1 - NUDGES])
    wrong = ~agree(errors, RUN_TOLERANCE)
    drifted = wrong & exact & (drift > 0)
    names = set()
    if drifted.any():
        names.add(_of_drift(world, {n: np.where(drifted, e, 0) for n, e in errors.items()}))
    for vehicle in np.flatnonzero((wrong | ~exact) & ~drifted):
        fields = {n for n, e in close.items() if not e[0, vehicle] <= STATE_TOLERANCE}
        names.add(_of_edge(world, vehicle, fields, thresholds.any(0), nudged.any(0)))
    return tuple(sorted(names, key=str))


def _of_drift(world, errors):
    """The name of rounding that has grown, by what it met."""
    wrong = {n: np.flatnonzero(~(e <= RUN_TOLERANCE)) for n, e in errors.items()}
    wrong = {n: where for n, where in wrong.items() if where.size}
    vehicles, everywhere = world.vehicles, np.unique(np.concatenate(list(wrong.values())))
    decided = set(wrong) & {*DECISIONS, *PUSHES}
    speeds = np.abs(vehicles.speed)
    hurried = wrong.get("acceleration", np.array([], int))
    if hurried.size and (np.abs(speeds[hurried] - TOP_SPEED) <= RUN_TOLERANCE).all():
        return "top-speed-edge"
    if not decided and (vehicles.speed[everywhere] < SLOW).all():
        return "standstill-and-reversing"
    return "amplified-rounding"


def _of_edge(world, vehicle, fields, alike_thresholds, alike_nudged):
    """The name of a difference of one vehicle from the very same state, `None` without one."""
    if fields <= set(PUSHES) and alike_nudged[vehicle]:
        return "relative-coordinates"
    if between_lanes(world, vehicle) and alike_nudged[vehicle]:
        return "no-angle-in-lane-distance"
    if "target_lane" in fields and alike_thresholds[vehicle]:
        return "cancelled-free-road-term"
    return None


def between_lanes(world, vehicle):
    """Whether a vehicle is as far from its closest lane as from another, but for rounding."""
    road, y = world.road, world.vehicles.y[vehicle]
    distances = np.sort(np.where(road.present, np.abs(y - road.centre), np.inf))
    return len(distances) > 1 and distances[1] - distances[0] <= 10 * NUDGE


def gain_bound(world):
    """How far rounding of the free-road term may move a driver's gain, [N] m/s^2.

    highway-env subtracts predictions of one vehicle that contain -a (v / v0)^delta, and float64
    keeps so many digits of them: its own, and with politeness those of the vehicles behind.
    """
    vehicles, drivers, road = world.vehicles, world.drivers, world.road
    distance = np.abs(vehicles.y[:, None] - road.centre)
    limit = road.speed_limit[np.where(road.present, distance, np.inf).argmin(1)]
    target = np.clip(drivers.target_speed, 0, limit)
    effort = np.maximum(vehicles.speed, 0) / np.maximum(target, SMALLEST)
    behind = vehicles.present & (vehicles.x < vehicles.x[:, None])
    fastest = np.where(behind, effort, 0).max(1)
    terms = effort**drivers.exponent + drivers.politeness * fastest**drivers.exponent
    return 4 * EPSILON * drivers.comfort_acceleration * terms + STATE_TOLERANCE


def _other_thresholds(world):
    """The world with MOBIL's threshold raised and lowered by the rounding of its gain."""
    drivers, bound = world.drivers, gain_bound(world)
    return [
        replace(world, drivers=replace(drivers, minimum_gain=drivers.minimum_gain + sign * bound))
        for sign in (-1, 1)
    ]


def _nudged(world):
    """The world with everybody moved and turned by the size of rounding, in random directions."""
    rng, vehicles = np.random.default_rng(0), world.vehicles
    worlds = []
    for _ in range(NUDGES):
        x, y, heading = rng.choice([-NUDGE, 0.0, NUDGE], (3, *vehicles.x.shape))
        moved = {"x": vehicles.x + x, "y": vehicles.y + y, "heading": vehicles.heading + heading}
        worlds.append(replace(world, vehicles=replace(vehicles, **moved)))
    return worlds
