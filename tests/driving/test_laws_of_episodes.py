"""The laws of whole episodes in docs/numerics.md: the trap, 50 random decisions, in float32."""

from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from lanewise.driving import accidents, episode
from lanewise.driving.settings import DrivingSettings
from lanewise.scenario import trap
from lanewise.scenario.settings import TrapSettings

TRAP, DRIVING = TrapSettings(training_ego_speed=(8.0, 14.0)), DrivingSettings()
DECISIONS, COUNT = 50, 768
"""Of 768 worlds of 12 vehicles a CPU takes a block at a time."""

pytestmark = pytest.mark.slow


@jax.jit
def drive(indices, actions):
    """(worlds at the start, (episode after, episode before) of every decision).

    Every other ego is in the rightmost lane, where it passes the trap with ease.
    """

    def one(index):
        world = trap.sample(TRAP, trap.start_key(5, "training", index), "training")
        right = jnp.where(index % 2 == 0, world.road.centre[-1], 0.0)
        return replace(world, vehicles=replace(world.vehicles, y=world.vehicles.y.at[0].set(right)))

    def decide(states, chosen):
        step = jax.vmap(lambda state, action: episode.step(DRIVING, state, action, DECISIONS))
        after = step(states, chosen)
        return after, (after, states)

    worlds = jax.vmap(one)(indices)
    return worlds, jax.lax.scan(decide, jax.vmap(episode.begin)(worlds), actions)[1]


@pytest.fixture(scope="module")
def actions():
    """Mostly idle, so that some episodes go on to their end; int32 [D, W]."""
    rng = np.random.default_rng(2)
    wild = rng.random((DECISIONS, COUNT)) < rng.choice([0.05, 0.3, 1.0], COUNT)
    return np.where(wild, rng.integers(0, 9, wild.shape), 4).astype(np.int32)


@pytest.fixture(scope="module")
def whole(actions):
    return jax.tree.map(np.array, drive(np.arange(COUNT), actions))


def test_success_stays_and_one_ending_ends_an_episode(whole):
    _, found = whole
    ended = found[0].outcome.over.cumsum(axis=0)
    # What comes after an ending is no part of the episode.
    after, before = jax.tree.map(
        lambda leaf: leaf[np.concatenate([np.zeros((1, COUNT)), ended[:-1]]) == 0], found
    )
    outcome, now, then = after.outcome, after.stats, before.stats
    gained = now.escaped & ~then.escaped
    assert gained.any()
    assert outcome.terminated.any()
    assert outcome.truncated.any()
    assert (now.escaped | ~then.escaped).all()
    assert not (gained & outcome.terminated).any()
    np.testing.assert_array_equal(now.decisions, then.decisions + 1)
    np.testing.assert_array_equal(outcome.terminated, outcome.accident != accidents.NONE)
    last = now.decisions == DECISIONS
    np.testing.assert_array_equal(outcome.truncated, last & ~outcome.terminated)
    penalty = outcome.reward == -DRIVING.reward.accident_penalty
    np.testing.assert_array_equal(penalty, outcome.terminated)
    assert ((outcome.reward <= 1 + 1e-6) & (outcome.reward >= -0.01))[~penalty].all()
    then, now = before.world.vehicles, after.world.vehicles
    assert (now.crashed | ~then.crashed).all()
    # A push before a crash does not change a speed, so that only the crashed may brake.
    kept = (now.speed == then.speed) | now.crashed
    assert kept[:, 1:3].all(), "trap cars keep their speed"


@pytest.mark.parametrize("size", [1, 96])
def test_episodes_are_the_same_in_batches_of_any_size(whole, actions, size):
    some = slice(size, 2 * size)
    worlds, (after, _) = drive(np.arange(COUNT)[some], actions[:, some])
    expected = (
        jax.tree.map(lambda leaf: leaf[some], whole[0]),
        jax.tree.map(lambda leaf: leaf[:, some], whole[1][0].world.vehicles),
    )
    found = (worlds, after.world.vehicles)
    for mine, its in zip(jax.tree.leaves(found), jax.tree.leaves(expected), strict=True):
        np.testing.assert_array_equal(mine, its)
