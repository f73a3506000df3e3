"""Whether the numbers of a chunk are finite, looked at without touching what is computed.

Inside the loop only what an iteration is handed is looked at, never what it is computing, so that
the compiled decisions and updates stay as they are; the rest is looked at once, after the loop.
"""

from dataclasses import dataclass
from typing import Any

import jax
import jax.numpy as jnp
from jax import Array

from lanewise.driving.episode import EpisodeStats
from lanewise.learning.learner import Learner
from lanewise.learning.replay import Replay
from lanewise.training.rollout import Rollout


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class IterationFinite:
    """What is looked at between two iterations: true where it is finite."""

    observation: Array
    """bool [worlds] what every ego sees."""
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


def between(rollouts: Rollout, losses: dict[str, Array]) -> IterationFinite:
    """A look at what an iteration is handed.

    Args:
        rollouts: [worlds].
        losses: by level that learns, [] sum over the chunk's updates so far.
    """
    return IterationFinite(
        observation=jnp.isfinite(rollouts.percept.features).all(axis=-1),
        reward=jnp.isfinite(rollouts.episode.stats.reward),
        loss={name: jnp.isfinite(loss) for name, loss in losses.items()},
    )


def of_chunk(
    looks: IterationFinite,
    episodes: EpisodeStats,
    rollouts: Rollout,
    losses: dict[str, Array],
    learners: dict[str, Learner],
    replays: dict[str, Replay],
) -> ChunkFinite:
    """All that is known of a chunk.

    Args:
        looks: [n] before each iteration.
        episodes: [n, worlds] after each decision.
        rollouts: [worlds] at the end, as all that follows.
        losses: by level that learns, [] sum over the chunk's updates.
        learners: by level that learns.
        replays: by level that learns.
    """
    whole: IterationFinite = jax.tree.map(
        lambda before, last: jnp.concatenate([before, last[None]]),
        looks,
        between(rollouts, losses),
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
