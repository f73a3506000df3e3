"""Transitions of one level in one world: from a choice to the next one, or to the n-th next.

A choice lasts one decision for the single-level and the low-level network, a whole goal for the
high level. Its transition is complete on the decision after which the level is to choose again, or
with the episode.
"""

from dataclasses import dataclass, replace

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from lanewise.controllers.controller import Feedback
from lanewise.driving.episode import Outcome
from lanewise.learning.replay import Transition
from lanewise.training.settings import LevelSettings


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Pending:
    """The last n choices of a level, whose consequences are still being gathered, newest first."""

    features: Array
    """[n, F] what the network saw."""
    choice: Array
    """int32 [n] what it chose."""
    reward: Array
    """[n] reward since, as the level is paid."""
    discount: Array
    """[n] gamma^k, k decisions since."""
    count: Array
    """int32 [] how many of the n are choices of this episode."""


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Emitted:
    """Transitions of one level after a decision."""

    transitions: Transition
    """[n] one for each pending choice."""
    complete: Array
    """bool [n] which of them go to the replay."""


def empty(level_settings: LevelSettings, feature_count: int) -> Pending:
    """No choice pending."""
    return Pending(
        features=jnp.zeros((level_settings.returns, feature_count), jnp.float32),
        choice=jnp.zeros(level_settings.returns, jnp.int32),
        reward=jnp.zeros(level_settings.returns, jnp.float32),
        discount=jnp.ones(level_settings.returns, jnp.float32),
        count=jnp.int32(0),
    )


def push(pending: Pending, features: Array, choice: Array) -> Pending:
    """One more choice; the oldest of the n falls out."""

    def pushed(new: Array, old: Array) -> Array:
        return jnp.concatenate([new[None].astype(old.dtype), old[:-1]])

    return Pending(
        features=pushed(features, pending.features),
        choice=pushed(choice, pending.choice),
        reward=pushed(jnp.float32(0.0), pending.reward),
        discount=pushed(jnp.float32(1.0), pending.discount),
        count=jnp.minimum(pending.count + 1, pending.choice.shape[0]),
    )


def accumulate(
    level_settings: LevelSettings,
    pending: Pending,
    outcome: Outcome,
    feedback: Feedback,
    before: Array,
) -> Pending:
    """Add a decision's reward to every pending choice.

    r = w_e * external + w_g * [goal reached] - w_t * distance from the goal (row 21)
    + w_a * (distance before - distance), where an accident leaves the first term alone. It counts
    gamma^i for the choice i choices back, or gamma^k k decisions after it if gamma counts per
    decision (row 14).

    Args:
        level_settings: the weights.
        pending: the choices.
        outcome: of the decision.
        feedback: after it, of the goal it was made under.
        before: [] distance from that goal before the decision.
    """
    alive = ~outcome.terminated
    tracking = jnp.where(alive, level_settings.tracking_weight * feedback.distance, 0.0)
    goal = jnp.where(alive & feedback.reached, level_settings.goal_reward, 0.0)
    reward = level_settings.external_weight * outcome.reward - tracking + goal
    if level_settings.approach_weight:
        reward += jnp.where(
            alive, level_settings.approach_weight * (before - feedback.distance), 0.0
        )
    weight = pending.discount
    if level_settings.discount_across_goal == "per-goal":
        weight = _per_choice(level_settings, 0)
    return replace(
        pending,
        reward=pending.reward + weight * reward,
        discount=pending.discount * level_settings.learner.discount,
    )


def _per_choice(level_settings: LevelSettings, first: int) -> Array:
    """gamma^(i + first) for the choice i choices back, [n]."""
    powers = np.arange(first, first + level_settings.returns)
    return jnp.asarray(np.power(level_settings.learner.discount, powers), jnp.float32)


def emit(
    level_settings: LevelSettings,
    pending: Pending,
    outcome: Outcome,
    feedback: Feedback,
    next_features: Array,
    ready: Array,
) -> Emitted:
    """Transitions, complete or not: the discount alone tells the learner how they ended.

    The oldest of n choices is complete when the next one is due; at an episode's end all are.
    """
    n = level_settings.returns
    discount = pending.discount
    if level_settings.discount_across_goal == "per-goal":
        discount = _per_choice(level_settings, 1)
    over = outcome.terminated
    if level_settings.time_out == "terminal":
        over = over | outcome.truncated
    if level_settings.goal_end == "terminal":
        over = over | feedback.reached
    done = outcome.terminated | outcome.truncated
    index = jnp.arange(n)
    return Emitted(
        transitions=Transition(
            features=pending.features,
            action=pending.choice,
            reward=pending.reward,
            discount=jnp.where(over, 0.0, discount),
            next_features=jnp.broadcast_to(next_features, pending.features.shape),
        ),
        complete=(index < pending.count) & (done | (ready & (index == n - 1))),
    )
