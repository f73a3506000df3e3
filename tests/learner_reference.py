"""Double (or plain) deep Q-learning with Adam once more, in NumPy: gradients by hand.

Imports nothing of the learner; shares no formula's code with it.
"""

import numpy as np

BETA_1, BETA_2, EPSILON = 0.9, 0.999, 1e-8
"""Adam's, as in Kingma and Ba (2015)."""


class Reference:
    """Online and target network, Adam's moments, and the losses so far."""

    def __init__(self, settings, layers, dtype=np.float64):
        """Begin with ``layers``, pairs of weights [inputs, outputs] and biases [outputs]."""
        self.settings = settings
        self.online = [[np.array(array, dtype) for array in layer] for layer in layers]
        self.target = [[array.copy() for array in layer] for layer in self.online]
        self.first = [[np.zeros_like(array) for array in layer] for layer in self.online]
        self.second = [[np.zeros_like(array) for array in layer] for layer in self.online]
        self.losses = []
        self.mean_q = np.nan
        """Of the last batch, over the actions taken."""

    def update(self, batch):
        """One step on a batch of transitions."""
        chosen = self.settings.double
        rows = np.arange(len(batch.action))
        next_target = forward(self.target, batch.next_features)[-1]
        chooser = forward(self.online, batch.next_features)[-1] if chosen else next_target
        y = batch.reward + batch.discount * next_target[rows, chooser.argmax(axis=1)]
        activations = forward(self.online, batch.features)
        error = activations[-1][rows, batch.action] - y
        self.mean_q = activations[-1][rows, batch.action].mean()
        self.losses.append(np.mean(error**2))
        delta = np.zeros_like(activations[-1])
        delta[rows, batch.action] = 2.0 * error / len(rows)
        gradients = []
        for layer in reversed(range(len(self.online))):
            gradients.insert(0, [activations[layer].T @ delta, delta.sum(axis=0)])
            delta = (delta @ self.online[layer][0].T) * (activations[layer] > 0)
        self._adam(gradients)
        self._follow()

    def _adam(self, gradients):
        t = len(self.losses)
        for layer, part in ((i, j) for i in range(len(gradients)) for j in range(2)):
            gradient = gradients[layer][part]
            first, second = self.first[layer][part], self.second[layer][part]
            first += (1.0 - BETA_1) * (gradient - first)
            second += (1.0 - BETA_2) * (gradient**2 - second)
            mean, spread = first / (1.0 - BETA_1**t), second / (1.0 - BETA_2**t)
            self.online[layer][part] -= self._rate(t) * mean / (np.sqrt(spread) + EPSILON)

    def _rate(self, t):
        """Step size of update number ``t``, from 1 on: it falls along a line, then stays."""
        how = self.settings
        if not how.learning_rate_decay:
            return how.learning_rate
        share = min((t - 1) / how.learning_rate_decay, 1.0)
        return (1.0 - share) * how.learning_rate + share * how.final_learning_rate

    def _follow(self):
        how, t = self.settings, len(self.losses)
        for target, online in zip(self.target, self.online, strict=True):
            for part in range(2):
                if how.target_update == "moving-average":
                    share = how.target_rate
                    target[part] = (1.0 - share) * target[part] + share * online[part]
                elif t % how.target_interval == 0:
                    target[part] = online[part].copy()


def forward(layers, x):
    """Activations of every layer, the input first and the Q-values last."""
    activations = [x]
    for number, (weights, biases) in enumerate(layers):
        x = x @ weights + biases
        if number < len(layers) - 1:
            x = np.where(x > 0, x, 0.0)
        activations.append(x)
    return activations
