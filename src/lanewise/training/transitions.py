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
    """[n] reward since, as the level's own weights give it."""
    discount: Array
    """[n] gamma^k, k decisions since."""
    count: Array
    """int32 [] how many of the n are choices of this episode."""


def empty(settings: LevelSettings, feature_count: int) -> Pending:
    """No choice pending."""
    n = settings.returns
    return Pending(
        features=jnp.zeros((n, feature_count), jnp.float32),
        choice=jnp.zeros(n, jnp.int32),
        reward=jnp.zeros(n, jnp.float32),
        discount=jnp.ones(n, jnp.float32),
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
    settings: LevelSettings, pending: Pending, outcome: Outcome, feedback: Feedback, before: Array
) -> Pending:
    """Add a decision's reward to every pending choice.

    r = w_e * external + w_g * [goal reached] - w_t * distance from the goal (row 21)
    + w_a * (distance before - distance), where an accident leaves the first term alone. It counts
    gamma^i for the choice i choices back, or gamma^k k decisions after it if gamma counts per
    decision (row 14). The goal is the one the decision was made under.
    """
    alive = ~outcome.terminated
    tracking = jnp.where(alive, settings.tracking_weight * feedback.distance, 0.0)
    goal = jnp.where(alive & feedback.reached, settings.goal_reward, 0.0)
    reward = settings.external_weight * outcome.reward - tracking + goal
    if settings.approach_weight:
        approach = settings.approach_weight * (before - feedback.distance)
        reward += jnp.where(alive, approach, 0.0)
    per_goal = settings.discount_across_goal == "per-goal"
    weight = _per_choice(settings, 0) if per_goal else pending.discount
    return replace(
        pending,
        reward=pending.reward + weight * reward,
        discount=pending.discount * settings.learner.discount,
    )


def _per_choice(settings: LevelSettings, first: int) -> Array:
    """gamma^(i + first) for the choice i choices back, [n]."""
    powers = np.arange(first, first + settings.returns)
    return jnp.asarray(np.power(settings.learner.discount, powers), jnp.float32)


def emit(
    settings: LevelSettings,
    pending: Pending,
    outcome: Outcome,
    feedback: Feedback,
    next_features: Array,
    ready: Array,
) -> tuple[Transition, Array]:
    """([n] transitions, one for each pending choice, bool [n] which of them are complete).

    The discount alone tells the learner how they ended. The oldest of n choices is complete when
    the next one is due; at an episode's end all are.
    """
    per_goal = settings.discount_across_goal == "per-goal"
    discount = _per_choice(settings, 1) if per_goal else pending.discount
    over = outcome.terminated
    if settings.time_out == "terminal":
        over = over | outcome.truncated
    if settings.goal_end == "terminal":
        over = over | feedback.reached
    done = outcome.terminated | outcome.truncated
    index = jnp.arange(settings.returns)
    complete = (index < pending.count) & (done | (ready & (index == settings.returns - 1)))
    found = Transition(
        features=pending.features,
        action=pending.choice,
        reward=pending.reward,
        discount=jnp.where(over, 0.0, discount),
        next_features=jnp.broadcast_to(next_features, pending.features.shape),
    )
    return found, complete
