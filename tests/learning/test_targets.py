"""Targets against numbers worked out by hand."""

import jax
import numpy as np
import pytest

from lanewise.learning import learner

GAMMA = 0.8
ONLINE = np.array([1.0, 3.0, 2.0], np.float32)  # chooses action 1
TARGET = np.array([5.0, 4.0, 7.0], np.float32)  # values action 1 at 4, its own best at 7
double_target, plain_target = jax.jit(learner.double_q_target), jax.jit(learner.q_target)


def both(reward, discount, online=ONLINE, target=TARGET):
    double = double_target(reward, discount, online, target)
    return float(double), float(plain_target(reward, discount, target))


@pytest.mark.parametrize(
    ("reward", "discount", "expected"),
    [
        # A truncated step too: the state in which the clock ran out keeps its worth.
        (0.5, GAMMA, (0.5 + 0.8 * 4.0, 0.5 + 0.8 * 7.0)),
        # Termination cuts the future off.
        (-1.0, 0.0, (-1.0, -1.0)),
        # A goal of three steps with rewards 1, 2, 3, discounted per step and per goal.
        (4.52, GAMMA**3, (4.52 + 0.512 * 4.0, 4.52 + 0.512 * 7.0)),
        (6.0, GAMMA, (6.0 + 3.2, 6.0 + 5.6)),
    ],
)
def test_targets(reward, discount, expected):
    assert both(reward, discount) == pytest.approx(expected)


def test_double_equals_plain_where_the_networks_agree_and_breaks_ties_downwards():
    double, plain = both(1.0, GAMMA, online=TARGET)
    assert double == plain
    tied = np.array([1.0, 2.0, 2.0], np.float32)
    assert both(0.0, 1.0, online=tied)[0] == 4.0


def test_td_error_is_target_minus_the_value_of_the_action_taken():
    assert float(learner.td_error(ONLINE, 2, 1.5)) == -0.5


def test_gradient_flows_through_the_action_taken_only():
    def loss(q, q_next_online, q_next_target):
        target = learner.double_q_target(0.5, GAMMA, q_next_online, q_next_target)
        return learner.td_error(q, 0, target) ** 2

    own, online, target = jax.jit(jax.grad(loss, argnums=(0, 1, 2)))(ONLINE, ONLINE, TARGET)
    # d/dq (3.7 - q)^2 at q = 1 is -2 * 2.7.
    np.testing.assert_allclose(own, [-5.4, 0.0, 0.0], rtol=1e-6)
    plain = jax.jit(jax.grad(lambda q: learner.q_target(0.5, GAMMA, q)))(TARGET)
    assert not np.concatenate([online, target, plain]).any()
