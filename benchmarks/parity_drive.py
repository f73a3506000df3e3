"""Drive a live environment and our world side by side, and name what differs. Needs 64-bit JAX."""

from collections import Counter
from dataclasses import dataclass, replace

import jax
import numpy as np
from jax import lax
from parity_compare import (
    CONTINUOUS,
    RUN_TOLERANCE,
    agree,
    as_json,
    at,
    errors_but_flags,
    largest,
    minimised,
    wreck_flags,
)
from parity_environments import CONTROLLED_MAX, LANES_MAX, OTHERS_MAX
from parity_names import name
from parity_states import fit

from lanewise.interop.highway_env import _read_vehicles, read_world
from lanewise.world import bicycle, tick
from lanewise.world.state import CONSTANT, EXTERNAL, RULE_BASED, Vehicles, World
from lanewise.world.steering import slip_sine

ROOM = OTHERS_MAX + CONTROLLED_MAX
"""Vehicles of every world that is compiled, so that all drives share one program."""
CHUNK = 64
"""Ticks of one call of the program."""
STATES_KEPT = 3
"""States stored of a drive's unexplained differences; all are counted."""


@dataclass(frozen=True)
class LiveDrive:
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


def drive(env, seconds):
    """Drive a live environment with random actions, reading its vehicles at every tick.

    The whole world is read, and so checked, every second: at every tick that would take as long as
    the drive.
    """
    live = env.unwrapped
    start = read_world(env)
    rate = live.config["simulation_frequency"]
    period, ticks = rate // live.config["policy_frequency"], round(seconds * rate)
    number = np.full((ticks, CONTROLLED_MAX), -1, np.int32)
    acceleration, steering = np.zeros(number.shape), np.zeros(number.shape)
    frames = [start.vehicles]
    for now in range(ticks):
        if now % period == 0:
            live.action_type.act(env.action_space.sample())
            places = {id(vehicle): place for place, vehicle in enumerate(live.road.vehicles)}
            for slot, vehicle in enumerate(live.controlled_vehicles):
                number[now, slot] = places[id(vehicle)]
                acceleration[now, slot] = float(vehicle.action["acceleration"])
                steering[now, slot] = float(vehicle.action["steering"])
        live.road.act()
        live.road.step(1 / rate)
        frames.append(_read_vehicles(live.road.vehicles))
        if (now + 1) % rate == 0:
            read_world(env)
    vehicles = jax.tree.map(lambda *values: np.stack(values), *frames)
    return LiveDrive(start, vehicles, number, acceleration, steering, rate)


@jax.jit
def _tick_by_tick(world, commands, duration):
    """Vehicles of one world after each tick, [ticks, N].

    ``commands`` are for each tick and external vehicle [ticks, k]: its number, or -1 where nothing
    new is commanded; acceleration, m/s^2; steering, rad.
    """

    def advance(vehicles, given):
        now = replace(world, vehicles=vehicles)
        for vehicle, acceleration, steering in zip(*given, strict=True):
            now = bicycle.command(now, acceleration, steering, vehicle)
        vehicles = tick.tick(now, duration).vehicles
        return vehicles, vehicles

    return lax.scan(advance, world.vehicles, commands)[1]


def follow(driven, room=ROOM):
    """Compare our world with a drive at every tick; after a difference it starts from there again.

    Returns the differences, the largest error of each number while the worlds agreed, and at how
    many vehicles and ticks `wreck_flags` differed. ``room``: vehicles of the compiled program.
    """
    count, ticks = driven.start.vehicles.x.shape[0], len(driven.number)
    rule_based = driven.start.drivers.kind == RULE_BASED

    def synchronised(now):
        return fit(replace(driven.start, vehicles=at(driven.vehicles, now)), room, LANES_MAX)

    found, most, flags = [], dict.fromkeys(CONTINUOUS, 0.0), 0
    world, before, now, equal_at = synchronised(0), None, 0, 0
    while now < ticks:
        frames = _tick_by_tick(world, _commands(driven, now), 1 / driven.rate)
        frames = jax.tree.map(np.asarray, frames)
        wanted = at(driven.vehicles, slice(now + 1, now + 1 + CHUNK))
        ours = jax.tree.map(lambda a, w=wanted: a[: len(w.x), :count], frames)
        errors = errors_but_flags(ours, wanted, rule_based)
        agreed = agree(errors, RUN_TOLERANCE).all(-1)
        good = len(agreed) if agreed.all() else int(agreed.argmin())
        flags += int(wreck_flags(ours, wanted)[:good].sum())
        equal = largest({name: error[:good] for name, error in errors.items()})
        most = {each: max(most[each], equal[each]) for each in CONTINUOUS}
        if good > 0:
            before = at(ours, good - 1)
        now += good
        if good == len(agreed):
            world = replace(world, vehicles=at(frames, -1))
            continue
        found.append(_difference(driven, now, equal_at, synchronised(now), before, at(ours, good)))
        now += 1
        world, before, equal_at = synchronised(now), None, now
    return found, most, flags


