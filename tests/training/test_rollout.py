"""The transitions of a training drive, booked a second time in plain Python."""

from dataclasses import dataclass, replace
from functools import cache
from itertools import pairwise
from types import SimpleNamespace

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from lanewise.controllers.controller import Feedback
from lanewise.controllers.hierarchical import Hierarchical
from lanewise.controllers.settings import GoalSettings
from lanewise.controllers.single_level import SingleLevel
from lanewise.driving import episode, percept
from lanewise.driving.settings import DrivingSettings
from lanewise.driving.task_functions import PAPER_TASK
from lanewise.learning import network
from lanewise.learning.settings import LearnerSettings
from lanewise.scenario.settings import TrafficSettings, TrapSettings
from lanewise.training import rollout
from lanewise.training.rollout import StageConfig
from lanewise.training.settings import BudgetSettings, LevelSettings

DRIVING = DrivingSettings()
EMPTY = TrapSettings(traffic=TrafficSettings(vehicles_ahead=0))
FASTER = 7
GAMMA = 0.8
REACHED = 12.0
TASK = replace(PAPER_TASK, start=jax.jit(PAPER_TASK.start, static_argnums=(0, 2)))
WORLD = SimpleNamespace(
    begin=jax.jit(episode.begin), step=jax.jit(episode.step, static_argnums=(0, 4))
)
"""The same for all drives; what is different in each would take long to compile and is not."""


@pytest.fixture(autouse=True, scope="module")
def compiled_world():
    perceive = jax.jit(percept.perceive, static_argnums=(0, 2))
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(rollout, "episode", WORLD)
        patch.setattr(rollout, "percept", SimpleNamespace(perceive=perceive))
        yield


@dataclass(frozen=True)
class Third:
    """A level that chooses at every third decision."""

    name: str = "q"
    feature_count: int = 4
    choice_count: int = 5

    def ready(self, memory):
        return memory % 3 == 0

    def features(self, memory, percept):
        return jnp.stack([percept.x, percept.y, percept.speed, jnp.float32(memory)])

    def choose(self, memory, percept, choice):
        return memory


@dataclass(frozen=True)
class Every:
    """A controller whose level chooses at every third decision and which always drives one way.

    Its goal is to be as fast as `REACHED`; how far it is from it is its speed / 10.
    """

    action: int
    name: str = "every"
    levels: tuple = (Third(),)

    def start(self, percept):
        return jnp.int32(0)

    def perceive(self, memory, percept):
        return memory

    def act(self, memory, percept):
        return jnp.int32(self.action), memory + 1

    def feedback(self, memory, percept):
        return Feedback(distance=percept.speed / 10.0, reached=percept.speed >= REACHED)

    def goal(self, memory):
        return None


def config_of(controller, *learning, duration=250):
    return StageConfig(
        EMPTY, DRIVING, controller, BudgetSettings(duration=duration), learning, task=TASK
    )


def course_of(duration=250, **level):
    level_settings = LevelSettings(learner=LearnerSettings(discount=GAMMA), **level)
    return config_of(Every(FASTER), ("q", level_settings), duration=duration)


NETWORKS = {
    name: network.init(jax.random.key(number), inputs, (8,), choices)
    for number, (name, inputs, choices) in enumerate(
        [("q", 4, 5), ("single_level", 26, 9), ("high_level", 26, 9), ("low_level", 28, 9)], 1
    )
}


@cache
def drive(config, decisions=16, epsilon=0.0):
    """(the first world, (per decision: the world, what each level emits, the stats))."""
    first = state = rollout.begin(config, NETWORKS, jax.random.key(5))
    everywhere = {name: jnp.float32(epsilon) for name, _ in config.learning}
    rows = []
    for key in jax.random.split(jax.random.key(6), decisions):
        key, start_key = jax.random.split(key)
        state, emitted = rollout.step(config, NETWORKS, state, everywhere, key)
        stats = state.episode.stats
        if stats.outcome.over:
            state = rollout.begin(config, NETWORKS, start_key)
        rows.append((state, emitted, stats))
    return first, jax.tree.map(lambda *leaves: np.stack(leaves), *jax.device_get(rows))


