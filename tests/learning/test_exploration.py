"""Epsilon schedules at known points, and the frequencies of epsilon-greedy."""

import math

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from lanewise.learning import exploration
from lanewise.learning.settings import ExplorationSettings

LINEAR = ExplorationSettings(schedule="linear", start=0.5, end=0.02, steps=32_000)
EXPONENTIAL = ExplorationSettings(schedule="exponential", start=1.0, end=0.05, steps=6_000)
Q = jnp.array([0.1, 0.7, 0.7, -1.0])


@pytest.mark.parametrize(
    ("settings", "steps", "expected"),
    [
        (LINEAR, 0, 0.5),
        (LINEAR, 8_000, 0.38),
        (LINEAR, 16_000, 0.26),
        (LINEAR, 32_000, 0.02),
        (LINEAR, 2_000_000_000, 0.02),
        (EXPONENTIAL, 0, 1.0),
        (EXPONENTIAL, 6_000, 0.05 + 0.95 / math.e),
        (EXPONENTIAL, 12_000, 0.05 + 0.95 / math.e**2),
        (EXPONENTIAL, 2_000_000_000, 0.05),
    ],
)
def test_schedule_at_known_points(settings, steps, expected):
    epsilon = exploration.epsilon(settings, jnp.asarray(steps, jnp.int32))
    assert epsilon.dtype == jnp.float32
    assert float(epsilon) == pytest.approx(expected, abs=1e-6)


def test_schedule_takes_many_steps_at_once():
    many = exploration.epsilon(LINEAR, jnp.array([0, 16_000]))
    np.testing.assert_allclose(many, [0.5, 0.26], rtol=1e-6)


def actions(epsilon: float, count: int) -> np.ndarray:
    keys = jax.random.split(jax.random.key(3), count)
    act = jax.vmap(exploration.epsilon_greedy, in_axes=(0, None, None))
    return np.asarray(act(keys, Q, jnp.float32(epsilon)))


def test_greedy_takes_the_lowest_of_equal_actions():
    chosen = actions(0.0, 100)
    assert chosen.dtype == np.int32
    assert (chosen == 1).all()


@pytest.mark.parametrize("epsilon", [0.4, 1.0])
def test_frequencies(epsilon):
    frequency = np.bincount(actions(epsilon, 20_000), minlength=4) / 20_000
    expected = np.full(4, epsilon / 4) + (1 - epsilon) * np.array([0, 1, 0, 0])
    # Five standard deviations of a frequency of at most 1/2.
    np.testing.assert_allclose(frequency, expected, atol=5 * math.sqrt(0.25 / 20_000))
