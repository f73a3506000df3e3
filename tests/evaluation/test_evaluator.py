from dataclasses import dataclass, replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from lanewise.controllers.levels import HighLevel
from lanewise.controllers.planned import Planned
from lanewise.controllers.settings import GoalSettings, PlannerSettings
from lanewise.controllers.single_level import SingleLevel
from lanewise.driving.settings import DrivingSettings
from lanewise.evaluation import evaluator, metrics, stepwise
from lanewise.evaluation.evaluator import EvaluationConfig
from lanewise.evaluation.stepwise import Greedy, Lanewise
from lanewise.learning import network
from lanewise.scenario.settings import TrafficSettings, TrapSettings

EMPTY = TrapSettings(
    ego_speed=14.0,
    trap_speed=0.5,
    test_front_distance=200.0,
    test_side_distance=-50.0,
    traffic=TrafficSettings(vehicles_ahead=0),
)
"""Nobody comes near an ego that drives 8 s at 14 m/s."""


@dataclass(frozen=True)
class Constant(SingleLevel):
    """Drives one action for ever."""

    action: int = 4

    def act(self, memory, percept):
        return jnp.int32(self.action), memory


@dataclass(frozen=True)
class RightwardsLevel(HighLevel):
    """Always asks for the next lane to the right, and for more speed."""

    def choose(self, memory, percept, choice):
        return super().choose(memory, percept, jnp.int32(8))


@dataclass(frozen=True)
class Rightwards(Planned):
    """Step 1 with a high level that always wants the same."""

    @property
    def levels(self):
        return (RightwardsLevel(self.goals),)


def course_of(scenario, controller, duration=50):
    return EvaluationConfig(scenario, DrivingSettings(), controller, duration)


def parameters(seed=0):
    return {"single_level": network.init(jax.random.key(seed), 26, (8,), 9)}


def test_an_idle_ego_on_an_empty_road_in_closed_form(monkeypatch):
    monkeypatch.setattr(evaluator, "BLOCK", 2)
    scenario = replace(EMPTY, test_side_distance=60.0, trap_speed=10.0, ego_speed=10.0)
    found = evaluator.evaluate(course_of(scenario, Constant()), parameters(), 0, 2)
    reward = (1.5 * (2 / 75 * 10 - 2 / 15) + 0.05) / 1.6
    np.testing.assert_allclose(found.accumulated_reward, 25 * reward, rtol=1e-5)
    np.testing.assert_allclose(found.travel_distance, 250.0, rtol=1e-5)
    np.testing.assert_allclose(found.average_speed, 10.0)
    np.testing.assert_array_equal(found.duration, 25.0)
    assert not found.success.any()
    assert np.isnan(found.escape_time).all()
    assert found.accident.tolist() == [0, 0]
    assert found.goals.tolist() == [0, 0]


def test_the_distance_counts_from_where_the_drive_began(monkeypatch):
    monkeypatch.setattr(evaluator, "BLOCK", 2)
    scenario = replace(EMPTY, test_side_distance=60.0, trap_speed=10.0, ego_speed=10.0)
    config = course_of(scenario, Constant())
    worlds = evaluator.start_block(config, 0, 0)
    x = worlds.vehicles.x + jnp.array([[500.0], [-2000.0]])
    further = replace(worlds, vehicles=replace(worlds.vehicles, x=x))
    found = evaluator.drive_block(config, parameters(), further)
    np.testing.assert_allclose(found.stats.distance, 250.0, rtol=1e-5)


def test_an_accident_adds_its_penalty_once_and_ends_the_sums(monkeypatch):
    """Braking from 2.25 m/s at 1 m/s^2 the ego is below 0.1 m/s after five decisions."""
    monkeypatch.setattr(evaluator, "BLOCK", 1)
    found = evaluator.evaluate(
        course_of(replace(EMPTY, ego_speed=2.25), Constant(action=1)), parameters(), 0, 1
    )
    assert found.accident.tolist() == [3]
    assert found.duration.tolist() == [2.5]
    # Rewards at 1 s and 2 s, each of a centred slow car, and the penalty at 2.5 s.
    assert found.accumulated_reward[0] == pytest.approx(2 * 0.05 / 1.6 - 10.0, rel=1e-4)
    assert found.average_speed[0] == pytest.approx(
        np.mean([1.75, 1.25, 0.75, 0.25, -0.25]), abs=1e-4
    )
    assert not found.success[0]