def features_at(state, count):
    ego = state.world.vehicles
    return [float(ego.x[0]), float(ego.y[0]), float(ego.speed[0]), float(count)]


def pay(level_settings, outcome, before, speed):
    """What a level is paid for a decision between two speeds, worked out by hand."""
    reward = level_settings.external_weight * float(outcome.reward)
    if not outcome.terminated:
        reward -= level_settings.tracking_weight * speed / 10.0
        reward += level_settings.approach_weight * (before - speed) / 10.0
        reward += level_settings.goal_reward if speed >= REACHED else 0.0
    return reward


def plain_episode(config, first):
    """(features before and after every decision, rewards, outcomes) of the first episode."""
    _, level_settings = config.learning[0]
    state, seen, rewards, outcomes = first.episode, [], [], []
    while not outcomes or not outcomes[-1].over:
        seen.append(features_at(state, len(rewards)))
        action = jnp.int32(config.controller.action)
        before = float(state.world.vehicles.speed[0])
        state = WORLD.step(DRIVING, state, action, config.budget.duration, TASK)
        rewards.append(
            pay(level_settings, state.outcome, before, float(state.world.vehicles.speed[0]))
        )
        outcomes.append(state.outcome)
    return [*seen, features_at(state, len(rewards))], rewards, outcomes


