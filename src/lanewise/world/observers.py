"""The world as some vehicles observe it: their own state, and everyone else's.

What a driver decides is written once, for `Observers`: all vehicles, or the few of a mask.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import TypeVar

import jax.numpy as jnp
from jax import Array

from lanewise.world import compaction
from lanewise.world.compaction import Selection
from lanewise.world.materialize import materialize
from lanewise.world.motion import Motion
from lanewise.world.state import World, numbered, select_by_index

Tree = TypeVar("Tree")


@dataclass(frozen=True)
class Observers:
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
    chosen: Selection | None = None
    """Which vehicles they are; None for all."""

    @property
    def real(self) -> Array:
        """bool, any shape: those that count."""
        return self.world.vehicles.present if self.chosen is None else self.chosen.real

    def own(self, tree: Tree) -> Tree:
        """The observers' own values, [Q], of arrays [N, ...]."""
        return tree if self.chosen is None else self.chosen.own(tree)

    def around(self, tree: Tree) -> Tree:
        """Values of everyone in their worlds: arrays [N, ...] that broadcast with [Q] each."""
        chosen = self.chosen
        return tree if chosen is None else materialize(chosen.real, lambda: chosen.around(tree))

    def at(self, values: Array, vehicle: Array) -> Array:
        """Values [N, ...] of one vehicle for each, int32 [Q]; any where that is no number."""
        chosen = self.chosen
        if chosen is None:
            return select_by_index(values, vehicle)
        last = values.shape[0] - 1
        return materialize(chosen.real, lambda: chosen.at(values, jnp.clip(vehicle, 0, last)))


def all_vehicles(world: World, motion: Motion) -> Observers:
    """All vehicles of a world."""
    x, occupied = world.vehicles.x, motion.occupied
    return Observers(world, motion, x, occupied, numbered(x))


def masked_apply(
    world: World,
    motion: Motion,
    mask: Array,
    otherwise: Tree,
    compute: Callable[[Observers], Tree],
    one_in: int,
) -> Tree:
    """`compaction.masked_apply` for what the selected vehicles observe."""
    return compaction.masked_apply(
        mask, otherwise, lambda chosen: compute(_selected(world, motion, chosen)), one_in
    )


def _selected(world: World, motion: Motion, chosen: Selection) -> Observers:
    """A few vehicles, taken out of their worlds."""

    def taken() -> tuple[World, Motion, Array, Array]:
        drivers, vehicles, seen = chosen.own((world.drivers, world.vehicles, motion))
        mine = World(world.road, drivers, vehicles)
        return mine, seen, *chosen.around((world.vehicles.x, motion.occupied))

    # A gather that is part of a longer computation keeps all of it from using vector instructions.
    return Observers(*materialize(chosen.real, taken), chosen.vehicle, chosen)
