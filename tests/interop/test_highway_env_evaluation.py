"""The same starts and controllers in the real highway-env and in ours: the same outcomes."""

from dataclasses import dataclass

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from lanewise.controllers import planner
from lanewise.controllers.goals import Goal
from lanewise.controllers.rule_based import RuleBased
from lanewise.controllers.settings import PlannerSettings
from lanewise.controllers.single_level import SingleLevel
from lanewise.driving.settings import DrivingSettings
from lanewise.evaluation import evaluator, stepwise
from lanewise.evaluation.evaluator import EvaluationConfig
from lanewise.evaluation.stepwise import Greedy, Lanewise
from lanewise.interop import highway_env
from lanewise.interop.highway_env_evaluation import HighwayEnv
from lanewise.learning import network
from lanewise.scenario.settings import TrapSettings


@dataclass(frozen=True)
class BrakeAndPass(SingleLevel):
    """The way out by hand: fall back, cross to the right lane, then speed up."""

    levels: tuple = ()

    def start(self, percept):
        return jnp.int32(0)

    def act(self, memory, percept):
        braking = memory < 4
        lane = jnp.where(braking, 0, 2)
        goal = Goal(
            lane.astype(jnp.int32), jnp.where(braking, 8.0, jnp.where(memory < 10, 8, 16.0))
        )
        action = planner.act(PlannerSettings(), DrivingSettings(), goal, percept)
        return action, memory + 1


@pytest.mark.parametrize(
    ("controller", "expected"),
    [
        pytest.param(SingleLevel(), None, marks=pytest.mark.slow),
        (BrakeAndPass(), "success"),
    ],
)
def test_outcomes_are_identical(controller, expected, monkeypatch):
    monkeypatch.setattr(evaluator, "BLOCK", 2)
    config = EvaluationConfig(TrapSettings(), DrivingSettings(), controller, 50)
    parameters = {"single_level": network.init(jax.random.key(2), 26, (16,), 9)}
    told = []
    ours = evaluator.evaluate(config, parameters, 11, 2)
    theirs = stepwise.evaluate(config, Greedy(parameters), HighwayEnv(), 11, 2, told.append)
    assert told == [1, 2]
    for name in ("success", "accident", "duration", "escape_time", "goals"):
        np.testing.assert_array_equal(getattr(ours, name), getattr(theirs, name), err_msg=name)
    for name in ("accumulated_reward", "average_speed", "travel_distance"):
        np.testing.assert_allclose(
            getattr(ours, name), getattr(theirs, name), rtol=1e-4, err_msg=name
        )
    if expected == "success":
        assert ours.success.all()


@pytest.mark.slow
def test_the_rule_based_ego_drives_alike_in_both_worlds(monkeypatch):
    """Behind a gap wide enough to change lanes, so that it does more than follow."""
    monkeypatch.setattr(evaluator, "BLOCK", 4)
    scenario = TrapSettings(ego_driver="rule-based", test_side_distance=100.0, ego_speed=12.0)
    for one in (TrapSettings(ego_driver="rule-based"), scenario):
        config = EvaluationConfig(one, DrivingSettings(), RuleBased(), 50)
        ours, theirs = (
            evaluator.evaluate(config, {}, 3, 4),
            stepwise.evaluate(config, Greedy({}), HighwayEnv(), 3, 4),
        )
        np.testing.assert_array_equal(ours.success, theirs.success)
        np.testing.assert_array_equal(ours.accident, theirs.accident)
        for name in ("accumulated_reward", "average_speed", "travel_distance"):
            np.testing.assert_allclose(getattr(ours, name), getattr(theirs, name), rtol=1e-4)
    recording = stepwise.record(config, Greedy({}), Lanewise(1), 3, 0)
    assert np.ptp(recording.y[:, 0]) > 3.5


@pytest.mark.parametrize(
    ("simulation", "decision", "seconds", "decisions"), [(15, 2, 5.0, 11), (10, 10, 1.0, 10)]
)
def test_the_live_environment_ends_after_the_simulated_duration(
    simulation, decision, seconds, decisions
):
    config = EvaluationConfig(TrapSettings(), DrivingSettings(), SingleLevel(), 50)
    env = highway_env.build_env(
        jax.device_get(evaluator.start(config, 0, 0)),
        simulation_frequency=simulation,
        decision_frequency=decision,
        duration=seconds,
    )
    ends = [env.step(4)[3] for _ in range(decisions)]
    assert ends == [False] * (decisions - 1) + [True]