def booked(config, first):
    """The transitions of the first episode, each a dict, and how many decisions it took."""
    _, level_settings = config.learning[0]
    seen, rewards, outcomes = plain_episode(config, first)
    length, found = len(rewards), []
    for start in range(0, length, 3):
        end = min(start + 3 * level_settings.returns, length)
        k = end - start
        choices = -(-k // 3)
        per_goal = level_settings.discount_across_goal == "per-goal"
        weights = [GAMMA ** (i // 3 if per_goal else i) for i in range(k)]
        last = outcomes[end - 1]
        lost = bool(last.terminated) or (
            level_settings.time_out == "terminal" and bool(last.truncated)
        )
        lost |= level_settings.goal_end == "terminal" and seen[end][2] >= REACHED
        found.append(
            {
                "at": end - 1,
                "features": seen[start],
                "reward": float(np.dot(weights, rewards[start:end])),
                "discount": 0.0 if lost else GAMMA ** (choices if per_goal else k),
                "next_features": seen[end],
            }
        )
    return found, length, bool(outcomes[-1].terminated)


def written(emitted):
    """The complete transitions of a level in the order of their choices: (decision, transition)."""
    rows = [(int(at), int(choices_back)) for at, choices_back in np.argwhere(emitted.complete)]
    # Of those that are complete at once, the oldest chose first.
    rows.sort(key=lambda row: (row[0], -row[1]))
    return [
        (at, jax.tree.map(lambda leaf, at=at, back=back: np.asarray(leaf)[at, back], part))
        for (at, back), part in ((row, emitted.transitions) for row in rows)
    ]


VARIANTS = [
    {"duration": 40, "discount_across_goal": "per-decision", "tracking_weight": 0.5},
    {"duration": 7, "tracking_weight": 0.5},
    {"duration": 7, "time_out": "terminal"},
    {"duration": 40, "approach_weight": 3.0, "tracking_weight": 0.5},
    {"duration": 40, "returns": 3},
    {"duration": 8, "returns": 2, "discount_across_goal": "per-decision"},
    {"duration": 8, "returns": 5, "time_out": "terminal"},
    {"duration": 8, "external_weight": 0.0, "goal_reward": 2.0, "goal_end": "terminal"},
]


@pytest.mark.parametrize("variant", VARIANTS, ids=range(len(VARIANTS)))
def test_transitions_are_those_of_the_plain_books(variant):
    config = course_of(**variant)
    first, (worlds, emitted, stats) = drive(config)
    expected, length, terminated = booked(config, first)
    assert terminated == (variant["duration"] == 40)
    assert length < 16
    done = np.flatnonzero(stats.outcome.over)
    assert done[0] == length - 1
    found = [row for row in written(emitted["q"]) if row[0] < length]
    assert [at for at, _ in found] == [wanted.pop("at") for wanted in expected]
    for (at, transition), wanted in zip(found, expected, strict=True):
        for name, value in wanted.items():
            got = getattr(transition, name)
            np.testing.assert_allclose(got, value, rtol=1e-4, atol=1e-4, err_msg=f"{name} at {at}")
        values = network.q_values(NETWORKS["q"], transition.features)
        assert int(transition.action) == int(np.argmax(values))
    # The episode that follows is a fresh one, and the last transition saw nothing of it.
    fresh = jax.tree.map(lambda leaf: leaf[length - 1], worlds)
    assert int(fresh.episode.stats.decisions) == 0
    assert float(fresh.percept.x) == 0.0
    assert float(found[-1][1].next_features[0]) > 10.0
    assert float(fresh.episode.stats.reward) == 0.0
    assert int(fresh.pending["q"].count) == 0


def test_some_goals_are_reached_and_some_are_not():
    """So that the variant paid for goals tells something."""
    config = course_of(**VARIANTS[-1])
    first, _ = drive(config)
    rewards = plain_episode(config, first)[1]
    assert {0.0, 2.0} <= set(rewards)


def test_stats_episodes_carry_the_sums_of_the_plain_drive():
    config = course_of(**VARIANTS[1])
    first, (_, _, stats) = drive(config)
    state, rewards, speeds = first.episode, [], []
    for _ in range(7):
        state = WORLD.step(DRIVING, state, jnp.int32(FASTER), 7, TASK)
        outcome = state.outcome
        rewards.append(float(outcome.reward))
        speeds.append(float(state.world.vehicles.speed[0]))
        if outcome.terminated:
            break
    at = len(rewards) - 1
    assert stats.outcome.over[at]
    assert int(stats.decisions[at]) == len(rewards)
    assert int(stats.outcome.accident[at]) == int(outcome.accident)
    assert float(stats.reward[at]) == pytest.approx(sum(rewards), rel=1e-4)
    # One reward a second: after every second decision, and an accident whenever it happens.
    ends = rewards[1::2] + (rewards[-1:] if len(rewards) % 2 and outcome.terminated else [])
    assert float(stats.timestep_reward[at]) == pytest.approx(sum(ends), rel=1e-4)
    assert float(stats.speed_sum[at]) == pytest.approx(sum(speeds), rel=1e-5)


def two_level_drive(*learning):
    """Sixty decisions of the hierarchical controller while the given levels learn."""
    config = config_of(Hierarchical(DRIVING, GoalSettings(time_limit=2.0), "critic"), *learning)
    first, rest = drive(config, 60, 0.3)
    return config, first, *rest


def before(worlds, first, name):
    """A goal's field before each decision."""
    read = lambda memory: np.asarray(getattr(memory.goal.goal, name))  # noqa: E731
    return np.append(read(first.memory), read(worlds.memory)[:-1])


def goal_features(worlds, lane, speed):
    """The two goal features after each decision, worked out by hand."""
    ego = worlds.episode.world.vehicles
    lateral = 4.0 * lane - np.asarray(ego.y)[:, 0]
    along = np.asarray(ego.speed)[:, 0] * np.cos(np.asarray(ego.heading)[:, 0])
    return np.clip(np.stack([lateral / 4.0, (speed - along) / 2.0], axis=-1), -2.0, 2.0)


def test_a_new_goal_is_in_the_next_features_of_the_decision_before_it():
    _, first, worlds, emitted, stats = two_level_drive(("low_level", LevelSettings()))
    low = emitted["low_level"]
    assert low.complete.all()
    lane, speed = (np.asarray(getattr(worlds.memory.goal.goal, name)) for name in ("lane", "speed"))
    going_on = ~np.asarray(stats.outcome.over)
    lane_before, speed_before = (before(worlds, first, name) for name in ("lane", "speed"))
    switched = ((speed != speed_before) | (lane != lane_before)) & going_on
    assert switched.sum() >= 2
    np.testing.assert_allclose(
        np.asarray(low.transitions.next_features)[going_on, 0, 26:],
        goal_features(worlds, lane, speed)[going_on],
        atol=1e-5,
    )


def test_when_both_levels_learn_the_low_level_is_judged_by_the_goal_it_acted_for():
    """h-DQN: the goal of a transition is the same before and after the decision."""
    level_settings = (("high_level", LevelSettings()), ("low_level", LevelSettings()))
    _, _, worlds, emitted, stats = two_level_drive(*level_settings)
    low, high = emitted["low_level"], emitted["high_level"]
    assert low.complete.all()
    going_on = ~np.asarray(stats.outcome.over)
    # The world after a decision still remembers the goal of it: the next is set at the next one.
    lane, speed = (np.asarray(getattr(worlds.memory.goal.goal, name)) for name in ("lane", "speed"))
    np.testing.assert_allclose(
        np.asarray(low.transitions.next_features)[going_on, 0, 26:],
        goal_features(worlds, lane, speed)[going_on],
        atol=1e-5,
    )
    due = np.asarray(worlds.memory.goal.due) & going_on
    np.testing.assert_array_equal(
        np.asarray(high.complete)[:, 0], due | np.asarray(stats.outcome.over)
    )
    assert 5 <= due.sum() < 50
    # What the high level saw when a goal was due is where its last transition led to.
    at = np.flatnonzero(high.complete[:, 0])
    within = [(a, b) for a, b in pairwise(at) if not stats.outcome.over[a]]
    for a, b in within:
        np.testing.assert_array_equal(
            np.asarray(high.transitions.features)[b, 0],
            np.asarray(high.transitions.next_features)[a, 0],
        )


def test_the_two_levels_explore_by_themselves():
    """At epsilon 1 the choices of neither level can be told from those of the other."""
    learning = (("high_level", LevelSettings()), ("low_level", LevelSettings()))
    config = config_of(Hierarchical(DRIVING, GoalSettings(), "critic"), *learning)
    first = rollout.begin(config, NETWORKS, jax.random.key(5))
    always = {name: jnp.float32(1.0) for name, _ in learning}
    choose = jax.vmap(lambda key: rollout._choose(config, NETWORKS, first, always, key)[0])
    pending = jax.jit(choose)(jax.random.split(jax.random.key(6), 400))
    high, low = (np.asarray(pending[name].choice)[:, 0] for name, _ in learning)
    counts = np.histogram2d(high, low, bins=9)[0]
    # Chi-square of independence with 64 degrees of freedom: mean 64, standard deviation 11.3.
    expected = np.outer(counts.sum(1), counts.sum(0)) / counts.sum()
    assert ((counts - expected) ** 2 / expected).sum() < 64 + 5 * 11.3


def test_a_held_choice_is_one_transition():
    level_settings = LevelSettings(discount_across_goal="per-decision")
    config = config_of(SingleLevel(hold=4), ("single_level", level_settings))
    _, (worlds, emitted, stats) = drive(config, 40, 0.5)
    flat = emitted["single_level"]
    decisions = np.asarray(worlds.episode.stats.decisions)
    complete = np.asarray(flat.complete)[:, 0]
    np.testing.assert_array_equal(complete, (decisions % 4 == 0) | np.asarray(stats.outcome.over))
    whole = complete & ~np.asarray(stats.outcome.over)
    np.testing.assert_allclose(np.asarray(flat.transitions.discount)[whole, 0], 0.8**4, rtol=1e-6)
    actions = np.asarray(worlds.memory.action)
    held = [
        len(set(actions[i : i + 4]))
        for i in range(0, 36, 4)
        if not stats.outcome.over[i : i + 4].any()
    ]
    assert set(held) == {1}
    assert len(set(actions)) > 2


def test_the_next_decision_starts_from_the_features_the_last_one_led_to():
    _, (_, emitted, stats) = drive(course_of(**VARIANTS[1]))
    at = np.flatnonzero(emitted["q"].complete[:, 0])
    at = at[at <= np.argmax(stats.outcome.over)]
    assert len(at) == 3
    part = emitted["q"].transitions
    np.testing.assert_array_equal(
        np.asarray(part.features)[at[1:]], np.asarray(part.next_features)[at[:-1]]
    )
