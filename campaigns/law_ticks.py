"""Laws of the tick: halving it halves the error, against the exact motion.

The exact motion is computed apart, in NumPy: Simpson's rule along the bicycle's path, and a
Runge-Kutta method for the IDM on a free road.
"""

import numpy as np
from law_worlds import TICK, Found, Law, after, drivers_with, road_with, vehicles_with

from lanewise.world.state import EXTERNAL, RULE_BASED

SECONDS = 2.0
"""Simulated, s."""
FINE = 16
"""Parts of a tick in the exact motion."""
SHARP = 0.05
"""Turns of up to this in a tick, rad, count as fine enough to show the order."""
NOISE = 1e-6
"""Errors below this are too small to show the order."""
APART = 1e9
"""Drivers so far from one another are alone on the road, m."""
HALVED = (1.8, 2.2)
"""The ratio of errors that counts as halved."""
ROUNDING = 1e-9


def _states(worlds, duration):
    """x, y and speed at the times of whole ticks, [3, T, W, N], as simulated with a tick."""
    every, rows = round(TICK / duration), []
    for index in range(round(SECONDS / duration)):
        vehicles = after(worlds, duration)
        worlds = vehicles_with(worlds, **vars(vehicles))
        if (index + 1) % every == 0:
            rows.append((vehicles.x, vehicles.y, vehicles.speed))
    return np.stack(rows, axis=1)


def _path(worlds):
    """The exact x and y of bicycles with constant commands, [2, T, W, N]."""
    vehicles = worlds.vehicles
    slip = np.arcsin(vehicles.slip_sine)
    curvature = vehicles.slip_sine / (worlds.drivers.length / 2)
    steps = round(SECONDS / TICK) * FINE
    time = np.linspace(0, SECONDS, 2 * steps + 1)[:, None, None]
    travelled = vehicles.speed * time + vehicles.acceleration * time**2 / 2
    angle = vehicles.heading + slip + curvature * travelled
    speed = vehicles.speed + vehicles.acceleration * time
    velocity = speed * np.stack([np.cos(angle), np.sin(angle)])
    pieces = velocity[:, :-2:2] + 4 * velocity[:, 1:-1:2] + velocity[:, 2::2]
    path = np.cumsum(pieces, axis=1) * (SECONDS / steps / 6)
    return np.stack([vehicles.x, vehicles.y])[:, None] + path[:, FINE - 1 :: FINE]


def _order(found, coarse, fine, where):
    """Hold the largest error along the way, [T, W, N], against that of half the tick."""
    coarse, fine = coarse.max(axis=0), fine.max(axis=0)
    where = where & (fine > NOISE)
    ratio = np.where(where, coarse / np.where(where, fine, 1), 2.0)
    low, high = HALVED
    found.require("order", (ratio > low) & (ratio < high), where, ratio)


def bicycle(worlds, rng):
    """The bicycle model is of first order, with a bound.

    With constant commands the speed is exact, and the error of the place after T seconds is at
    most T dt / 2 (|a| + V^2 |k| + T V |a k|), with V the largest speed and k = sin(slip) / (L / 2):
    the left Riemann sum of a velocity, and of the heading in it.
    """
    shape = worlds.vehicles.x.shape
    no = np.zeros(shape, bool)
    worlds = drivers_with(worlds, kind=np.full(shape, EXTERNAL, np.int32), checks_collisions=no)
    worlds = vehicles_with(
        worlds,
        speed=rng.uniform(-5, 30, shape),
        acceleration=rng.uniform(-3, 3, shape),
        slip_sine=rng.uniform(-0.3, 0.3, shape) * rng.choice([0.0, 0.05, 1.0], shape),
        crashed=no,
        impacted=no,
    )
    found, present = Found(int(worlds.vehicles.present.sum())), worlds.vehicles.present
    acceleration = np.abs(worlds.vehicles.acceleration)
    top = np.abs(worlds.vehicles.speed) + acceleration * SECONDS
    bend = np.abs(worlds.vehicles.slip_sine) / (worlds.drivers.length / 2)
    times = np.arange(1, round(SECONDS / TICK) + 1)[:, None, None] * TICK
    bound = acceleration + top**2 * bend + times * top * acceleration * bend
    path, errors = _path(worlds), []
    for duration in (TICK, TICK / 2, TICK / 4):
        x, y, speed = _states(worlds, duration)
        exact = worlds.vehicles.speed + worlds.vehicles.acceleration * times
        found.require("speed", (np.abs(speed - exact) < ROUNDING).all(axis=0), present)
        errors.append(np.hypot(x - path[0], y - path[1]))
        allowed = times * duration / 2 * bound + ROUNDING
        found.require("bound", (errors[-1] <= allowed).all(axis=0), present, errors[-1].max(axis=0))
    found.deviation = float(np.where(present, errors[0], 0).max())
    smooth = present & (top * bend * TICK < SHARP)
    _order(found, errors[0], errors[1], smooth)
    _order(found, errors[1], errors[2], smooth)
    return found


