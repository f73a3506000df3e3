"""Exploration: how often to act at random, and acting so."""

import jax
import jax.numpy as jnp

from lanewise.learning.settings import ExplorationSettings


def epsilon(settings: ExplorationSettings, steps: jax.Array) -> jax.Array:
    """Probability of a random action after a number of environment steps, float32 [...].

    linear: start + (end - start) * min(steps / T, 1);
    exponential: end + (start - end) * exp(-steps / T), with T = ``settings.steps``.

    Args:
        settings: The schedule.
        steps: [...] steps so far, counted as ``settings.counted`` says (the caller counts).
    """
    progress = jnp.asarray(steps, jnp.float32) / settings.steps
    if settings.schedule == "linear":
        remaining = 1.0 - jnp.minimum(progress, 1.0)
    else:
        remaining = jnp.exp(-progress)
    return settings.end + (settings.start - settings.end) * remaining


def epsilon_greedy(key: jax.Array, q_values: jax.Array, epsilon: jax.Array) -> jax.Array:
    """Takes a uniformly random action with probability epsilon, otherwise the greedy one.

    The random action may be the greedy one, so that this is greedy with probability
    1 - epsilon + epsilon / A.

    Args:
        key: Random key.
        q_values: [A] of one state.
        epsilon: [] probability of a random action.

    Returns:
        [] int32 action; among equal Q-values the lowest.
    """
    explore_key, action_key = jax.random.split(key)
    explore = jax.random.uniform(explore_key, (), jnp.float32) < epsilon
    random_action = jax.random.randint(action_key, (), 0, q_values.shape[-1], jnp.int32)
    return jnp.where(explore, random_action, jnp.argmax(q_values).astype(jnp.int32))
