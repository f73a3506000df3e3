"""The learner on problems small enough to solve by hand."""

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


def goal(discount: float) -> list[tuple[int, int, float, float, int]]:
    """Action 0 in state 0 is a goal that takes three steps and pays 1; the rest take one."""
    return [
        (0, 0, 1.0, discount, 1),
        (0, 1, 0.5, GAMMA, 1),
        (1, 0, 2.0, 0.0, 1),
        (1, 1, -1.0, GAMMA, 0),
    ]


# How the goal is discounted decides whether it is worth choosing: 2.6 or 2.024 against 2.1.
PER_GOAL = (goal(GAMMA), [[1 + 0.8 * 2, 0.5 + 0.8 * 2], [2.0, -1 + 0.8 * 2.6]])
PER_STEP = (goal(GAMMA**3), [[1 + 0.512 * 2, 0.5 + 0.8 * 2], [2.0, -1 + 0.8 * 2.1]])
PROBLEMS = {
    "termination": TERMINATION,
    "truncation": TRUNCATION,
    "discount-per-goal": PER_GOAL,
    "discount-per-step": PER_STEP,
}


def make_settings(double: bool = True, kind: str = "moving-average") -> LearnerSettings:
    return LearnerSettings(
        hidden=(32,),
        double=double,
        discount=GAMMA,
        learning_rate=3e-3,
        batch_size=16,
        target_update=kind,
        target_rate=0.05,
        target_interval=25,
    )


def fill(decisions) -> replay.Replay:
    state, action, reward, discount, after = (np.array(c) for c in zip(*decisions, strict=True))
    batch = Transition(
        features=jnp.eye(STATES)[state],
        action=jnp.asarray(action, jnp.int32),
        reward=jnp.asarray(reward, jnp.float32),
        discount=jnp.asarray(discount, jnp.float32),
        next_features=jnp.eye(STATES)[after],
    )
    return replay.add(replay.empty(10, STATES), batch, jnp.ones(len(decisions), bool))


@partial(jax.jit, static_argnums=(0, 3))
def train(settings, memory, key, updates):
    begin_key, samples_key = jax.random.split(key)

    def step(state, sample_key):
        batch = replay.sample(memory, sample_key, settings.batch_size)
        return learner.update(settings, state, batch)

    state = learner.begin(begin_key, settings, STATES, ACTIONS)
    return jax.lax.scan(step, state, jax.random.split(samples_key, updates))


@pytest.mark.parametrize("double", [True, False], ids=["double", "plain"])
@pytest.mark.parametrize("kind", ["moving-average", "hard-copy"])
@pytest.mark.parametrize("problem", PROBLEMS)
def test_learns_the_values_worked_out_by_hand(problem, kind, double):
    decisions, expected = PROBLEMS[problem]
    state, metrics = train(make_settings(double, kind), fill(decisions), jax.random.key(0), 4000)
    for parameters in (state.online, state.target):
        q = network.q_values(parameters, jnp.eye(STATES))
        np.testing.assert_allclose(q, expected, atol=5e-3)
    assert float(metrics.loss[-1]) < 1e-4 < float(metrics.loss[0])


def test_metrics_are_those_of_the_batch():
    memory = fill(TERMINATION[0])
    settings = make_settings()
    state = learner.begin(jax.random.key(1), settings, STATES, ACTIONS)
    batch = replay.sample(memory, jax.random.key(2), 16)
    _, metrics = jax.jit(learner.update, static_argnums=0)(settings, state, batch)
    q = np.asarray(network.q_values(state.online, batch.features))[np.arange(16), batch.action]
    after = np.asarray(network.q_values(state.online, batch.next_features)).max(axis=1)
    y = np.asarray(batch.reward) + np.asarray(batch.discount) * after
    np.testing.assert_allclose(metrics.loss, np.mean((y - q) ** 2), rtol=1e-5)
    np.testing.assert_allclose(metrics.mean_q, q.mean(), rtol=1e-4, atol=1e-6)
    np.testing.assert_allclose(metrics.mean_target, y.mean(), rtol=1e-5)
    np.testing.assert_allclose(metrics.mean_absolute_td, np.abs(y - q).mean(), rtol=1e-5)


def test_hard_copies_come_at_the_interval_only():
    settings, memory = make_settings(kind="hard-copy"), fill(TERMINATION[0])
    key = jax.random.key(0)
    first = learner.begin(jax.random.split(key)[0], settings, STATES, ACTIONS)
    before, _ = train(settings, memory, key, 24)
    at, _ = train(settings, memory, key, 25)
    np.testing.assert_allclose(before.target[0][0], first.online[0][0], rtol=1e-6)
    np.testing.assert_array_equal(at.target[0][0], at.online[0][0])


def test_same_seed_same_bits_and_two_seeds_two_runs():
    memory = fill(TERMINATION[0])
    runs = [train(make_settings(), memory, jax.random.key(k), 50) for k in (0, 0, 1)]
    first, again, other = ([np.asarray(a) for a in jax.tree.leaves(run)] for run in runs)
    assert all(a.tobytes() == b.tobytes() for a, b in zip(first, again, strict=True))
    assert not np.array_equal(runs[0][0].online[0][0], runs[2][0].online[0][0])
    assert not np.array_equal(runs[0][1].loss, runs[2][1].loss)
    assert len(first) == len(other)
