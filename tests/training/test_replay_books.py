"""Every transition a stage writes, against plain books of what its worlds did; all controllers."""

from dataclasses import replace

import jax
import numpy as np
import pytest
import replay_books
from test_stage import COURSE, SETTINGS

from lanewise.controllers.hierarchical import Hierarchical, Planned
from lanewise.controllers.settings import GoalSettings, PlannerSettings
from lanewise.controllers.single_level import SingleLevel
from lanewise.driving.settings import DrivingSettings
from lanewise.learning import network

CHUNKS = 4
BUDGET = replace(SETTINGS, worlds=3, duration=17)
LEARNS = replace(SETTINGS, learner=replace(SETTINGS.learner, replay_capacity=2000))
GOALS = GoalSettings(time_limit=2.0, lateral_tolerance=1.5, speed_tolerance=1.5)
HIGH = {"high_level": network.init(jax.random.key(3), 26, (8,), 9)}


def course_of(controller, **learning):
    return replace(COURSE, controller=controller, budget=BUDGET, learning=tuple(learning.items()))


COURSES = {
    "single-level, held, 2-step, per decision, time-outs terminal": (
        course_of(
            SingleLevel(hold=3),
            single_level=replace(
                LEARNS, returns=2, discount_across_goal="per-decision", time_out="terminal"
            ),
        ),
        {},
    ),
    "step 1, per goal": (
        course_of(
            Planned(DrivingSettings(), GOALS, PlannerSettings(preview=2), "critic"),
            high_level=LEARNS,
        ),
        {},
    ),
    "step 2, paid for tracking and approach": (
        course_of(
            Hierarchical(DrivingSettings(), GOALS, "critic"),
            low_level=replace(LEARNS, tracking_weight=0.5, approach_weight=1.5),
        ),
        HIGH,
    ),
    "h-DQN, per decision above, goals are ends below": (
        course_of(
            Hierarchical(DrivingSettings(), GOALS, "critic", "h-dqn"),
            high_level=replace(LEARNS, discount_across_goal="per-decision", returns=2),
            low_level=replace(LEARNS, external_weight=0.0, goal_reward=1.0, goal_end="terminal"),
        ),
        {},
    ),
}


@pytest.mark.slow
@pytest.mark.parametrize("name", COURSES)
def test_the_replay_holds_what_the_books_say(monkeypatch, name):
    config, frozen = COURSES[name]
    config = replay_books.noting(config)
    state, seen = replay_books.drive(monkeypatch, config, frozen, jax.random.key(2), CHUNKS)
    ends = seen.outcome.over.sum()
    crashed = (seen.outcome.over & (seen.outcome.accident > 0)).sum()
    assert ends > 10
    assert 0 < crashed < ends
    for level, level_settings in config.learning:
        expected = replay_books.book(config, seen, level)
        memory = state.replays[level]
        rows = np.asarray(memory.rows)
        # None is missing or superfluous but for those of the last iteration.
        assert 0 <= int(memory.position) - len(expected) <= BUDGET.worlds * level_settings.returns
        assert len(expected) > 60
        np.testing.assert_allclose(rows[: len(expected)], expected, rtol=2e-5, atol=2e-5)
        discounts = rows[: len(expected), (rows.shape[1] - 3) // 2 + 2]
        assert 0.0 in discounts
        assert len(np.unique(discounts)) > 1
        assert int(state.learners[level].updates) > 20
    if "high_level" in frozen or len(config.learning) > 1:
        assert seen.notes["reached"].any()
        assert not seen.notes["reached"].all()
