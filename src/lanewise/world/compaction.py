"""Work for the few vehicles it concerns.

In a tick one driver in ten thinks about a lane change, and hardly any two cars touch. Vector code
for all of them throws nearly everything away, so on CPUs the few are taken out of all worlds,
computed side by side and put back.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import TypeVar

import jax
import jax.numpy as jnp
from jax import Array, lax

from lanewise.world import bitset
from lanewise.world.materialize import on_cpu

ENOUGH = 64
"""Up to so many vehicles, all worlds together, all are computed at once."""

Tree = TypeVar("Tree")


@dataclass(frozen=True)
class Selection:
    """Some vehicles of some worlds, K of them. Their values have the shape [K]."""

    vehicle: Array
    """int32 [K] number of each in its world."""
    place: Array
    """int32 [K] number of its world along the trailing axes, flattened."""
    real: Array
    """bool [K]: the others only fill the array up."""
    worlds: tuple[int, ...]
    """The trailing axes: () of a single world."""

    def own(self, tree: Tree) -> Tree:
        """Their own values, of arrays [N, ...]."""
        taken: Tree = jax.tree.map(lambda values: self.at(values, self.vehicle), tree)
        return taken

    def at(self, values: Array, vehicle: Array) -> Array:
        """The values, of an array [N, ...], of other vehicles of their worlds, int32 [K]."""
        flat, wide = self._flat(values)
        index = vehicle * wide + self.place if wide > 1 else vehicle
        return flat.reshape(-1).at[index].get(mode="promise_in_bounds")

    def around(self, tree: Tree) -> Tree:
        """The values of all vehicles, or all lanes, of their worlds: [N, ...] as [N, K]."""

        def taken(values: Array) -> Array:
            flat, wide = self._flat(values)
            if wide == 1:
                return flat
            return flat.at[:, self.place].get(mode="promise_in_bounds")

        found: Tree = jax.tree.map(taken, tree)
        return found

    def _flat(self, values: Array) -> tuple[Array, int]:
        """An array [N, worlds], or [N, 1] where all worlds have the same."""
        count, *trailing = values.shape
        if all(size == 1 for size in trailing):
            return values.reshape(count, 1), 1
        full = jnp.broadcast_to(values, (count, *self.worlds)).reshape(count, -1)
        return full, full.shape[1]


def masked_apply(
    mask: Array, otherwise: Tree, compute: Callable[[Selection], Tree], one_in: int
) -> Tree:
    """Values computed for the vehicles of a mask, [N, ...].

    Args:
        mask: bool [N, ...], which.
        otherwise: arrays [N, ...], the values of all others.
        compute: values of the chosen, arrays [K] in the structure of ``otherwise``.
        one_in: room is made for one vehicle in so many, static; where there are more, the rest
            follows in a second turn.
    """
    worlds = mask.shape[1:]
    otherwise = jax.tree.map(lambda leaf: jnp.broadcast_to(leaf, mask.shape), otherwise)

    def everyone() -> Tree:
        vehicle, place = jnp.indices((mask.shape[0], mask.size // mask.shape[0]), jnp.int32)
        vehicle, place = vehicle.reshape(-1), place.reshape(-1)
        found = compute(Selection(vehicle, place, mask.reshape(-1), worlds))
        result: Tree = jax.tree.map(
            lambda new, old: jnp.where(mask, new.reshape(mask.shape), old), found, otherwise
        )
        return result

    def in_turn() -> Tree:
        flat = jax.tree.map(lambda leaf: leaf.reshape(-1), otherwise)
        at_once = -(-mask.size // one_in)
        found = _in_turn(mask.reshape(mask.shape[0], -1), worlds, flat, compute, at_once)
        result: Tree = jax.tree.map(lambda leaf: leaf.reshape(mask.shape), found)
        return result

    # A loop whose length the data decide makes other devices wait for the host.
    return in_turn() if on_cpu() and mask.size > ENOUGH else everyone()


def _in_turn(
    mask: Array,
    worlds: tuple[int, ...],
    otherwise: Tree,
    compute: Callable[[Selection], Tree],
    at_once: int,
) -> Tree:
    """As `masked_apply`, so many at once; mask [N, worlds], leaves flat."""
    per_world = mask.sum(0, dtype=jnp.int32)
    ends = jnp.cumsum(per_world, dtype=jnp.int32)

    def some(state: tuple[Array, Tree]) -> tuple[Array, Tree]:
        first, so_far = state
        vehicle, place = _members(mask, ends - per_world, per_world, first, at_once)
        real = first + jnp.arange(at_once, dtype=jnp.int32) < ends[-1]
        found = compute(Selection(vehicle, place, real, worlds))
        target = jnp.where(real, vehicle * mask.shape[1] + place, mask.size)
        after: Tree = jax.tree.map(
            lambda old, new: old.at[target].set(new, mode="drop"), so_far, found
        )
        return first + at_once, after

    _, after = lax.while_loop(lambda state: state[0] < ends[-1], some, (jnp.int32(0), otherwise))
    return after


def _members(
    mask: Array, before: Array, per_world: Array, first: Array, count: int
) -> tuple[Array, Array]:
    """Members ``first`` to ``first + count - 1`` of a mask [N, worlds]: (vehicle, world).

    World by world; ``before`` and ``per_world`` are the members in earlier worlds and in each.
    Numbers beyond the last member are those of any vehicle.
    """
    index = jnp.arange(mask.shape[1], dtype=jnp.int32)
    begins = jnp.maximum(before - first, 0)
    counts = (per_world > 0) & (before + per_world > first)
    # Each world is noted where its members begin; those that follow belong to it too.
    noted = jnp.zeros(count, jnp.int32).at[jnp.where(counts, begins, count)].set(index, mode="drop")
    place = lax.cummax(noted)
    rank = first + jnp.arange(count, dtype=jnp.int32) - before[place]
    words = [word[place] for word in bitset.where(mask.shape[0], lambda number: mask[number])]
    vehicle, seen = jnp.zeros(count, jnp.int32), jnp.zeros(count, jnp.int32)
    for number in range(mask.shape[0]):
        member = (words[number // bitset.BITS] >> (number % bitset.BITS)) & 1 != 0
        vehicle = jnp.where(member & (seen == rank), number, vehicle)
        seen += member
    return vehicle, place
