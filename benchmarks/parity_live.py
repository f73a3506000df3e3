"""Drive a live environment and our world side by side, and name what differs. Needs 64-bit JAX."""

from collections import Counter
from dataclasses import asdict, dataclass, replace

import jax
import numpy as np
from parity_compare import (
    CONTINUOUS,
    RUN_TOLERANCE,
    agree,
    as_json,
    errors_but_flags,
    minimised,
    tick_by_tick,
    wreck_flags,
)
from parity_environments import CONTROLLED_MAX, LANES_MAX, OTHERS_MAX, draw, make
from parity_names import name
from parity_states import fit

from lanewise.errors import SettingsError
from lanewise.interop.highway_env import _read_vehicles, read_world
from lanewise.world.state import CONSTANT, EXTERNAL, RULE_BASED, Vehicles, World
from lanewise.world.steering import slip_sine

ROOM = OTHERS_MAX + CONTROLLED_MAX
"""Vehicles of every world that is compiled, so that all configurations share one program."""
CHUNK = 64
"""Ticks of one call of the program."""
STATES_KEPT = 3
"""States stored of a configuration's unexplained differences; all are counted."""


@dataclass(frozen=True)
class Drive:
    """What a live environment did."""

    start: World
    vehicles: Vehicles
    """At the start and after each tick, arrays [ticks + 1, n]."""
    number: np.ndarray
    """int [ticks, k] of the vehicles that got new commands, -1 where nobody did."""
    acceleration: np.ndarray
    """[ticks, k] m/s^2."""
    steering: np.ndarray
    """[ticks, k] rad."""
    rate: int
    """Ticks a second, Hz."""


@dataclass(frozen=True)
class Difference:
    """Where our world left the live environment's, and why."""

    tick: int
    ticks_equal: int
    """Since the worlds were last equal to the bit."""
    names: tuple
    """One for each vehicle's reason; `None` among them is an unexplained one."""
    fields: tuple
    vehicles: tuple
    size: float
    """The largest error of a number."""
    before: float
    """The same a tick earlier."""


def drive(env, seconds):
    """Drive a live environment with random actions, reading its vehicles at every tick.

    The whole world is read, and so checked, every second: at every tick that would take as long as
    the drive.

    Raises:
        SettingsError: the environment holds something our world cannot represent.
    """
    live = env.unwrapped
    start = read_world(env)
    rate = live.config["simulation_frequency"]
    period, ticks = rate // live.config["policy_frequency"], round(seconds * rate)
    number = np.full((ticks, CONTROLLED_MAX), -1, np.int32)
    acceleration, steering = np.zeros(number.shape), np.zeros(number.shape)
    frames = [start.vehicles]
    for tick in range(ticks):
        if tick % period == 0:
            live.action_type.act(env.action_space.sample())
            for slot, vehicle in enumerate(live.controlled_vehicles):
                number[tick, slot] = _place_of(vehicle, live.road.vehicles)
                acceleration[tick, slot] = float(vehicle.action["acceleration"])
                steering[tick, slot] = float(vehicle.action["steering"])
        live.road.act()
        live.road.step(1 / rate)
        frames.append(_read_vehicles(live.road.vehicles))
        if (tick + 1) % rate == 0:
            read_world(env)
    vehicles = jax.tree.map(lambda *values: np.stack(values), *frames)
    return Drive(start, vehicles, number, acceleration, steering, rate)


def _place_of(vehicle, vehicles):
    return next(place for place, other in enumerate(vehicles) if other is vehicle)


def at(vehicles, tick):
    """Vehicles at one tick, or at a slice of ticks."""
    return jax.tree.map(lambda values: values[tick], vehicles)


def follow(driven, room=ROOM):
    """Compare our world with a drive at every tick; after a difference it starts from there again.

    Args:
        driven: the drive.
        room: vehicles of the compiled program.

    Returns:
        The differences, the largest error of each number while the worlds agreed, and at how many
        vehicles and ticks `wreck_flags` differed.
    """
    count, ticks = driven.start.vehicles.x.shape[0], len(driven.number)
    rule_based = driven.start.drivers.kind == RULE_BASED
    padded = fit(driven.start, room, LANES_MAX)

    def synchronised(tick):
        world = World(driven.start.road, driven.start.drivers, at(driven.vehicles, tick))
        return fit(world, room, LANES_MAX)

    found, largest, flags = [], dict.fromkeys(CONTINUOUS, 0.0), 0
    now, before, tick, equal_at = padded.vehicles, None, 0, 0
    while tick < ticks:
        frames = tick_by_tick(
            replace(padded, vehicles=now), _commands(driven, tick), 1 / driven.rate
        )
        frames = jax.tree.map(np.asarray, frames)
        wanted = at(driven.vehicles, slice(tick + 1, tick + 1 + CHUNK))
        ours = jax.tree.map(lambda a, w=wanted: a[: len(w.x), :count], frames)
        errors = errors_but_flags(ours, wanted, rule_based)
        agreed = agree(errors, RUN_TOLERANCE).all(-1)
        good = len(agreed) if agreed.all() else int(agreed.argmin())
        flags += int(wreck_flags(ours, wanted)[:good].sum())
        for each in CONTINUOUS:
            largest[each] = max(largest[each], float(errors[each][:good].max(initial=0.0)))
        if good == len(agreed):
            tick, now, before = tick + good, at(frames, -1), at(ours, -1)
            continue
        if good > 0:
            before = at(ours, good - 1)
        tick += good
        found.append(
            _difference(driven, tick, equal_at, synchronised(tick), before, at(ours, good))
        )
        tick += 1
        now, before, equal_at = synchronised(tick).vehicles, None, tick
    return found, largest, flags


