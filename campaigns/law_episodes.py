"""Laws of whole episodes in the paper's trap, in float32 as in training."""

from dataclasses import replace
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
from law_worlds import Found, Law

from lanewise.driving import accidents, episode
from lanewise.driving.settings import DrivingSettings
from lanewise.scenario import trap
from lanewise.scenario.settings import TrapSettings

TRAP, DRIVING = TrapSettings(training_ego_speed=(8.0, 14.0)), DrivingSettings()
DECISIONS = 50
SIZES = (1, 12, 96, 768)
"""Worlds in a batch; of 768 worlds of 12 vehicles a CPU takes a block at a time."""


@partial(jax.jit, static_argnums=1)
def starts(seed, split, indices):
    """Worlds at the start."""

    def one(index):
        return trap.sample(TRAP, trap.start_key(seed, split, index), split)

    return jax.vmap(one)(indices)


@jax.jit
def drive(worlds, actions):
    """Each episode and outcome after every decision; actions int32 [D, W]."""

    def decide(states, chosen):
        def one(state, action):
            return episode.step(DRIVING, state, action, DECISIONS)

        after = jax.vmap(one)(states, chosen)
        return after[0], (*after, states)

    begun = jax.vmap(episode.begin)(worlds)
    return jax.lax.scan(decide, begun, actions)[1]


def _actions(rng, count):
    """Mostly idle, so that some episodes go on to their end."""
    wild = rng.random((DECISIONS, count)) < rng.choice([0.05, 0.3, 1.0], count)
    return jnp.asarray(np.where(wild, rng.integers(0, 9, wild.shape), 4), jnp.int32)


def _begin(rng, count):
    """Starts; every other ego in the rightmost lane, where it gets past the trap with ease."""
    worlds = starts(int(rng.integers(2**31)), "training", jnp.arange(count))
    right = jnp.where(jnp.arange(count) % 2 == 0, worlds.road.centre[:, -1], 0.0)
    y = worlds.vehicles.y.at[:, 0].set(right)
    return replace(worlds, vehicles=replace(worlds.vehicles, y=y))


def success(worlds, rng):
    """Success stays, comes with no accident, and only one ending ends an episode.

    Once the ego has escaped it has, whatever follows; it does not in the decision of an accident.
    Decisions count up by one; an episode is cut off at its last decision unless an accident
    ended it; an accident costs the penalty, and only an accident ends before that.
    """
    count = SIZES[-1]
    after, outcome, before = jax.tree.map(np.array, drive(_begin(rng, count), _actions(rng, count)))
    # What comes after an ending is no part of the episode.
    ended = (outcome.terminated | outcome.truncated).cumsum(axis=0)
    alive = np.concatenate([np.zeros((1, count), ended.dtype), ended[:-1]]).T == 0
    found = Found(count)

    def holds(what, values):
        found.require(what, values.T, alive)

    holds("success stays", after.escaped | ~before.escaped)
    gained = after.escaped & ~before.escaped
    holds("no success in an accident", ~(gained & outcome.terminated))
    holds("counts up", after.decisions == before.decisions + 1)
    holds("one ending", ~(outcome.terminated & outcome.truncated))
    holds("terminated by accident", outcome.terminated == (outcome.accident != accidents.NONE))
    last = after.decisions == DECISIONS
    holds("truncated at the end", outcome.truncated == (last & ~outcome.terminated))
    penalty = outcome.reward == -DRIVING.reward.accident_penalty
    holds("penalty", penalty == outcome.terminated)
    holds("reward", penalty | ((outcome.reward <= 1 + 1e-6) & (outcome.reward >= -0.01)))
    crashed = before.world.vehicles.crashed & ~after.world.vehicles.crashed
    holds("crashed stays crashed", ~crashed.any(axis=-1))
    trap_cars = after.world.vehicles.speed[..., 1:3] == before.world.vehicles.speed[..., 1:3]
    hit = after.world.vehicles.crashed[..., 1:3]
    # A push before a crash does not change a speed, so that only the crashed may brake.
    holds("trap cars keep their speed", (trap_cars | hit).all(axis=-1))
    found.quirks["escapes seen"] = int((gained.T & alive).sum())
    found.quirks["accidents seen"] = int((outcome.terminated.T & alive).sum())
    return found


def batch(worlds, rng):
    """Episodes are the same, to the bit, in batches of any size."""
    seed, count = int(rng.integers(2**31)), SIZES[-1]
    index, actions = jnp.arange(count), _actions(rng, count)
    found = Found(count)
    all_starts = starts(seed, "training", index)
    whole = jax.tree.map(np.array, (all_starts, drive(all_starts, actions)[0].world.vehicles))
    for size in SIZES[:-1]:
        for first in range(0, min(count, 8 * size), size):
            some = slice(first, first + size)
            own = starts(seed, "training", index[some])
            mine = jax.tree.map(np.array, (own, drive(own, actions[:, some])[0].world.vehicles))
            _same(found, f"start of {size}", mine[0], whole[0], lambda leaf, s=some: leaf[s])
            _same(found, f"drive of {size}", mine[1], whole[1], lambda leaf, s=some: leaf[:, s])
    return found


def _same(found, what, part, whole, taken):
    """Note where leaves of a part are not bits of the whole."""
    for mine, leaf in zip(jax.tree.leaves(part), jax.tree.leaves(whole), strict=True):
        same = np.array_equal(mine, taken(leaf), equal_nan=mine.dtype.kind == "f")
        found.require(what, np.array([[same]]), np.array([[True]]))


LAWS = (
    Law("success", "Success stays, comes with no accident; one ending ends an episode",
        "equal", success, "trap starts, 50 random decisions"),
    Law("batch", "Starts and episodes are the same in batches of any size",
        "equal to the bit in batches of 1, 12, 96 and 768", batch,
        "trap starts, 50 random decisions"),
)  # fmt: skip
