"""Updates against an independent double-precision implementation in NumPy."""

import jax
import numpy as np
import pytest

from lanewise.learning import learner
from lanewise.learning.replay import Transition
from lanewise.learning.settings import LearnerSettings
from learner_reference import Reference

INPUTS, OUTPUTS, BATCH, UPDATES = 5, 3, 16, 50
update = jax.jit(learner.update, static_argnums=0)
begin = jax.jit(learner.begin, static_argnums=(1, 2, 3))


def batches(rng):
    for _ in range(UPDATES):
        yield Transition(
            features=rng.normal(size=(BATCH, INPUTS)),
            action=rng.integers(OUTPUTS, size=BATCH).astype(np.int32),
            reward=rng.normal(size=BATCH),
            discount=rng.choice([0.0, 0.8, 0.512], size=BATCH),
            next_features=rng.normal(size=(BATCH, INPUTS)),
        )


@pytest.mark.parametrize(("double", "kind"), [(True, "moving-average"), (False, "hard-copy")])
def test_fifty_updates_to_ten_digits(double, kind):
    settings = LearnerSettings(
        hidden=(16, 12),
        double=double,
        learning_rate=3e-3,
        batch_size=BATCH,
        target_update=kind,
        target_rate=0.07,
        target_interval=8,
    )
    with jax.enable_x64(True):
        state = begin(jax.random.key(0), settings, INPUTS, OUTPUTS)
        state = jax.tree.map(
            lambda leaf: np.asarray(leaf, float) if leaf.dtype == np.float32 else leaf, state
        )
        reference, losses = Reference(settings, state.online), []
        for batch in batches(np.random.default_rng(7)):
            reference.update(batch)
            state, metrics = update(settings, state, batch)
            losses.append(float(metrics.loss))
            if len(losses) == 1:
                np.testing.assert_allclose(metrics.mean_q, reference.mean_q, rtol=1e-10)
    assert state.online[0][0].dtype == np.float64
    np.testing.assert_allclose(losses, reference.losses, rtol=1e-10)
    for ours, theirs in ((state.online, reference.online), (state.target, reference.target)):
        for a, b in zip(jax.tree.leaves(ours), jax.tree.leaves(theirs), strict=True):
            np.testing.assert_allclose(a, b, rtol=1e-10, atol=1e-10)
    assert int(state.updates) == UPDATES


def test_step_size_falls_linearly_and_stays():
    """With one weight and a constant gradient Adam moves by exactly its step size."""
    settings = LearnerSettings(learning_rate=1e-2, final_learning_rate=1e-3, learning_rate_decay=10)
    adam = learner._adam(settings)
    state, moved, step_of = adam.init(np.float32(0.0)), [], jax.jit(adam.update)
    for _ in range(14):
        step, state = step_of(np.float32(1.0), state)
        moved.append(-float(step))
    expected = [1e-2 - 9e-3 * min(i / 10, 1.0) for i in range(14)]
    np.testing.assert_allclose(moved, expected, rtol=1e-4)
