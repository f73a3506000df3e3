"""Every transition that the worlds of a stage leave, against plain books; all controllers."""

from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import replay_books
from test_stage import COURSE, SETTINGS

from lanewise.controllers.hierarchical import Hierarchical, Planned
from lanewise.controllers.settings import GoalSettings, PlannerSettings
from lanewise.controllers.single_level import SingleLevel
from lanewise.driving.settings import DrivingSettings
from lanewise.learning import network
from lanewise.learning.settings import ExplorationSettings
from lanewise.training import rollout
from lanewise.training.settings import LevelSettings

ITERATIONS = 40
DRIVING = DrivingSettings()
BUDGET = replace(SETTINGS, worlds=3, duration=9)
LEARNS = replace(
    SETTINGS,
    exploration=ExplorationSettings(start=0.3, end=0.3),
    learner=replace(SETTINGS.learner, replay_capacity=2000),
)
GOALS = GoalSettings(time_limit=2.0, lateral_tolerance=1.5, speed_tolerance=1.5)
NETWORKS = {
    "high_level": network.init(jax.random.key(3), 26, (8,), 9),
    "low_level": network.init(jax.random.key(4), 28, (8,), 9),
}


def course_of(controller, **learning):
    return replace(COURSE, controller=controller, budget=BUDGET, learning=tuple(learning.items()))


COURSES = {
    "single-level, held, 2-step, per decision, time-outs terminal": course_of(
        SingleLevel(hold=2),
        single_level=replace(
            LEARNS, returns=2, discount_across_goal="per-decision", time_out="terminal"
        ),
    ),
    "step 1, per goal": course_of(
        Planned(DRIVING, GOALS, PlannerSettings(preview=2), "critic"), high_level=LEARNS
    ),
    "step 2, rewarded for tracking and approach": course_of(
        Hierarchical(DRIVING, GOALS, "critic"),
        low_level=replace(LEARNS, tracking_weight=0.5, approach_weight=1.5),
    ),
    "h-DQN, per decision above, goals are ends below": course_of(
        Hierarchical(DRIVING, GOALS, "critic", "h-dqn"),
        high_level=replace(LEARNS, discount_across_goal="per-decision", returns=2),
        low_level=replace(LEARNS, external_weight=0.0, goal_reward=1.0, goal_end="terminal"),
    ),
}


@pytest.fixture(autouse=True, scope="module")
def uncompiled():
    with replay_books.uncompiled():
        yield


SLOW = ("step 1, per goal",)
"""The planner takes long, and h-DQN's high level is rewarded as well."""


@pytest.mark.parametrize(
    "name",
    [pytest.param(name, marks=pytest.mark.slow if name in SLOW else ()) for name in COURSES],
)
def test_the_replay_holds_what_the_books_say(name):
    config = COURSES[name]
    learning = dict(config.learning)
    frozen = {"high_level": NETWORKS["high_level"]} if [*learning] == ["low_level"] else {}
    state, seen = replay_books.drive(config, frozen, jax.random.key(2), ITERATIONS)
    assert seen["as chosen"].all()
    crashed = (seen["over"] & (seen["accident"] > 0)).sum()
    assert 0 < crashed < seen["over"].sum() > 10
    for level, settings in learning.items():
        expected = replay_books.book(config, seen, level)
        memory = state.replays[level]
        rows = np.asarray(memory.rows)
        # None is missing or superfluous but for those of the last iteration.
        assert 0 <= int(memory.position) - len(expected) <= BUDGET.worlds * settings.returns
        assert len(expected) > 30
        np.testing.assert_allclose(rows[: len(expected)], expected, rtol=2e-5, atol=2e-5)
        discounts = rows[: len(expected), (rows.shape[1] - 3) // 2 + 2]
        assert 0.0 in discounts
        assert len(np.unique(discounts)) > 1
    if "low_level" in learning:
        assert seen["reached"].any()
        assert not seen["reached"].all()


def test_the_two_levels_explore_by_themselves():
    """At epsilon 1 the choices of neither level can be told from those of the other."""
    learning = {"high_level": LevelSettings(), "low_level": LevelSettings()}
    config = course_of(Hierarchical(DRIVING, GoalSettings(), "critic"), **learning)
    first = rollout.begin(config, NETWORKS, jax.random.key(5))
    always = {name: jnp.float32(1.0) for name in learning}
    choose = jax.vmap(lambda key: rollout._choose(config, NETWORKS, first, always, key)[0])
    pending = jax.jit(choose)(jax.random.split(jax.random.key(6), 400))
    high, low = (np.asarray(pending[name].choice)[:, 0] for name in learning)
    counts = np.histogram2d(high, low, bins=9)[0]
    # Chi-square of independence with 64 degrees of freedom: mean 64, standard deviation 11.3.
    expected = np.outer(counts.sum(1), counts.sum(0)) / counts.sum()
    assert ((counts - expected) ** 2 / expected).sum() < 64 + 5 * 11.3
