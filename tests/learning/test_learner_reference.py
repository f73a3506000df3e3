"""Updates against an independent double-precision implementation in NumPy."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from lanewise.learning import learner
from lanewise.learning.replay import Transition
from lanewise.learning.settings import LearnerSettings
from learner_reference import Reference

INPUTS, OUTPUTS, BATCH, UPDATES = 5, 3, 16, 50
KINDS = [(double, kind) for double in (True, False) for kind in ("moving-average", "hard-copy")]
update = jax.jit(learner.update, static_argnums=0)


def make_settings(double: bool, kind: str) -> LearnerSettings:
    return LearnerSettings(
        hidden=(16, 12),
        double=double,
        learning_rate=3e-3,
        batch_size=BATCH,
        target_update=kind,
        target_rate=0.07,
        target_interval=8,
    )


def make_batches(dtype) -> list[Transition]:
    rng = np.random.default_rng(7)
    return [
        Transition(
            features=rng.normal(size=(BATCH, INPUTS)).astype(dtype),
            action=rng.integers(OUTPUTS, size=BATCH).astype(np.int32),
            reward=rng.normal(size=BATCH).astype(dtype),
            discount=rng.choice([0.0, 0.8, 0.512], size=BATCH).astype(dtype),
            next_features=rng.normal(size=(BATCH, INPUTS)).astype(dtype),
        )
        for _ in range(UPDATES)
    ]


def compare(settings, dtype, tolerance):
    state = learner.begin(jax.random.key(0), settings, INPUTS, OUTPUTS)
    state = jax.tree.map(
        lambda a: a.astype(dtype) if jnp.issubdtype(a.dtype, jnp.floating) else a, state
    )
    batches = make_batches(dtype)
    reference = Reference(settings, state.online)
    losses = []
    for batch in batches:
        reference.update(batch)
        state, metrics = update(settings, state, batch)
        losses.append(metrics.loss)
    assert state.online[0][0].dtype == dtype
    np.testing.assert_allclose(losses, reference.losses, rtol=tolerance, atol=tolerance)
    for got, expected in ((state.online, reference.online), (state.target, reference.target)):
        for got_layer, expected_layer in zip(got, expected, strict=True):
            for a, b in zip(got_layer, expected_layer, strict=True):
                np.testing.assert_allclose(a, b, rtol=tolerance, atol=tolerance)
    assert int(state.updates) == UPDATES


@pytest.mark.parametrize(("double", "kind"), KINDS)
def test_double_precision_to_ten_digits(double, kind):
    with jax.enable_x64(True):
        compare(make_settings(double, kind), np.float64, 1e-10)


def test_single_precision():
    compare(make_settings(double=True, kind="moving-average"), np.float32, 2e-4)


def test_step_size_falls_linearly_and_stays():
    """With one weight and a constant gradient Adam moves by exactly its step size."""
    settings = LearnerSettings(learning_rate=1e-2, final_learning_rate=1e-3, learning_rate_decay=10)
    adam = learner._adam(settings)
    weight = jnp.float32(0.0)
    state = adam.init(weight)
    moved = []
    for _ in range(14):
        step, state = adam.update(jnp.float32(1.0), state)
        moved.append(-float(step))
    expected = [1e-2 - 9e-3 * min(i / 10, 1.0) for i in range(14)]
    np.testing.assert_allclose(moved, expected, rtol=1e-4)
