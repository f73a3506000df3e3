"""Q-learning targets, written for one transition and batched by the caller.

Only ``discount`` tells endings apart: 0 where the episode terminated, otherwise what the value of
the next state is worth. Truncation therefore needs no special case (its discount is gamma), and
neither does a decision over k steps (gamma or gamma^k, as the caller decides).
"""

import jax
import jax.numpy as jnp


def q_target(reward: jax.Array, discount: jax.Array, q_next_target: jax.Array) -> jax.Array:
    """The DQN target: the target network both chooses and values the next action.

    y = r + discount * max_a Q_target(s', a)

    Source: Mnih et al. (2015), "Human-level control through deep reinforcement learning".

    Args:
        reward: [] reward of the transition.
        discount: [] weight of the next state's value, 0 at termination.
        q_next_target: [A] target network at the next state.

    Returns:
        [] the target, not differentiable.
    """
    return jax.lax.stop_gradient(reward + discount * jnp.max(q_next_target))


def double_q_target(
    reward: jax.Array, discount: jax.Array, q_next_online: jax.Array, q_next_target: jax.Array
) -> jax.Array:
    """The double DQN target: the online network chooses the next action, the target values it.

    y = r + discount * Q_target(s', argmax_a Q_online(s', a))

    Source: van Hasselt, Guez and Silver (2016), "Deep reinforcement learning with double
    Q-learning", equation (4). Ties go to the lowest action.

    Args:
        reward: [] reward of the transition.
        discount: [] weight of the next state's value, 0 at termination.
        q_next_online: [A] online network at the next state.
        q_next_target: [A] target network at the next state.

    Returns:
        [] the target, not differentiable.
    """
    chosen = jnp.argmax(q_next_online)
    return jax.lax.stop_gradient(reward + discount * q_next_target[chosen])


def td_error(q_values: jax.Array, action: jax.Array, target: jax.Array) -> jax.Array:
    """The temporal-difference error of the action taken, delta = y - Q(s, a).

    Args:
        q_values: [A] online network at the state.
        action: [] integer index of the action taken.
        target: [] target y.

    Returns:
        [] delta; its gradient reaches ``q_values`` only if ``target`` carries none.
    """
    return target - q_values[action]
