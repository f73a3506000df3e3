"""Fresh episodes in the worlds whose episode is over."""

from collections.abc import Callable
from typing import TypeVar

import jax
import jax.numpy as jnp
from jax import Array, lax

from lanewise.world.materialize import on_cpu

AT_ONCE = 8
"""One in so many worlds is restarted at once."""

Tree = TypeVar("Tree")


def restart_finished(done: Array, worlds: Tree, begin: Callable[[Array], Tree]) -> Tree:
    """Replace the worlds that are over, bool [W].

    A few at a time, in a loop that runs as often as it takes, mostly not at all or once: a fresh
    episode for every world, to be used in few, costs about as much as the decision itself.
    ``begin`` makes fresh worlds, arrays with a leading axis of k, of their numbers, int32 [k].
    """
    count = done.shape[0]
    if not on_cpu():
        # A loop whose length the data decide makes other devices wait for the host.
        fresh: Tree = jax.tree.map(
            lambda new, old: jnp.where(done.reshape(-1, *(1,) * (new.ndim - 1)), new, old),
            begin(jnp.arange(count)),
            worlds,
        )
        return fresh

    def some(state: tuple[Array, Tree]) -> tuple[Array, Tree]:
        left, before = state
        (chosen,) = jnp.nonzero(left, size=-(-count // AT_ONCE), fill_value=count)
        fresh = begin(jnp.minimum(chosen, count - 1))
        after = jax.tree.map(lambda old, new: old.at[chosen].set(new, mode="drop"), before, fresh)
        return left.at[chosen].set(False, mode="drop"), after

    _, after = lax.while_loop(lambda state: jnp.any(state[0]), some, (done, worlds))
    return after
