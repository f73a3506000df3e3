"""Test episodes decision by decision: anyone's policy, start and observation, in both worlds."""

import json
from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from test_evaluator import COUNT, FEW, SETTINGS, TEST, WEIGHTS, alike

import lanewise
from lanewise import api, config
from lanewise.controllers.references import RuleBased
from lanewise.driving import observation
from lanewise.driving.settings import DrivingSettings
from lanewise.errors import LanewiseError, NumbersError
from lanewise.evaluation import evaluator, metrics, stepwise
from lanewise.evaluation.evaluator import EvaluationConfig
from lanewise.evaluation.stepwise import Lanewise
from lanewise.interop import highway_env
from lanewise.interop.highway_env_evaluation import HighwayEnv
from lanewise.learning import network
from lanewise.runs.trained import Trained
from lanewise.scenario.settings import TrapSettings
from lanewise.world import build, road
from lanewise.world.state import CONSTANT, EXTERNAL, RULE_BASED, World

pytestmark = pytest.mark.usefixtures("small_blocks")
ESCAPE = "11115555444444333377777777777777774444444444444444"
"""Low-level actions from the test's start: fall back, cross to the right lane, speed up."""
LEVELS = WEIGHTS | {"high_level": network.init(jax.random.key(5), 26, (8,), 9)}


def evaluate(policy, **given):
    return lanewise.evaluate(policy, **FEW | given)


class Agent:
    """Predicts as Stable-Baselines3's agents do, and counts what it is asked."""

    def __init__(self, choose):
        self.choose, self.asked = choose, []

    def predict(self, observation, state=None, episode_start=None, deterministic=False):
        self.asked.append((state, bool(episode_start.all()), deterministic))
        return self.choose(observation), (0 if state is None else state + 1)


def greedy(level="single_level"):
    """The choice with the highest Q-value of a Lanewise network, in NumPy."""
    *hidden, (last, bias) = jax.device_get(LEVELS[level])

    def choose(seen):
        for weights, biases in hidden:
            seen = np.maximum(seen @ weights + biases, 0.0)
        return np.argmax(seen @ last + bias, axis=-1)

    return choose


def idle(seen):
    """Goes on as it is, and writes over what it is given: PyTorch warns of arrays that may not."""
    seen += 1.0
    return np.full(len(seen), 4)


def one_by_one(seen):
    assert seen.shape == (26,)
    return int(greedy()(seen))


@pytest.mark.parametrize("kind", ["batched", "one by one", "agent"])
def test_the_same_as_our_own(ours, kind, capsys):
    policy = {"batched": greedy(), "one by one": one_by_one, "agent": Agent(greedy())}[kind]
    found = evaluate(policy, episodes=COUNT, name="mine", quiet=kind == "agent")
    assert ("mine: 100%" in capsys.readouterr().err) == (kind != "agent")
    alike(found.episodes, ours)
    assert found.summary.controller == "mine"
    assert "mine" in str(found)


def test_a_controller_of_ours(ours, capsys):
    trained = Trained("single-level", SETTINGS, 0, WEIGHTS)
    for quiet in (False, True):
        found = lanewise.evaluate(trained, episodes=COUNT, quiet=quiet)
        assert ("100%" in capsys.readouterr().err) != quiet
    np.testing.assert_array_equal(found.episodes.accumulated_reward, ours.accumulated_reward)
    assert found.summary.controller == "single-level"
    with pytest.raises(LanewiseError, match=r"driving\.stopped_speed: .* keeps its own"):
        lanewise.evaluate(trained, stopped_speed=9.0)


def test_a_controller_of_ours_in_another_scenario(capsys):
    trained = Trained("single-level", SETTINGS, 0, WEIGHTS)
    before = evaluator.drive_block.__wrapped__._cache_size()
    found = lanewise.evaluate(trained, episodes=COUNT, trap_speed=9.0)
    assert "was trained on scenario.trap_speed 10.0 (here 9.0)\n" in capsys.readouterr().err
    # The same maxima: nothing is compiled anew.
    assert evaluator.drive_block.__wrapped__._cache_size() == max(1, before)
    assert found.record().speed[0, 1] == 9.0
    slower = config.replace(SETTINGS, {"scenario.trap_speed": 9.0})
    made_so = Trained("single-level", slower, 0, WEIGHTS)
    alike(found.episodes, lanewise.evaluate(made_so, episodes=COUNT).episodes)
    assert "trained on" not in capsys.readouterr().err
    shorter = lanewise.evaluate(trained, episodes=COUNT, quiet=True, duration=2)
    assert shorter.episodes.duration.max() <= 2.0