def test_episodes_do_not_depend_on_how_many_are_driven_with_them(monkeypatch):
    monkeypatch.setattr(evaluator, "BLOCK", 4)
    config = replace(
        course_of(TrapSettings(training_front_distance=(8.0, 30.0)), Constant(action=7), 12),
        split="training",
    )
    weights = parameters()
    many, few = (evaluator.evaluate(config, weights, 3, count) for count in (10, 5))
    assert len(few) == 5
    for name in vars(few):
        np.testing.assert_array_equal(getattr(few, name), getattr(many, name)[:5])
    # The ego speeds up behind trap car 1, at a distance that differs, until it hits it.
    assert len(np.unique(many.accumulated_reward)) > 1


def test_a_drive_past_the_trap_that_then_stops_has_the_papers_success_and_not_ours(monkeypatch):
    """Both trap cars start behind an ego that brakes to a stop."""
    monkeypatch.setattr(evaluator, "BLOCK", 1)
    behind = replace(EMPTY, ego_speed=2.25, test_front_distance=-60.0)
    found = evaluator.evaluate(course_of(behind, Constant(action=1)), parameters(), 0, 1)
    assert (found.accident.tolist(), found.escape_time.tolist()) == ([3], [0.5])
    summary = metrics.summarise(found, controller="single-level", world="lanewise")
    assert (summary.values["escape_rate"], summary.values["success_rate"]) == (1.0, 0.0)


@pytest.mark.slow
def test_a_recording_agrees_with_the_test(monkeypatch):
    monkeypatch.setattr(evaluator, "BLOCK", 1)
    config = course_of(EMPTY, Constant(), 16)
    found = evaluator.evaluate(config, parameters(), 0, 1)
    recording = stepwise.record(config, Greedy(parameters()), Lanewise(1), 0, 0)
    assert recording.x.shape == (17, 3)
    assert recording.x[-1, 0] == pytest.approx(found.travel_distance[0])
    assert recording.accumulated_reward[-1] == pytest.approx(found.accumulated_reward[0])
    assert recording.accident == found.accident[0]
    assert recording.goal_lane.tolist() == [-1] * 17
    assert recording.goals_ended.tolist() == [0] * 17
    assert recording.goals_timed_out.tolist() == [0] * 17
    np.testing.assert_allclose(recording.time, np.arange(17) / 2)
    np.testing.assert_allclose(recording.x[:, 0], 7.0 * np.arange(17), rtol=1e-5)


def test_a_recording_counts_the_goals_as_the_goal_critic_does(monkeypatch):
    """Recounted from the frames alone: reached by the paper's thresholds, or given up in time."""
    monkeypatch.setattr(evaluator, "BLOCK", 1)
    goals = GoalSettings(time_limit=1.5)
    controller = Rightwards(DrivingSettings(), goals, PlannerSettings(), "critic")
    config = course_of(EMPTY, controller, 24)
    weights = {"high_level": network.init(jax.random.key(1), 26, (8,), 9)}
    recording = stepwise.record(config, Greedy(weights), Lanewise(1), 0, 0)
    along = recording.speed[:, 0] * np.cos(recording.heading[:, 0])
    ended, timed_out, age = [0, 0], [0, 0], 1
    for seen in range(1, len(recording.time) - 1):
        lateral = recording.lane_centre[recording.goal_lane[seen]] - recording.y[seen, 0]
        speed = recording.goal_speed[seen] - along[seen]
        reached = abs(lateral) < 0.3 and abs(speed) < 0.3
        given_up = not reached and age >= 3
        ended.append(ended[-1] + (reached or given_up))
        timed_out.append(timed_out[-1] + given_up)
        age = 1 if reached or given_up else age + 1
    assert recording.goals_ended.tolist() == ended
    assert recording.goals_timed_out.tolist() == timed_out
    assert 0 < timed_out[-1] < ended[-1]