def idm(worlds, rng):
    """The IDM on a free road is of first order, with a bound.

    Its speed errs by at most T dt / 2 a^2 delta / v0: the slope a (1 - (v / v0)^delta) falls with
    v, so that errors do not grow, and it changes no faster than that.
    """
    shape, present = worlds.vehicles.x.shape, worlds.vehicles.present
    no = np.zeros(shape, bool)
    target = rng.uniform(10, 30, shape)
    worlds = drivers_with(
        worlds,
        kind=np.full(shape, RULE_BASED, np.int32),
        target_speed=target,
        acceleration_limit=np.full(shape, 10.0),
    )
    worlds = vehicles_with(
        worlds,
        x=np.broadcast_to(APART * np.arange(shape[1]), shape),
        speed=target * rng.uniform(0, 1, shape),
        crashed=no,
        impacted=no,
    )
    lanes = np.ones_like(worlds.road.speed_limit)
    far = 2 * APART * shape[1] * lanes
    worlds = road_with(worlds, speed_limit=40 * lanes, start=-far, end=far)
    found, drivers = Found(int(present.sum())), worlds.drivers
    factor, exponent = drivers.comfort_acceleration, drivers.exponent
    exact, errors = _free_road(worlds.vehicles.speed, factor, target, exponent), []
    times = np.arange(1, round(SECONDS / TICK) + 1)[:, None, None] * TICK
    for duration in (TICK, TICK / 2, TICK / 4):
        errors.append(np.abs(_states(worlds, duration)[2] - exact))
        allowed = times * duration / 2 * factor**2 * exponent / target + ROUNDING
        found.require("bound", (errors[-1] <= allowed).all(axis=0), present, errors[-1].max(axis=0))
    found.deviation = float(np.where(present, errors[0], 0).max())
    _order(found, errors[0], errors[1], present & (errors[1].max(axis=0) > 1e-4))
    _order(found, errors[1], errors[2], present & (errors[2].max(axis=0) > 1e-4))
    return found


def _free_road(speed, factor, target, exponent):
    """The exact speed at whole ticks, [T, W, N] m/s."""

    def slope(v):
        return factor * (1 - (v / target) ** exponent)

    step, rows = TICK / FINE, []
    for index in range(round(SECONDS / TICK) * FINE):
        first = slope(speed)
        second = slope(speed + step / 2 * first)
        third = slope(speed + step / 2 * second)
        fourth = slope(speed + step * third)
        speed = speed + step / 6 * (first + 2 * second + 2 * third + fourth)
        if (index + 1) % FINE == 0:
            rows.append(speed)
    return np.stack(rows)


LAWS = (
    Law(
        "halve-bicycle",
        "Half the tick halves the bicycle's error in place; its speed is exact",
        "error <= T dt/2 (|a| + V^2 |k| + T V |a k|); ratio of errors 1.8 to 2.2",
        bicycle,
        "vehicles with constant commands, 2 s",
    ),
    Law(
        "halve-idm",
        "Half the tick halves the error of the IDM's speed on a free road",
        "error <= T dt/2 a^2 delta/v0; ratio of errors 1.8 to 2.2",
        idm,
        "drivers alone, 2 s",
    ),
)