def test_a_recurrent_agent_keeps_its_state_within_a_block_and_no_longer():
    agent = Agent(idle)
    evaluate(agent, episodes=COUNT)
    states = [state for state, _, _ in agent.asked]
    assert states == [None, *range(49)] * 2
    assert [start for _, start, _ in agent.asked] == [state is None for state in states]
    assert all(deterministic for *_, deterministic in agent.asked)
    agent.asked.clear()
    evaluate(agent, episodes=1, deterministic=False)
    assert not any(deterministic for *_, deterministic in agent.asked)


def test_a_function_of_one_observation_is_asked_for_the_episodes_under_way_alone():
    asked = []

    def swerve(seen):
        asked.append(seen)
        return 8

    found = evaluate(swerve, batched=False, episodes=3)
    decisions = int(found.episodes.duration.sum() * 2)
    assert decisions < 3 * 50, "episodes end early"
    # And now and then the first of them once more.
    assert decisions < len(asked) < decisions + 3 * 8
    asked.clear()
    found.record(1)
    assert found.episodes.duration[1] * 2 <= len(asked) < 50


def test_episodes_to_look_at():
    before = stepwise._step.__wrapped__._cache_size()
    found, place = evaluate(greedy(), episodes=COUNT, name="mine"), COUNT - 1
    # Another name or start is not compiled anew.
    evaluate(greedy(), episodes=1, name="another", trap_speed=9.0)
    assert stepwise._step.__wrapped__._cache_size() == max(1, before)
    recording = found.record(place)
    assert recording.controller == "mine"
    assert recording.accident == found.episodes.accident[place]
    assert recording.accident_kind == found.episodes.accident_kind[place]
    assert recording.accumulated_reward[-1] == pytest.approx(
        found.episodes.accumulated_reward[place], abs=1e-4
    )
    assert recording.x[-1, 0] == pytest.approx(found.episodes.travel_distance[place])
    frames = int(found.episodes.duration[place] * 2) + 1
    np.testing.assert_array_equal(recording.time, np.arange(frames) / 2)
    assert recording.goal_lane.tolist() == [-1] * frames
    assert recording.goals_ended.tolist() == recording.goals_timed_out.tolist() == [0] * frames


def test_outcomes_in_highway_env_are_identical():
    """Of an escape by hand, and of a network."""
    script = np.array([int(action) for action in ESCAPE])

    class Scripted:
        def predict(self, observation, state=None):
            step = 0 if state is None else state + 1
            return np.full(len(observation), script[step]), step

    for policy, escapes in ((Scripted(), True), (greedy(), False)):
        here = evaluate(policy, episodes=2)
        there = evaluate(policy, episodes=2, world="highway-env")
        assert here.episodes.success.tolist() == [escapes] * 2
        alike(there.episodes, here.episodes)
        assert "highway-env" in there.table(here)


@pytest.mark.slow
def test_the_rule_based_ego_drives_alike_in_both_worlds():
    """Behind a gap wide enough to change lanes, so that it does more than follow."""
    wide = TrapSettings(ego_driver="rule-based", test_side_distance=100.0, ego_speed=12.0)
    given = EvaluationConfig(wide, DrivingSettings(), RuleBased(), 50)
    theirs = stepwise.evaluate(given, stepwise.greedy({}), HighwayEnv(), 3, 2)
    alike(theirs, evaluator.evaluate(given, {}, 3, 2))
    recording = stepwise.record(given, stepwise.greedy({}), HighwayEnv(), 3, 0)
    assert np.ptp(recording.y[:, 0]) > 3.5


@pytest.mark.parametrize(
    ("simulation", "decision", "seconds", "decisions"), [(15, 2, 5.0, 11), (10, 10, 1.0, 10)]
)
def test_the_live_environment_ends_after_the_simulated_duration(
    simulation, decision, seconds, decisions
):
    env = highway_env.build_env(
        jax.device_get(evaluator.start(TEST, 0, 0)),
        simulation_frequency=simulation,
        decision_frequency=decision,
        duration=seconds,
    )
    ends = [env.step(4)[3] for _ in range(decisions)]
    assert ends == [False] * (decisions - 1) + [True]


