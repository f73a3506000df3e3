"""Replay memory: a ring of transitions in one array, written in place."""

from dataclasses import dataclass

import jax
import jax.numpy as jnp

_SCALARS = 3
"""Columns beside the two feature vectors: action, reward, discount."""


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Transition:
    """What one decision led to. A batch has the same fields with a leading axis."""

    features: jax.Array
    """[F] what the learner saw when it decided."""
    action: jax.Array
    """[] int32 index of the action."""
    reward: jax.Array
    """[] reward summed over the decision, as the caller defines it."""
    discount: jax.Array
    """[] weight of the next state's value; 0 where the episode terminated."""
    next_features: jax.Array
    """[F] what the learner saw at its next decision, or at the last moment of the episode."""


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Replay:
    """The most recent transitions, the oldest overwritten first."""

    rows: jax.Array
    """[capacity, 2F + 3] features, action (as a float), reward, discount, next features: one array,
    because one scatter and one gather a step are cheaper than five."""
    position: jax.Array
    """[] int32 transitions written since the beginning; the next one goes to row
    ``position % capacity``."""

    @property
    def capacity(self) -> int:
        """Transitions that fit."""
        return self.rows.shape[0]

    @property
    def filled(self) -> jax.Array:
        """[] int32 rows that hold a transition; they are the first ones."""
        return jnp.minimum(self.position, self.capacity)


def empty(capacity: int, inputs: int) -> Replay:
    """A replay memory for ``capacity`` transitions of F inputs, with none yet."""
    rows = jnp.zeros((capacity, 2 * inputs + _SCALARS), jnp.float32)
    return Replay(rows=rows, position=jnp.zeros((), jnp.int32))


def add(replay: Replay, batch: Transition, mask: jax.Array) -> Replay:
    """Writes the masked ([B] bool) of B transitions, in order, without gaps between them.

    Where more than ``capacity`` are masked, the last ones stay. Inside a compiled loop the memory
    is updated in place.
    """
    rows = _pack(batch, replay.rows.dtype)
    ordinal = jnp.cumsum(mask, dtype=jnp.int32)  # 1 for the first one written, 2 for the second …
    count = ordinal[-1]
    # Rows that later ones of the same batch would overwrite are dropped too: a scatter with
    # repeated indices promises no order.
    kept = mask & (ordinal > count - replay.capacity)
    slot = jnp.where(kept, (replay.position + ordinal - 1) % replay.capacity, replay.capacity)
    return Replay(
        rows=replay.rows.at[slot].set(rows, mode="drop"), position=replay.position + count
    )


def sample(replay: Replay, key: jax.Array, batch: int) -> Transition:
    """Draws ``batch`` transitions uniformly and with replacement from the filled part.

    Drawing without replacement would sort the whole memory; with thousands of rows a batch rarely
    holds one twice. An empty memory yields zeros.
    """
    index = jax.random.randint(key, (batch,), 0, jnp.maximum(replay.filled, 1), jnp.int32)
    return _unpack(replay.rows[index])


def _pack(batch: Transition, dtype: jnp.dtype) -> jax.Array:
    """Transitions as rows [B, 2F + 3]; an action index is exact in float32 up to 2^24."""
    scalars = jnp.stack([batch.action.astype(dtype), batch.reward, batch.discount], axis=-1)
    return jnp.concatenate([batch.features, scalars, batch.next_features], axis=-1).astype(dtype)


def _unpack(rows: jax.Array) -> Transition:
    inputs = (rows.shape[-1] - _SCALARS) // 2
    return Transition(
        features=rows[:, :inputs],
        action=rows[:, inputs].astype(jnp.int32),
        reward=rows[:, inputs + 1],
        discount=rows[:, inputs + 2],
        next_features=rows[:, inputs + _SCALARS :],
    )
