"""The transitions of a training drive, booked a second time in plain Python."""

from dataclasses import dataclass
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from lanewise.controllers.hierarchical import Hierarchical
from lanewise.controllers.settings import GoalSettings
from lanewise.driving import episode
from lanewise.driving.settings import DrivingSettings
from lanewise.learning import network
from lanewise.learning.settings import LearnerSettings
from lanewise.scenario.settings import TrafficSettings, TrapSettings
from lanewise.training import rollout
from lanewise.training.rollout import Course
from lanewise.training.settings import StageSettings

DRIVING = DrivingSettings()
EMPTY = TrapSettings(traffic=TrafficSettings(vehicles_ahead=0))
FASTER = 7
GAMMA = 0.8


@dataclass(frozen=True)
class Every:
    """A controller whose network chooses at every third decision and always drives one way."""

    action: int
    name: str = "every"
    learns: str = "q"
    feature_count: int = 4
    choice_count: int = 5

    def start(self, parameters, percept):
        return jnp.int32(0)

    def perceive(self, parameters, memory, percept):
        return memory

    def ready(self, memory):
        return memory % 3 == 0

    def features(self, memory, percept):
        return jnp.stack([percept.x, percept.y, percept.speed, jnp.float32(memory)])

    def decide(self, memory, percept, choice):
        return jnp.int32(self.action), memory + 1

    def penalty(self, memory, percept):
        return percept.speed / 10.0


def course_of(action=FASTER, **stage):
    settings = StageSettings(learner=LearnerSettings(discount=GAMMA), **stage)
    return Course(EMPTY, DRIVING, Every(action), settings)


def parameters_of(course, hidden=(8,)):
    controller = course.controller
    return network.init(
        jax.random.key(1), controller.feature_count, hidden, controller.choice_count
    )


@partial(jax.jit, static_argnums=(0, 2, 3))
def drive(course, parameters, decisions, epsilon):
    """(the first world, then per decision: the world, transition, emitted, finished)."""
    first = rollout.begin(course, parameters, jax.random.key(5))

    def step(state, key):
        after, *rest = rollout.step(course, parameters, state, jnp.float32(epsilon), key)
        return after, (after, *rest)

    keys = jax.random.split(jax.random.key(6), decisions)
    return first, jax.lax.scan(step, first, keys)[1]


EPISODE_STEP = jax.jit(partial(episode.step, DRIVING), static_argnums=2)


def features_at(state, count):
    ego = state.world.vehicles
    return [float(ego.x[0]), float(ego.y[0]), float(ego.speed[0]), float(count)]


def booked(course, first):
    """The transitions of the first episode, each a dict, and how many decisions it took."""
    settings, state = course.stage, first.episode
    found, decision, over = [], 0, False
    while not over:
        if decision % 3 == 0:
            start, rewards = features_at(state, decision), []
        state, outcome = EPISODE_STEP(state, jnp.int32(course.controller.action), settings.duration)
        decision += 1
        reward = float(outcome.reward)
        if not outcome.terminated:
            reward -= settings.tracking_weight * float(state.world.vehicles.speed[0]) / 10.0
        rewards.append(reward)
        over = bool(outcome.terminated) or bool(outcome.truncated)
        if decision % 3 == 0 or over:
            k = len(rewards)
            per_goal = settings.discount_across_goal == "per-goal"
            discount = GAMMA if per_goal else GAMMA**k
            lost = bool(outcome.terminated)
            lost |= settings.time_out == "terminal" and bool(outcome.truncated)
            found.append(
                {
                    "at": decision - 1,
                    "features": start,
                    "reward": sum(r * (1 if per_goal else GAMMA**i) for i, r in enumerate(rewards)),
                    "discount": 0.0 if lost else discount,
                    "next_features": features_at(state, decision),
                }
            )
    return found, decision, bool(outcome.terminated)


VARIANTS = [
    {"duration": 40, "discount_across_goal": "per-decision", "tracking_weight": 0.5},
    {"duration": 7, "tracking_weight": 0.5},
    {"duration": 7, "time_out": "terminal"},
]