def _commands(driven, tick):
    """The commands of the next `CHUNK` ticks; beyond the drive nobody is commanded."""

    def part(values, fill):
        some = values[tick : tick + CHUNK]
        return np.pad(some, ((0, CHUNK - len(some)), (0, 0)), constant_values=fill)

    return part(driven.number, -1), part(driven.acceleration, 0.0), part(driven.steering, 0.0)


def commanded(driven, tick, world):
    """A world that has been given the commands of a tick."""
    vehicles = world.vehicles
    acceleration, slip = vehicles.acceleration.copy(), vehicles.slip_sine.copy()
    for slot, number in enumerate(driven.number[tick]):
        if number >= 0:
            acceleration[number] = driven.acceleration[tick, slot]
            slip[number] = float(slip_sine(driven.steering[tick, slot]))
    return replace(world, vehicles=replace(vehicles, acceleration=acceleration, slip_sine=slip))


def _difference(driven, tick, equal_at, world, before, ours):
    """Name the difference that the tick from ``tick`` made."""
    rule_based = driven.start.drivers.kind == RULE_BASED
    wanted = at(driven.vehicles, tick + 1)
    errors = errors_but_flags(ours, wanted, rule_based)
    wrong = ~agree(errors, RUN_TOLERANCE)
    drift = 0.0
    if before is not None:
        drift = _size(errors_but_flags(before, at(driven.vehicles, tick), rule_based))
    names = name(commanded(driven, tick, world), wanted, errors, drift, driven.rate)
    return Difference(
        tick=tick,
        ticks_equal=tick - equal_at,
        names=names,
        fields=tuple(n for n, error in errors.items() if not (error <= RUN_TOLERANCE).all()),
        vehicles=tuple(np.flatnonzero(wrong).tolist()),
        size=_size(errors),
        before=drift,
    )


def _size(errors):
    return max(float(errors[each].max(initial=0.0)) for each in CONTINUOUS)


def compare(seed, number, seconds, room=ROOM, most=OTHERS_MAX):
    """Draw a configuration, drive it and compare.

    Returns:
        Its row: what it is, "read" or "refused" with the reason, whether that was expected, and
        when it was read the names of its differences, how often each came, and an example of each.
    """
    configuration = draw(seed, number, seconds, most)
    row = configuration.to_json()
    env = make(seed, configuration)
    try:
        driven = drive(env, seconds)
    except SettingsError as error:
        return row | {"refused": str(error), "expected": configuration.unread is not None}
    if configuration.unread is not None:
        return row | {"refused": None, "expected": False}
    differences, largest, flags = follow(driven, room)
    counts = Counter(each for found in differences for each in found.names)
    unexplained = [found for found in differences if None in found.names]
    return row | {
        "expected": True,
        "ticks": len(driven.number),
        "ticks_equal": differences[0].tick if differences else len(driven.number),
        "largest": max(largest.values()),
        "wreck_flags": flags,
        "names": {each: count for each, count in counts.items() if each is not None},
        "examples": _examples(differences),
        "unexplained": [asdict(found) for found in unexplained],
        "states": [_state(driven, found) for found in unexplained[:STATES_KEPT]],
    }


def _examples(differences):
    """The first difference of each name."""
    first = {}
    for found in differences:
        for each in found.names:
            first.setdefault(each, asdict(found))
    first.pop(None, None)
    return first


def _state(driven, found):
    """The state before a difference, with as few vehicles as still show it."""
    drivers = driven.start.drivers
    if drivers.kind[0] == CONSTANT:
        # The same in one tick, and `build_env` wants somebody to drive.
        kind = np.concatenate([[EXTERNAL], drivers.kind[1:]]).astype(np.int32)
        drivers = replace(drivers, kind=kind)
    world = World(driven.start.road, drivers, at(driven.vehicles, found.tick))
    return as_json(minimised(commanded(driven, found.tick, world), driven.rate))
