"""The learner on problems small enough to solve by hand."""

from dataclasses import replace
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from lanewise.learning import learner, network, replay
from lanewise.learning.replay import Transition
from lanewise.learning.settings import LearnerSettings

GAMMA = 0.8
STATES, ACTIONS = 2, 2

# Each problem: (state, action, reward, discount, next state) of every decision there is,
# and Q[state, action].
TERMINATION = (
    # Action 0 waits, action 1 goes on: 0 -> 1 -> the end, which pays 1.
    [(0, 0, 0.0, GAMMA, 0), (0, 1, 0.0, GAMMA, 1), (1, 0, 0.0, GAMMA, 1), (1, 1, 1.0, 0.0, 1)],
    [[0.64, 0.8], [0.8, 1.0]],
)
TRUNCATION = (
    # Action 1 pays 1 for ever, and the clock always stops the episode in state 1. Bootstrapped
    # through, V = 1 / (1 - gamma) = 5; taken for the end, Q(1, 1) would be 1 and Q(0, 1) 1.8.
    [(0, 0, 0.0, GAMMA, 0), (0, 1, 1.0, GAMMA, 1), (1, 0, 0.0, GAMMA, 0), (1, 1, 1.0, GAMMA, 1)],
    [[4.0, 5.0], [4.0, 5.0]],
)


PROBLEMS = {"termination": TERMINATION, "truncation": TRUNCATION}
SETTINGS = LearnerSettings(
    hidden=(32,),
    discount=GAMMA,
    learning_rate=3e-3,
    batch_size=16,
    target_rate=0.05,
    target_interval=25,
)
PLAIN = replace(SETTINGS, double=False, target_update="hard-copy")


def fill(decisions):
    state, action, reward, discount, after = (np.array(c) for c in zip(*decisions, strict=True))
    one_hot = np.eye(STATES, dtype=np.float32)
    batch = Transition(
        features=one_hot[state],
        action=action.astype(np.int32),
        reward=reward.astype(np.float32),
        discount=discount.astype(np.float32),
        next_features=one_hot[after],
    )
    return replay.add(replay.empty(10, STATES), batch, np.ones(len(decisions), bool))


@partial(jax.jit, static_argnums=0)
def train(settings, memory, key, updates):
    """(the learner, the last loss)."""
    begin_key, samples_key = jax.random.split(key)

    def step(number, carry):
        batch = replay.sample(memory, jax.random.fold_in(samples_key, number), settings.batch_size)
        state, metrics = learner.update(settings, carry[0], batch)
        return state, metrics.loss

    begun = learner.begin(begin_key, settings, STATES, ACTIONS), jnp.float32(0.0)
    return jax.lax.fori_loop(0, updates, step, begun)


@pytest.mark.parametrize("settings", [SETTINGS, PLAIN], ids=["double", "plain"])
@pytest.mark.parametrize("problem", PROBLEMS)
def test_learns_the_values_worked_out_by_hand(problem, settings):
    decisions, expected = PROBLEMS[problem]
    memory, key = fill(decisions), jax.random.key(0)
    state, loss = train(settings, memory, key, 4000)
    for parameters in (state.online, state.target):
        q = network.q_values(parameters, np.eye(STATES, dtype=np.float32))
        np.testing.assert_allclose(q, expected, atol=5e-3)
    assert float(loss) < 1e-4 < float(train(settings, memory, key, 1)[1])


def test_hard_copies_come_at_the_interval_only():
    first, before, at = (
        train(PLAIN, fill(TERMINATION[0]), jax.random.key(0), updates)[0] for updates in (0, 24, 25)
    )
    np.testing.assert_array_equal(before.target[0][0], first.online[0][0])
    np.testing.assert_array_equal(at.target[0][0], at.online[0][0])
    assert not np.array_equal(before.target[0][0], before.online[0][0])
