"""Driving while learning: one decision in one world, and the transition it leaves.

A transition spans from one choice of the learning network to the next: one decision for the
single-level and the low-level network, a whole goal for the high level. It is emitted on the
decision after which the network is to choose again, or the episode ends.
"""

from dataclasses import dataclass
from typing import Any

import jax
import jax.numpy as jnp
from jax import Array

from lanewise.controllers.controller import Controller, Parameters
from lanewise.driving import episode, percept
from lanewise.driving.episode import Episode, Outcome
from lanewise.driving.percept import Percept
from lanewise.driving.settings import DrivingSettings
from lanewise.learning import exploration, network
from lanewise.learning.replay import Transition
from lanewise.scenario import trap
from lanewise.scenario.settings import TrapSettings
from lanewise.training.settings import StageSettings


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Pending:
    """A choice whose consequences are still being gathered."""

    features: Array
    """[F] what the network saw."""
    choice: Array
    """int32 [] what it chose."""
    reward: Array
    """[] reward so far, with the goal-tracking term."""
    discount: Array
    """[] gamma^k after k decisions."""


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Tally:
    """Sums over an episode."""

    reward: Array
    """[] external rewards, one a decision."""
    timestep_reward: Array
    """[] the paper's accounting: one reward a second, an accident's penalty once."""
    speed: Array
    """[] sum of the ego's speed, m/s."""


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Rollout:
    """One world under way."""

    episode: Episode
    percept: Percept
    memory: Any
    """The controller's memory, which has perceived ``percept``."""
    pending: Pending
    tally: Tally


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Finished:
    """Facts about an episode, meaningful where ``done``."""

    done: Array
    """bool []."""
    success: Array
    """bool []."""
    accident: Array
    """int32 []."""
    decisions: Array
    """int32 []."""
    reward: Array
    """[] one reward a decision."""
    timestep_reward: Array
    """[] one reward a second."""
    average_speed: Array
    """[] m/s."""


@dataclass(frozen=True)
class Course:
    """What stays the same through a stage: the scenario, the rules, and who drives. Static."""

    scenario: TrapSettings
    driving: DrivingSettings
    controller: Controller
    stage: StageSettings


def begin(course: Course, parameters: Parameters, key: Array) -> Rollout:
    """A fresh training episode."""
    state = episode.begin(trap.sample(course.scenario, key, "training"))
    seen = percept.of(course.driving.observation, state.world)
    controller = course.controller
    memory = controller.start(parameters, seen)
    memory = controller.perceive(parameters, memory, seen)
    zero = jnp.float32(0.0)
    return Rollout(
        episode=state,
        percept=seen,
        memory=memory,
        pending=Pending(controller.features(memory, seen), jnp.int32(0), zero, jnp.float32(1.0)),
        tally=Tally(zero, zero, zero),
    )


def step(
    course: Course, parameters: Parameters, rollout: Rollout, epsilon: Array, key: Array
) -> tuple[Rollout, Transition, Array, Finished]:
    """One decision with exploration; an episode that ends is replaced by a fresh one.

    Args:
        course: static settings.
        parameters: of all levels; the learning network's are the online ones.
        rollout: the world under way.
        epsilon: [] probability of a random choice.
        key: random key of this decision in this world.

    Returns:
        The world after the decision, a transition, bool [] whether it is complete, and facts
        about the episode, meaningful if it ended.
    """
    explore_key, start_key = jax.random.split(key)
    controller = course.controller

    pending, memory, action = _choose(course, parameters, rollout, epsilon, explore_key)
    state, outcome = episode.step(course.driving, rollout.episode, action, course.stage.duration)
    seen = percept.of(course.driving.observation, state.world)
    pending = _gather(course, pending, outcome, controller.penalty(memory, seen))
    memory = controller.perceive(parameters, memory, seen)

    done = outcome.terminated | outcome.truncated
    transition = _transition(course, pending, outcome, controller.features(memory, seen))
    emitted = controller.ready(memory) | done
    tally = _count(course.driving, rollout.tally, state, outcome)
    finished = _finish(state, outcome, tally, done)

    after = Rollout(state, seen, memory, pending, tally)
    fresh = begin(course, parameters, start_key)
    after = jax.tree.map(lambda new, old: jnp.where(done, new, old), fresh, after)
    return after, transition, emitted, finished


def _choose(
    course: Course, parameters: Parameters, rollout: Rollout, epsilon: Array, key: Array
) -> tuple[Pending, Any, Array]:
    """Let the network choose where it is ready: (pending choice, memory, low-level action)."""
    controller = course.controller
    features = controller.features(rollout.memory, rollout.percept)
    values = network.q_values(parameters[controller.learns], features)
    choice = exploration.epsilon_greedy(key, values, epsilon)
    ready = controller.ready(rollout.memory)
    new = Pending(features, choice, jnp.float32(0.0), jnp.float32(1.0))
    pending = jax.tree.map(lambda n, o: jnp.where(ready, n, o), new, rollout.pending)
    action, memory = controller.decide(rollout.memory, rollout.percept, choice)
    return pending, memory, action


def _gather(course: Course, pending: Pending, outcome: Outcome, penalty: Array) -> Pending:
    """Add a decision's reward to the pending choice.

    The reward is the external one, less the tracking term (row 21), which an accident replaces.
    Inside a goal rewards are summed, or discounted if gamma counts per decision (row 14).
    """
    tracking = jnp.where(outcome.terminated, 0.0, course.stage.tracking_weight * penalty)
    reward = outcome.reward - tracking
    if course.stage.discount_across_goal == "per-decision":
        reward = pending.discount * reward
    return Pending(
        features=pending.features,
        choice=pending.choice,
        reward=pending.reward + reward,
        discount=pending.discount * course.stage.learner.discount,
    )


def _transition(
    course: Course, pending: Pending, outcome: Outcome, next_features: Array
) -> Transition:
    """The transition, complete or not: the discount alone tells the learner how it ended."""
    discount = jnp.float32(course.stage.learner.discount)
    if course.stage.discount_across_goal == "per-decision":
        discount = pending.discount
    over = outcome.terminated
    if course.stage.time_out == "terminal":
        over = over | outcome.truncated
    return Transition(
        features=pending.features,
        action=pending.choice,
        reward=pending.reward,
        discount=jnp.where(over, 0.0, discount),
        next_features=next_features,
    )


def _count(driving: DrivingSettings, tally: Tally, state: Episode, outcome: Outcome) -> Tally:
    """Sums after one more decision."""
    counts = episode.ends_timestep(driving, state, outcome)
    return Tally(
        reward=tally.reward + outcome.reward,
        timestep_reward=tally.timestep_reward + jnp.where(counts, outcome.reward, 0.0),
        speed=tally.speed + state.world.vehicles.speed[0],
    )


def _finish(state: Episode, outcome: Outcome, tally: Tally, done: Array) -> Finished:
    """The facts of the episode as it stands."""
    return Finished(
        done=done,
        success=state.escaped & ~outcome.terminated,
        accident=outcome.accident,
        decisions=state.decisions,
        reward=tally.reward,
        timestep_reward=tally.timestep_reward,
        average_speed=tally.speed / state.decisions,
    )
