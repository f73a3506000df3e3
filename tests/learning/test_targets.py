"""Targets against numbers worked out by hand."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from lanewise.learning import targets

GAMMA = 0.8
ONLINE = jnp.array([1.0, 3.0, 2.0])  # chooses action 1
TARGET = jnp.array([5.0, 4.0, 7.0])  # values action 1 at 4, its own best at 7


def both(reward: float, discount: float) -> tuple[float, float]:
    double = targets.double_q_target(jnp.array(reward), jnp.array(discount), ONLINE, TARGET)
    plain = targets.q_target(jnp.array(reward), jnp.array(discount), TARGET)
    return float(double), float(plain)


def test_an_ordinary_step_bootstraps():
    assert both(0.5, GAMMA) == pytest.approx((0.5 + 0.8 * 4.0, 0.5 + 0.8 * 7.0))


def test_termination_cuts_the_future_off():
    assert both(-1.0, 0.0) == (-1.0, -1.0)


def test_truncation_bootstraps_like_any_other_step():
    # The episode ended by the clock in a state worth 4 (7): the target keeps that worth.
    assert both(-1.0, GAMMA) == pytest.approx((2.2, 4.6))


def test_a_goal_of_three_steps_discounted_per_step_and_per_goal():
    reward = 1.0 + GAMMA * 2.0 + GAMMA**2 * 3.0  # rewards 1, 2, 3 discounted inside the goal: 4.52
    assert both(reward, GAMMA**3) == pytest.approx((4.52 + 0.512 * 4.0, 4.52 + 0.512 * 7.0))
    assert both(1.0 + 2.0 + 3.0, GAMMA) == pytest.approx((6.0 + 3.2, 6.0 + 5.6))


def test_double_equals_plain_where_the_networks_agree():
    q = jnp.array([0.3, -2.0, 0.9])
    double = targets.double_q_target(jnp.array(1.0), jnp.array(GAMMA), q, q)
    assert float(double) == float(targets.q_target(jnp.array(1.0), jnp.array(GAMMA), q))


def test_double_breaks_ties_towards_the_lowest_action():
    tied = jnp.array([1.0, 2.0, 2.0])
    double = targets.double_q_target(jnp.array(0.0), jnp.array(1.0), tied, TARGET)
    assert float(double) == 4.0


def test_td_error_is_target_minus_the_value_of_the_action_taken():
    assert float(targets.td_error(ONLINE, jnp.array(2), jnp.array(1.5))) == -0.5


def test_gradient_flows_through_the_action_taken_only():
    def loss(q, q_next_online, q_next_target):
        target = targets.double_q_target(
            jnp.array(0.5), jnp.array(GAMMA), q_next_online, q_next_target
        )
        return targets.td_error(q, jnp.array(0), target) ** 2

    own, online, target = jax.grad(loss, argnums=(0, 1, 2))(ONLINE, ONLINE, TARGET)
    # d/dq (3.7 - q)^2 at q = 1 is -2 * 2.7.
    np.testing.assert_allclose(own, [-5.4, 0.0, 0.0], rtol=1e-6)
    assert not online.any()
    assert not target.any()
    plain = jax.grad(lambda q: targets.q_target(jnp.array(0.5), jnp.array(GAMMA), q))(TARGET)
    assert not plain.any()
