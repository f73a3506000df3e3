"""What the laws of the world are told by: random worlds, one tick of them, and what was found.

Worlds lie along the first axis of float64 NumPy arrays, [W, N] of vehicles and [W, M] of lanes.
"""

import sys
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path

import jax
import numpy as np

from lanewise.world import tick
from lanewise.world.state import World

sys.path.insert(0, str(Path(__file__).parents[1] / "benchmarks"))
from parity_states import LANES_MAX, fit, random_drivers, random_road, random_vehicles

TICK = 0.1
"""Length of a tick, s."""
NUMBERS = ("x", "y", "heading", "speed", "slip_sine", "acceleration", "timer")
"""Of a vehicle; `PUSHES` come after them, as collisions come last in a tick."""
PUSHES = ("impact_x", "impact_y")
DECISIONS = ("target_lane", "crashed", "impacted")


@dataclass
class Found:
    """What came of a law on some worlds."""

    examples: int = 0
    """Worlds looked at."""
    deviation: float = 0.0
    """The largest by which what should be equal differed, in the unit of the number."""
    broken: list = field(default_factory=list)
    """Breaches: number of the world, what differed, by how much."""
    quirks: Counter = field(default_factory=Counter)
    """How often a quirk of highway-env was met and set aside, by its name."""

    def expect(self, what, error, allowed, where):
        """Hold errors [W, N] against what is allowed, at the vehicles ``where``."""
        error = np.where(where, np.nan_to_num(np.abs(error), nan=np.inf), 0.0)
        self.deviation = max(self.deviation, float(error.max(initial=0.0)))
        self.require(what, error <= allowed, where, error)

    def require(self, what, holds, where, size=None):
        """Note every world in which something does not hold at a vehicle ``where``, [W, N]."""
        for world in np.flatnonzero((where & ~holds).any(axis=1)):
            wrong = np.flatnonzero(where[world] & ~holds[world])
            breach = {"world": int(world), "what": what, "vehicles": wrong.tolist()}
            if size is not None:
                breach["size"] = float(size[world][wrong].max())
            self.broken.append(breach)

    def add(self, other, batch=0):
        """Take in what was found elsewhere."""
        self.examples += other.examples
        self.deviation = max(self.deviation, other.deviation)
        self.broken += [breach | {"batch": batch} for breach in other.broken]
        self.quirks += other.quirks


@dataclass(frozen=True)
class Law:
    """One law: what it claims, and a function that holds it against worlds."""

    name: str
    statement: str
    bound: str
    check: Callable
    """(worlds, rng) to `Found`."""
    source: str = "random states"
    """What its worlds are."""


def random_worlds(rng, count, size):
    """As many random worlds of 1 to ``size`` vehicles, as the parity tests draw them."""

    def one():
        vehicles, road = int(rng.integers(1, size + 1)), random_road(rng)
        drivers = random_drivers(rng, vehicles)
        return fit(World(road, drivers, random_vehicles(rng, road, vehicles)), size)

    return stack([one() for _ in range(count)])


def stack(worlds):
    """One batch of worlds."""
    return jax.tree.map(lambda *values: np.stack(values), *worlds)


@jax.jit
def _after(worlds, duration):
    return jax.vmap(lambda world: tick.tick(world, duration))(worlds).vehicles


def after(worlds, duration=TICK):
    """Vehicles a tick later."""
    with jax.enable_x64(True):
        return jax.tree.map(np.array, _after(worlds, duration))


def run(worlds, duration, count):
    """Worlds so many ticks later."""
    for _ in range(count):
        worlds = replace(worlds, vehicles=after(worlds, duration))
    return worlds


def vehicles_with(worlds, **values):
    """Worlds in which vehicles have other values."""
    return replace(worlds, vehicles=replace(worlds.vehicles, **values))


def drivers_with(worlds, **values):
    """Worlds in which drivers have other values."""
    return replace(worlds, drivers=replace(worlds.drivers, **values))


def road_with(worlds, **values):
    """Worlds on roads with other values."""
    return replace(worlds, road=replace(worlds.road, **values))


def taken(tree, order):
    """Arrays of vehicles in another order, [W, N]."""
    values = {name: np.take_along_axis(value, order, 1) for name, value in vars(tree).items()}
    return type(tree)(**values)


def lane_distances(worlds):
    """Distance of every vehicle from every lane, infinite to an absent one, [W, N, M] m."""
    road, vehicles = worlds.road, worlds.vehicles
    x, y = vehicles.x[..., None], vehicles.y[..., None]
    beyond = np.maximum(x - road.end[:, None], 0) + np.maximum(road.start[:, None] - x, 0)
    distance = np.abs(y - road.centre[:, None]) + beyond
    return np.where(road.present[:, None], distance, np.inf)


def lane_of(worlds):
    """The nearest lane of every vehicle, int32 [W, N]."""
    return lane_distances(worlds).argmin(axis=-1).astype(np.int32)


def compare(found, first, second, where, allowed=0.0, names=NUMBERS + PUSHES + DECISIONS):
    """Note where two outcomes differ.

    Args:
        found: takes the notes.
        first: vehicles after a tick.
        second: those of the other world, brought back.
        where: bool [W, N], vehicles that count.
        allowed: difference of numbers; one for all, or by name, 0 for others.
        names: of the values compared.
    """
    bounds = allowed if isinstance(allowed, dict) else dict.fromkeys(NUMBERS + PUSHES, allowed)
    for name in names:
        mine, theirs = getattr(first, name), getattr(second, name)
        if name in DECISIONS:
            found.require(name, mine == theirs, where)
        else:
            found.expect(name, mine - theirs, bounds.get(name, 0.0), where)


__all__ = ["LANES_MAX", "fit", "random_drivers", "random_road", "random_vehicles"]
