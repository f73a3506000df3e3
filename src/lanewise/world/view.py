"""The world as some vehicles see it: their own state, and everyone else's.

What a driver thinks is written once, for the vehicles of a `View`: all of them or a few.
"""

from dataclasses import dataclass
from typing import TypeVar

import jax.numpy as jnp
from jax import Array

from lanewise.world.few import Chosen
from lanewise.world.motion import Motion
from lanewise.world.once import once
from lanewise.world.select import pick
from lanewise.world.state import World, numbered

Tree = TypeVar("Tree")


@dataclass(frozen=True)
class View:
    """Q vehicles that look at the N of their world; all of them, or a few of many worlds."""

    world: World
    """Its vehicles and drivers are the viewers', [Q]; the road is as it was."""
    motion: Motion
    """[Q]."""
    x: Array
    """[N, ...] m, of everyone in their worlds; broadcasts with [Q] each."""
    occupied: Array
    """int32 [N, ...] likewise, the lanes each is on."""
    number: Array
    """int32, of each vehicle in its world; broadcasts with [Q]."""
    chosen: Chosen | None = None
    """Which vehicles they are; None for all."""

    @property
    def real(self) -> Array:
        """bool, any shape: those that count."""
        return self.world.vehicles.present if self.chosen is None else self.chosen.real

    def around(self, tree: Tree) -> Tree:
        """Values of everyone in their worlds: arrays [N, ...] that broadcast with [Q] each."""
        chosen = self.chosen
        return tree if chosen is None else once(chosen.real, lambda: chosen.around(tree))

    def at(self, values: Array, vehicle: Array) -> Array:
        """Values [N, ...] of one vehicle for each, int32 [Q]; any where that is no number."""
        chosen = self.chosen
        if chosen is None:
            return pick(values, vehicle)
        last = values.shape[0] - 1
        return once(chosen.real, lambda: chosen.at(values, jnp.clip(vehicle, 0, last)))


def everyone(world: World, motion: Motion) -> View:
    """All vehicles of a world."""
    x, occupied = world.vehicles.x, motion.occupied
    return View(world, motion, x, occupied, numbered(x))


def few(world: World, motion: Motion, chosen: Chosen) -> View:
    """A few vehicles, taken out of their worlds."""

    def taken() -> tuple[World, Motion, Array, Array]:
        drivers, vehicles, seen = chosen.own((world.drivers, world.vehicles, motion))
        mine = World(world.road, drivers, vehicles)
        return mine, seen, *chosen.around((world.vehicles.x, motion.occupied))

    # A gather that is part of a longer computation keeps all of it from using vector instructions.
    return View(*once(chosen.real, taken), chosen.vehicle, chosen)
