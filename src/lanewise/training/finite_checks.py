"""Whether the numbers of a chunk are finite, looked at without touching what is computed.

Inside the loop only what an iteration is handed is looked at, never what it is computing, so that
the compiled decisions and updates stay as they are; the rest is looked at once, after the loop.
The host reads it as `findings`.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from lanewise.driving.episode import EpisodeStats
from lanewise.learning.learner import Learner
from lanewise.learning.replay import Replay
from lanewise.training.rollout import Rollout

Sums = tuple[Array, Array, Array]
"""Over a level's updates in a chunk so far: their number, their losses, their mean Q-values."""


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class IterationFinite:
    """What is looked at between two iterations: true where it is finite."""

    observation: Array
    """bool [worlds] what every ego observes."""
    reward: Array
    """bool [worlds] the rewards of the episode under way."""
    loss: dict[str, Array]
    """bool [] by level that learns: the chunk's losses so far."""


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class ChunkFinite:
    """What was finite in a chunk of n iterations.

    Row i stands for what iteration i left behind, row 0 for what the chunk began with.
    """

    observation: Array
    """bool [n + 1, worlds]."""
    reward: Array
    """bool [n + 1, worlds] those of episodes that ended too."""
    vehicles: Array
    """bool [worlds] every car's state, at the chunk's end."""
    transitions: dict[str, Array]
    """bool [] by level that learns: those written in the chunk, and those under way."""
    loss: dict[str, Array]
    """bool [n + 1] by level that learns: all the chunk's losses so far."""
    weights: dict[str, Array]
    """bool [] by level that learns: online and target network and the optimiser's moments, at the
    chunk's end."""


def between(rollouts: Rollout, sums: dict[str, Sums]) -> IterationFinite:
    """A look at what an iteration is handed: its worlds, and each level's updates so far."""
    return IterationFinite(
        observation=jnp.isfinite(rollouts.percept.features).all(axis=-1),
        reward=jnp.isfinite(rollouts.episode.stats.reward),
        loss={name: jnp.isfinite(loss) for name, (_, loss, _) in sums.items()},
    )


def of_chunk(
    looks: IterationFinite,
    episodes: EpisodeStats,
    rollouts: Rollout,
    sums: dict[str, Sums],
    learners: dict[str, Learner],
    replays: dict[str, Replay],
) -> ChunkFinite:
    """All that is known of a chunk.

    Args:
        looks: [n] before each iteration.
        episodes: [n, worlds] after each decision.
        rollouts: [worlds] at the end, as all that follows.
        sums: by level that learns.
        learners: by level that learns.
        replays: by level that learns.
    """
    whole: IterationFinite = jax.tree.map(
        lambda before, last: jnp.concatenate([before, last[None]]), looks, between(rollouts, sums)
    )
    # The rewards of an episode that ended are no longer in its world.
    ended = ~episodes.outcome.over | jnp.isfinite(episodes.reward)
    first = jnp.ones_like(ended[:1])
    count, worlds = episodes.reward.shape
    return ChunkFinite(
        observation=whole.observation,
        reward=whole.reward & jnp.concatenate([first, ended]),
        vehicles=jax.vmap(_all)(rollouts.episode.world.vehicles),
        transitions={
            name: _recent(memory, count * worlds * rollouts.pending[name].choice.shape[-1])
            & _all(rollouts.pending[name])
            for name, memory in replays.items()
        },
        loss=whole.loss,
        weights={name: _all(learner) for name, learner in learners.items()},
    )


def _all(tree: Any) -> Array:
    """Whether every number of a tree is finite; bool []."""
    floats = [leaf for leaf in jax.tree.leaves(tree) if jnp.issubdtype(leaf.dtype, jnp.floating)]
    return jnp.stack([jnp.isfinite(leaf).all() for leaf in floats]).all()


def _recent(memory: Replay, count: int) -> Array:
    """Whether the last ``count`` transitions are finite; older ones were looked at before."""
    if count >= memory.capacity:
        return _all(memory)
    rows = memory.rows[(memory.position - 1 - jnp.arange(count)) % memory.capacity]
    return jnp.isfinite(rows).all()


@dataclass(frozen=True)
class Finding:
    """Something that is not finite."""

    what: str
    """``observation``, ``reward``, ``vehicles``, ``transitions``, ``loss`` or ``weights``; or
    ``validation``, where something of that kind was found in the test episodes after the chunk."""
    level: str = ""
    """Whose transitions, loss or weights."""
    iteration: int | None = None
    """Of the chunk, from 1 on, that left it behind; 0: the chunk began with it; None: some."""
    world: int | None = None
    """Number of the world, from 0 on."""

    def said(self, decisions: int, worlds: int) -> str:
        """In words, after so many decisions in so many worlds."""
        words = {
            "observation": "an observation is not finite",
            "reward": "a reward is not finite",
            "vehicles": "the state of a car is not finite",
            "transitions": f"{self.level} got a reward or an observation that is not finite",
            "loss": f"the loss of {self.level} is not finite",
            "weights": f"the weights of {self.level} are not finite",
        }[self.what]
        if self.iteration is None:
            return words if self.world is None else f"{words}, in world {self.world}"
        if self.world is None:
            return f"{words} since decision {decisions + self.iteration * worlds}"
        after = decisions + (self.iteration - 1) * worlds + self.world + 1
        place = f"after decision {after}" if self.iteration else "from the beginning on"
        return f"{words} {place}, in world {self.world}"


def findings(finite: ChunkFinite) -> list[Finding]:
    """All that is not finite, what may have caused the rest first.

    Observations and rewards come before losses and weights: a network without finite weights still
    chooses actions that exist, so it spoils nothing of the road.
    """
    firsts = []
    for what in ("observation", "reward"):
        bad = np.argwhere(~np.asarray(getattr(finite, what)))
        firsts += [Finding(what, iteration=int(at), world=int(world)) for at, world in bad[:1]]
    found = sorted(firsts, key=lambda one: one.iteration or 0)
    found += [Finding("vehicles", world=int(at)) for at in np.flatnonzero(~finite.vehicles)[:1]]
    found += [Finding("transitions", level) for level in _bad(finite.transitions)]
    losses = [
        Finding("loss", level, iteration=int(np.argmin(finite.loss[level])))
        for level in _bad(finite.loss)
    ]
    found += sorted(losses, key=lambda one: one.iteration or 0)
    return found + [Finding("weights", level) for level in _bad(finite.weights)]


def _bad(levels: Mapping[str, Any]) -> list[str]:
    """The levels of which something is not finite."""
    return [name for name, finite in levels.items() if not np.all(finite)]