def test_a_recording_counts_the_goals_as_the_goal_critic_does():
    """Recounted from the frames alone: reached by the paper's thresholds, or given up in time."""
    found = evaluate(
        lambda seen: np.full(len(seen), 8),  # the next lane to the right, and more speed
        actions="goal",
        world="highway-env",
        episodes=1,
        duration=12.0,
        goals={"time_limit": 1.5},
        ego_speed=14.0,
        trap_speed=0.5,
        test_front_distance=200.0,
        test_side_distance=-50.0,
    )
    recording = found.record()
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


@pytest.mark.slow
def test_goals():
    given, _ = api._course("goal", FEW)
    expected = stepwise.evaluate(given, stepwise.greedy(LEVELS), Lanewise(), 0, COUNT)
    found = evaluate(greedy("high_level"), actions="goal", episodes=COUNT)
    alike(found.episodes, expected)
    assert found.episodes.goals.sum() > 0


@pytest.mark.slow
def test_continuous_actions():
    """At the speed of the trap nothing happens."""
    found = evaluate(
        lambda seen: np.zeros((len(seen), 2)), actions="continuous", episodes=COUNT
    ).episodes
    assert (found.accident == 0).all()
    np.testing.assert_allclose(found.travel_distance, 250.0, rtol=1e-5)
    with pytest.raises(LanewiseError, match="continuous actions are not driven in highway-env"):
        evaluate(lambda seen: np.zeros((1, 2)), actions="continuous", world="highway-env")


def in_a_row(settings, *kinds):
    """Vehicles 30 m apart in the left lane, all as fast as the trap."""
    x, lane = 30.0 * jnp.arange(len(kinds)), jnp.zeros(len(kinds), jnp.int32)
    return World(
        road=road.straight_road(settings.lanes),
        drivers=build.make_drivers([settings.traffic.driver] * len(kinds), kinds),
        vehicles=build.make_vehicles(x, 0.0 * x, 0.0 * x + settings.trap_speed, lane),
    )


def among_traffic(settings, key, split):
    return in_a_row(settings, EXTERNAL, RULE_BASED, RULE_BASED)


def behind_three(settings, key, split):
    """More than the paper's twelve vehicles, the second of which is not there."""
    world = in_a_row(settings, EXTERNAL, *[CONSTANT] * 4, *[RULE_BASED] * 9)
    present = world.vehicles.present.at[1].set(False)
    return replace(world, vehicles=replace(world.vehicles, present=present))


def survived(world):
    return world.vehicles.x[0] > 1.0


def observe_the_slow(settings, world):
    """Not finite once the ego has sped up."""
    features = observation.features(settings, world)
    return features.at[7].set(jnp.where(world.vehicles.speed[0] > 10.2, jnp.inf, features[7]))


def test_the_paper_s_success_wants_trap_cars():
    said = r"start: among_traffic places no trap car.*; give success= too"
    with pytest.raises(LanewiseError, match=said) as refused:
        evaluate(idle, task=lanewise.TaskFunctions(start=among_traffic), episodes=1)
    assert len(str(refused.value).splitlines()) == 1


@pytest.mark.parametrize("world", ["highway-env", pytest.param("lanewise", marks=pytest.mark.slow)])
def test_a_task_of_one_s_own(tmp_path, world):
    """Any number of vehicles, drawn by what they are; success; an observation that is refused."""
    task = lanewise.TaskFunctions(start=behind_three, success=survived, observe=observe_the_slow)
    given = {"duration": 1.0, "task": task, "world": world, "episodes": 2}
    found = evaluate(idle, **given)
    assert found.episodes.success.all()
    recording = found.record()
    assert recording.role[recording.present].tolist() == [0, 1, 1, 1] + [2] * 9
    found.clip(tmp_path / "own.gif")
    assert (tmp_path / "own.gif").stat().st_size > 1000
    found.save(tmp_path / "mine.json")
    assert json.loads((tmp_path / "mine.json").read_text())["success_rate"] == 1.0
    stored = metrics.from_csv((tmp_path / "mine.csv").read_text())
    assert np.array_equal(stored.success, found.episodes.success)
    with pytest.raises(NumbersError, match="an observation is not finite in 2 of 2 episodes"):
        evaluate(lambda seen: 7, **given)
