"""Updates against an independent double-precision implementation in NumPy."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from lanewise.learning import learner
from lanewise.learning.replay import Transition
from lanewise.learning.settings import LearnerSettings

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


def forward(layers, x):
    """Activations of every layer, the Q-values last."""
    activations = [x]
    for i, (w, b) in enumerate(layers):
        x = x @ w + b
        if i < len(layers) - 1:
            x = np.where(x > 0, x, 0)
        activations.append(x)
    return activations


def reference(settings, layers, batches):
    """Double or plain DQN with Adam, gradients by hand; returns online, target and losses."""
    online = [[np.array(a, np.float64) for a in layer] for layer in layers]
    target = [[a.copy() for a in layer] for layer in online]
    first = [[np.zeros_like(a) for a in layer] for layer in online]
    second = [[np.zeros_like(a) for a in layer] for layer in online]
    losses = []
    for t, batch in enumerate(batches, start=1):
        rows = np.arange(BATCH)
        next_target = forward(target, batch.next_features)[-1]
        chooser = forward(online, batch.next_features)[-1] if settings.double else next_target
        y = batch.reward + batch.discount * next_target[rows, chooser.argmax(axis=1)]
        activations = forward(online, batch.features)
        error = activations[-1][rows, batch.action] - y
        losses.append(np.mean(error**2))
        delta = np.zeros((BATCH, OUTPUTS))
        delta[rows, batch.action] = 2 * error / BATCH
        gradients = []
        for i in reversed(range(len(online))):
            gradients.insert(0, [activations[i].T @ delta, delta.sum(axis=0)])
            delta = (delta @ online[i][0].T) * (activations[i] > 0)
        for i, layer in enumerate(gradients):
            for j, g in enumerate(layer):
                first[i][j] = 0.9 * first[i][j] + 0.1 * g
                second[i][j] = 0.999 * second[i][j] + 0.001 * g**2
                m = first[i][j] / (1 - 0.9**t)
                v = second[i][j] / (1 - 0.999**t)
                online[i][j] = online[i][j] - settings.learning_rate * m / (np.sqrt(v) + 1e-8)
                if settings.target_update == "moving-average":
                    target[i][j] = (1 - 0.07) * target[i][j] + 0.07 * online[i][j]
                elif t % 8 == 0:
                    target[i][j] = online[i][j].copy()
    return online, target, losses


def compare(settings, dtype, tolerance):
    state = learner.begin(jax.random.key(0), settings, INPUTS, OUTPUTS)
    state = jax.tree.map(
        lambda a: a.astype(dtype) if jnp.issubdtype(a.dtype, jnp.floating) else a, state
    )
    batches = make_batches(dtype)
    expected_online, expected_target, expected_losses = reference(settings, state.online, batches)
    losses = []
    for batch in batches:
        state, metrics = update(settings, state, batch)
        losses.append(metrics.loss)
    assert state.online[0][0].dtype == dtype
    np.testing.assert_allclose(losses, expected_losses, rtol=tolerance, atol=tolerance)
    for got, expected in ((state.online, expected_online), (state.target, expected_target)):
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
