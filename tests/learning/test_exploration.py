"""Epsilon schedules at known points, and the frequencies of epsilon-greedy."""

import math

import jax
import jax.numpy as jnp
import numpy as np

from lanewise.learning import exploration
from lanewise.learning.settings import ExplorationSettings

LINEAR = ExplorationSettings(schedule="linear", start=0.5, end=0.02, steps=32_000)
EXPONENTIAL = ExplorationSettings(schedule="exponential", start=1.0, end=0.05, steps=6_000)
Q = np.array([0.1, 0.7, 0.7, -1.0], np.float32)


def test_schedules_at_known_points():
    for settings, steps, expected in (
        (LINEAR, [0, 8_000, 16_000, 2_000_000_000], [0.5, 0.38, 0.26, 0.02]),
        (
            EXPONENTIAL,
            [0, 6_000, 12_000, 2_000_000_000],
            [1.0, 0.05 + 0.95 / math.e, 0.05 + 0.95 / math.e**2, 0.05],
        ),
    ):
        epsilon = exploration.epsilon(settings, np.array(steps, np.int32))
        assert epsilon.dtype == jnp.float32
        np.testing.assert_allclose(epsilon, expected, atol=1e-6)


def test_greedy_takes_the_lowest_of_equal_actions_and_all_others_at_random():
    keys = jax.random.split(jax.random.key(3), 20_000)
    act = jax.jit(jax.vmap(exploration.epsilon_greedy, in_axes=(0, None, None)))
    for epsilon in (0.0, 0.4, 1.0):
        chosen = np.asarray(act(keys, Q, np.float32(epsilon)))
        assert chosen.dtype == np.int32
        frequency = np.bincount(chosen, minlength=4) / 20_000
        expected = np.full(4, epsilon / 4) + (1 - epsilon) * np.array([0, 1, 0, 0])
        # Five standard deviations of a frequency of at most 1/2; none at epsilon 0.
        allowed = 5 * math.sqrt(0.25 / 20_000) if epsilon else 0.0
        np.testing.assert_allclose(frequency, expected, atol=allowed, rtol=0)
