"""A thousand updates on transitions that training wrote, against the reference in NumPy."""

from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from test_stage import COURSE

from lanewise.learning import learner
from lanewise.learning.replay import Transition
from lanewise.learning.settings import LearnerSettings
from lanewise.training import stage
from learner_reference import Reference

UPDATES, LIMIT = 1000, 1e-10
CHANGES = {
    "quick": {},
    "plain, hard copy, falling rate": {
        "double": False,
        "target_update": "hard-copy",
        "learning_rate_decay": 600,
    },
}

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def rows():
    """What two chunks of the single-level controller leave in its replay, in float64."""
    state = stage.begin(COURSE, {}, jax.random.key(0))
    for _ in range(2):
        state, _ = stage.advance(COURSE, {}, state)
    return np.asarray(state.replays["single_level"].rows, np.float64)


def batches(rows, size):
    """Batches drawn with replacement."""
    rng, inputs = np.random.default_rng(0), (rows.shape[1] - 3) // 2
    for _ in range(UPDATES):
        drawn = rows[rng.integers(len(rows), size=size)]
        yield Transition(
            features=drawn[:, :inputs],
            action=drawn[:, inputs].astype(np.int32),
            reward=drawn[:, inputs + 1],
            discount=drawn[:, inputs + 2],
            next_features=drawn[:, inputs + 3 :],
        )


def error(ours, theirs):
    """Over all layers, the largest difference over the largest number."""
    pairs = zip(jax.tree.leaves(ours), jax.tree.leaves(theirs), strict=True)
    return float(np.max([np.abs(np.asarray(a) - b).max() / np.abs(b).max() for a, b in pairs]))


@pytest.mark.parametrize("change", CHANGES)
def test_a_thousand_updates(rows, change):
    settings = replace(LearnerSettings(hidden=(24, 24)), **CHANGES[change])
    with jax.enable_x64(True):
        update = jax.jit(learner.update, static_argnums=0)
        state = learner.begin(jax.random.key(0), settings, (rows.shape[1] - 3) // 2, 9)
        state = jax.tree.map(
            lambda leaf: leaf.astype(float) if jnp.issubdtype(leaf.dtype, jnp.floating) else leaf,
            state,
        )
        reference = Reference(settings, state.online)
        other = Reference(settings, state.online)
        losses = []
        for batch in batches(rows, settings.batch_size):
            state, metrics = update(settings, state, jax.tree.map(jnp.asarray, batch))
            losses.append(float(metrics.loss))
            reference.update(batch)
            other.update(replace(batch, discount=batch.discount * (1.0 + 1e-6)))
    np.testing.assert_allclose(losses, reference.losses, rtol=LIMIT, atol=0)
    assert error(state.online, reference.online) <= LIMIT
    assert error(state.target, reference.target) <= LIMIT
    # A slightly different discount is far beyond the limit.
    assert error(other.online, reference.online) > 100 * LIMIT