def _commands(driven, now):
    """The commands of the next `CHUNK` ticks; beyond the drive nobody is commanded."""

    def part(values, fill):
        some = values[now : now + CHUNK]
        return np.pad(some, ((0, CHUNK - len(some)), (0, 0)), constant_values=fill)

    return part(driven.number, -1), part(driven.acceleration, 0.0), part(driven.steering, 0.0)


def commanded(driven, now, world):
    """A world that has been given the commands of a tick."""
    vehicles = world.vehicles
    acceleration, slip = vehicles.acceleration.copy(), vehicles.slip_sine.copy()
    for slot, number in enumerate(driven.number[now]):
        if number >= 0:
            acceleration[number] = driven.acceleration[now, slot]
            slip[number] = float(slip_sine(driven.steering[now, slot]))
    return replace(world, vehicles=replace(vehicles, acceleration=acceleration, slip_sine=slip))


def _difference(driven, now, equal_at, world, before, ours):
    """The difference that the tick from ``now`` made: where, of what size, and why.

    ``names`` has a name for each reason; `None` among them is an unexplained one.
    """
    rule_based = driven.start.drivers.kind == RULE_BASED
    wanted = at(driven.vehicles, now + 1)
    errors = errors_but_flags(ours, wanted, rule_based)
    drift = 0.0
    if before is not None:
        earlier = errors_but_flags(before, at(driven.vehicles, now), rule_based)
        drift = max(largest(earlier).values())
    return {
        "tick": now,
        # Since the worlds were last equal to the bit.
        "ticks_equal": now - equal_at,
        "names": name(commanded(driven, now, world), wanted, errors, drift, driven.rate),
        "fields": [n for n, error in errors.items() if not (error <= RUN_TOLERANCE).all()],
        "vehicles": np.flatnonzero(~agree(errors, RUN_TOLERANCE)).tolist(),
        # The largest error of a number, and the same a tick earlier.
        "size": max(largest(errors).values()),
        "before": drift,
    }


def compare(env, seconds, room=ROOM):
    """Drive an environment and compare: differences by name, those without one with states."""
    driven = drive(env, seconds)
    differences, most, flags = follow(driven, room)
    unexplained = [found for found in differences if None in found["names"]]
    pairs = [(each, found) for found in differences for each in found["names"] if each]
    return {
        "ticks": len(driven.number),
        "ticks_equal": differences[0]["tick"] if differences else len(driven.number),
        "largest_errors": most,
        "wreck_flags": flags,
        "names": Counter(each for each, _ in pairs),
        # The first of each name.
        "examples": dict(reversed(pairs)),
        "unexplained": unexplained,
        "states": [_state(driven, found["tick"]) for found in unexplained[:STATES_KEPT]],
    }


def _state(driven, now):
    """The state before a difference, with as few vehicles as still show it."""
    drivers = driven.start.drivers
    if drivers.kind[0] == CONSTANT:
        # The same in one tick, and `build_env` wants somebody to drive.
        kind = np.concatenate([[EXTERNAL], drivers.kind[1:]]).astype(np.int32)
        drivers = replace(drivers, kind=kind)
    world = World(driven.start.road, drivers, at(driven.vehicles, now))
    return as_json(minimised(commanded(driven, now, world), driven.rate))
