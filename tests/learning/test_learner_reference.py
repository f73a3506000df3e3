"""Updates against double (or plain) deep Q-learning with Adam once more, in double precision.

The reference has its gradients by hand in NumPy, and shares no formula's code with the learner.
"""

import jax
import numpy as np
import pytest

from lanewise.learning import learner
from lanewise.learning.replay import Transition
from lanewise.learning.settings import LearnerSettings

BETA_1, BETA_2, EPSILON = 0.9, 0.999, 1e-8
"""Adam's, as in Kingma and Ba (2015)."""
INPUTS, OUTPUTS, BATCH, UPDATES = 5, 3, 16, 50
update = jax.jit(learner.update, static_argnums=0)
begin = jax.jit(learner.begin, static_argnums=(1, 2, 3))


class Reference:
    """Online and target network, Adam's moments, and the losses so far.

    Networks are lists of weights [inputs, outputs] and biases [outputs], by turns.
    """

    def __init__(self, settings, online):
        self.settings, self.losses = settings, []
        self.online, self.target = list(online), list(online)
        self.first, self.second = ([np.zeros_like(leaf) for leaf in online] for _ in range(2))

    def update(self, batch):
        """One step on a batch of transitions: the mean Q-value of the actions taken before it."""
        rows = np.arange(len(batch.action))
        next_target = forward(self.target, batch.next_features)[-1]
        double = self.settings.double
        chooser = forward(self.online, batch.next_features)[-1] if double else next_target
        y = batch.reward + batch.discount * next_target[rows, chooser.argmax(axis=1)]
        activations = forward(self.online, batch.features)
        taken = activations[-1][rows, batch.action]
        self.losses.append(np.mean((taken - y) ** 2))
        delta = np.zeros_like(activations[-1])
        delta[rows, batch.action] = 2.0 * (taken - y) / len(rows)
        gradients = []
        for weights, below in zip(self.online[-2::-2], activations[-2::-1], strict=True):
            gradients = [below.T @ delta, delta.sum(axis=0), *gradients]
            delta = (delta @ weights.T) * (below > 0)
        self._adam(gradients)
        self._follow()
        return taken.mean()

    def _adam(self, gradients):
        t, how = len(self.losses), self.settings
        rate = how.learning_rate
        if how.learning_rate_decay:
            share = min((t - 1) / how.learning_rate_decay, 1.0)
            rate = (1.0 - share) * how.learning_rate + share * how.final_learning_rate
        for i, gradient in enumerate(gradients):
            self.first[i] = BETA_1 * self.first[i] + (1.0 - BETA_1) * gradient
            self.second[i] = BETA_2 * self.second[i] + (1.0 - BETA_2) * gradient**2
            mean, spread = self.first[i] / (1.0 - BETA_1**t), self.second[i] / (1.0 - BETA_2**t)
            self.online[i] = self.online[i] - rate * mean / (np.sqrt(spread) + EPSILON)

    def _follow(self):
        how, both = self.settings, zip(self.target, self.online, strict=True)
        if how.target_update == "moving-average":
            self.target = [(1.0 - how.target_rate) * t + how.target_rate * o for t, o in both]
        elif len(self.losses) % how.target_interval == 0:
            self.target = list(self.online)


def forward(network, x):
    """Activations of every layer, the input first and the Q-values last."""
    activations = [x]
    for weights, biases in zip(network[::2], network[1::2], strict=True):
        activations.append(np.maximum(activations[-1] @ weights + biases, 0.0))
    return [*activations[:-1], activations[-2] @ weights + biases]


def batches(rng):
    for _ in range(UPDATES):
        yield Transition(
            features=rng.normal(size=(BATCH, INPUTS)),
            action=rng.integers(OUTPUTS, size=BATCH).astype(np.int32),
            reward=rng.normal(size=BATCH),
            discount=rng.choice([0.0, 0.8, 0.512], size=BATCH),
            next_features=rng.normal(size=(BATCH, INPUTS)),
        )


@pytest.mark.parametrize(
    ("double", "kind", "decay"), [(True, "moving-average", 0), (False, "hard-copy", 30)]
)
def test_fifty_updates_to_ten_digits(double, kind, decay):
    settings = LearnerSettings(
        hidden=(16, 12),
        double=double,
        learning_rate=3e-3,
        learning_rate_decay=decay,
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
        reference, found = Reference(settings, jax.tree.leaves(state.online)), []
        for batch in batches(np.random.default_rng(7)):
            mean_q = reference.update(batch)
            state, metrics = update(settings, state, batch)
            found.append((float(metrics.loss), float(metrics.mean_q), mean_q))
    losses, ours, theirs = np.transpose(found)
    np.testing.assert_allclose(losses, reference.losses, rtol=1e-10)
    np.testing.assert_allclose(ours, theirs, rtol=1e-10, atol=1e-10)
    for tree, leaves in ((state.online, reference.online), (state.target, reference.target)):
        for a, b in zip(jax.tree.leaves(tree), leaves, strict=True):
            assert a.dtype == np.float64
            np.testing.assert_allclose(a, b, rtol=1e-10, atol=1e-10)
    assert int(state.updates) == UPDATES
