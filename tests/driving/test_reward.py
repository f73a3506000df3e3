from math import exp, pi, sin

import jax.numpy as jnp
import numpy as np
import pytest

from lanewise.driving import reward
from lanewise.driving.settings import RewardSettings

PAPER = RewardSettings()


def paper_speed_term(v):
    """Equation (3), zone by zone."""
    if v > 15:
        return exp(-((v - 15) ** 2))
    if v > 12.5:
        return 8 / 25 * v - 19 / 5
    if v > 5:
        return 2 / 75 * v - 2 / 15
    return 0.0


def total(speed, offset=0.0, angle=0.0, accident=False, settings=PAPER):
    values = (jnp.float32(value) for value in (speed, offset, angle))
    return float(reward.total(settings, *values, jnp.bool_(accident)))


def test_speed_term_is_equation_3():
    speeds = np.append(np.linspace(-5.0, 25.0, 301), [5.0, 12.5, 15.0]).astype(np.float32)
    expected = [paper_speed_term(v) for v in speeds]
    np.testing.assert_allclose(reward.speed(jnp.asarray(speeds)), expected, atol=1e-6)


def test_totals_in_closed_form():
    assert total(15.0) == pytest.approx((1.5 + 0.05) / 1.6)
    assert total(3.0) == pytest.approx(0.05 / 1.6)
    assert total(12.5, offset=1.0) == pytest.approx((1.5 * 0.2 + 0.05 * exp(-1.5)) / 1.6)
    steered = (1.5 * 0.2 + 0.05 - 0.05 * sin(pi / 50)) / 1.6
    assert total(12.5, angle=pi / 50) == pytest.approx(steered)
    assert total(12.5, angle=-pi / 50) == pytest.approx(steered)
    assert total(12.5, offset=-1.0) == total(12.5, offset=1.0)


def test_weights_are_normalised_by_their_sum():
    doubled = RewardSettings(speed_weight=3.0, steering_weight=0.1, centring_weight=0.1)
    assert total(13.0, 0.5, 0.05, settings=doubled) == pytest.approx(total(13.0, 0.5, 0.05))
    speed_only = RewardSettings(speed_weight=2.0, steering_weight=0.0, centring_weight=0.0)
    assert total(14.0, 1.0, 0.1, settings=speed_only) == pytest.approx(paper_speed_term(14.0))


def test_each_term_has_its_own_weight():
    settings = RewardSettings(speed_weight=1.0, steering_weight=2.0, centring_weight=5.0)
    expected = (0.2 - 2.0 * sin(0.3) + 5.0 * exp(-1.5 * 0.25)) / 8.0
    assert total(12.5, 0.5, 0.3, settings=settings) == pytest.approx(expected)


def test_an_accident_replaces_the_reward():
    assert total(15.0, accident=True) == -10.0
    assert total(0.0, 2.0, 0.1, accident=True, settings=RewardSettings(accident_penalty=3.0)) == -3