@pytest.mark.parametrize("variant", VARIANTS, ids=range(len(VARIANTS)))
def test_transitions_are_those_of_the_plain_books(variant):
    course = course_of(**variant)
    parameters = {"q": parameters_of(course)}
    first, (worlds, transitions, emitted, finished) = drive(course, parameters, 16, 0.0)
    expected, length, terminated = booked(course, first)
    assert terminated == (variant["duration"] == 40)
    assert length < 16
    done = np.flatnonzero(finished.done)
    assert done[0] == length - 1
    assert np.flatnonzero(emitted)[: len(expected)].tolist() == [e["at"] for e in expected]
    for wanted in expected:
        at = wanted.pop("at")
        for name, value in wanted.items():
            got = np.asarray(getattr(transitions, name))[at]
            np.testing.assert_allclose(got, value, rtol=1e-4, atol=1e-4, err_msg=f"{name} at {at}")
        values = network.q_values(parameters["q"], transitions.features[at])
        assert int(transitions.action[at]) == int(np.argmax(values))
    # The episode that follows is a fresh one, and the last transition saw nothing of it.
    fresh = jax.tree.map(lambda leaf: leaf[length - 1], worlds)
    assert int(fresh.episode.decisions) == 0
    assert float(fresh.percept.x) == 0.0
    assert float(transitions.next_features[length - 1][0]) > 10.0
    assert float(fresh.tally.reward) == 0.0


def test_finished_episodes_carry_the_sums_of_the_plain_drive():
    course = course_of(**VARIANTS[1])
    first, (_, _, _, finished) = drive(course, {"q": parameters_of(course)}, 16, 0.0)
    state, rewards, speeds = first.episode, [], []
    for _ in range(7):
        state, outcome = EPISODE_STEP(state, jnp.int32(FASTER), 7)
        rewards.append(float(outcome.reward))
        speeds.append(float(state.world.vehicles.speed[0]))
        if outcome.terminated:
            break
    at = len(rewards) - 1
    assert finished.done[at]
    assert int(finished.decisions[at]) == len(rewards)
    assert int(finished.accident[at]) == int(outcome.accident)
    assert float(finished.reward[at]) == pytest.approx(sum(rewards), rel=1e-4)
    # One reward a second: after every second decision, and an accident whenever it happens.
    ends = rewards[1::2] + (rewards[-1:] if len(rewards) % 2 and outcome.terminated else [])
    assert float(finished.timestep_reward[at]) == pytest.approx(sum(ends), rel=1e-4)
    assert float(finished.average_speed[at]) == pytest.approx(np.mean(speeds), rel=1e-5)


def test_a_new_goal_is_in_the_next_features_of_the_decision_before_it():
    goals = GoalSettings(time_limit=2.0)
    settings = StageSettings(duration=250, learner=LearnerSettings())
    course = Course(EMPTY, DRIVING, Hierarchical(DRIVING, goals, "critic"), settings)
    parameters = {
        "high_level": network.init(jax.random.key(3), 26, (8,), 9),
        "low_level": network.init(jax.random.key(4), 28, (8,), 9),
    }
    first, (worlds, transitions, emitted, finished) = drive(course, parameters, 60, 0.3)
    assert emitted.all()
    before = np.append(float(first.memory.goal.speed), worlds.memory.goal.speed[:-1])
    lane_before = np.append(int(first.memory.goal.lane), worlds.memory.goal.lane[:-1])
    lane, speed = np.asarray(worlds.memory.goal.lane), np.asarray(worlds.memory.goal.speed)
    going_on = ~np.asarray(finished.done)
    switched = ((speed != before) | (lane != lane_before)) & going_on
    assert switched.sum() >= 2
    ego = worlds.episode.world.vehicles
    lateral = 4.0 * lane - np.asarray(ego.y)[:, 0]
    along = np.asarray(ego.speed)[:, 0] * np.cos(np.asarray(ego.heading)[:, 0])
    seen = np.clip(np.stack([lateral / 4.0, (speed - along) / 2.0], axis=-1), -2.0, 2.0)
    np.testing.assert_allclose(
        np.asarray(transitions.next_features)[going_on, 26:], seen[going_on], atol=1e-5
    )


def test_the_next_decision_starts_from_the_features_the_last_one_led_to():
    course = course_of(**VARIANTS[1])
    _, (_, transitions, emitted, finished) = drive(course, {"q": parameters_of(course)}, 16, 0.0)
    at = np.flatnonzero(emitted)
    at = at[at <= np.argmax(finished.done)]
    assert len(at) == 3
    np.testing.assert_array_equal(
        np.asarray(transitions.features)[at[1:]], np.asarray(transitions.next_features)[at[:-1]]
    )
