"""Anyone's policy through the protocol: the same episodes as a controller of ours that does the
same."""

import dataclasses
import json
from functools import cache

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import lanewise
from lanewise import api, config
from lanewise.errors import LanewiseError
from lanewise.evaluation import evaluator, external_policy, metrics, stepwise
from lanewise.learning import network
from lanewise.training import recipe
from lanewise.world import build, road
from lanewise.world.state import CONSTANT, EXTERNAL, RULE_BASED, World

SETTINGS = config.compose()
PARAMETERS = {
    "single_level": network.init(jax.random.key(3), 26, (16,), 9),
    "high_level": network.init(jax.random.key(5), 26, (16,), 9),
}
EPISODES = 130
"""More than a block."""


@cache
def greedy(level):
    values = jax.jit(jax.vmap(lambda seen: network.q_values(PARAMETERS[level], seen)))
    return lambda seen: np.asarray(jnp.argmax(values(seen), axis=-1))


class Agent:
    """Predicts as Stable-Baselines3's agents do, and counts what it is asked."""

    def __init__(self, choose):
        self.choose = choose
        self.asked = []

    def predict(self, observation, state=None, episode_start=None, deterministic=False):
        self.asked.append((state, bool(episode_start.all()), deterministic))
        return self.choose(observation), (0 if state is None else state + 1)


def alike(found, expected):
    assert np.array_equal(found.success, expected.success)
    assert np.array_equal(found.accident, expected.accident)
    assert np.array_equal(found.goals, expected.goals)
    for name in ("accumulated_reward", "average_speed", "travel_distance", "duration"):
        assert np.allclose(getattr(found, name), getattr(expected, name), rtol=1e-4, atol=1e-3)


@pytest.fixture(scope="module")
def ours():
    return evaluator.evaluate(
        recipe.evaluation_config(SETTINGS, "single-level"), PARAMETERS, 0, EPISODES
    )


def idle(seen):
    """Goes on as it is, and writes over what it is given."""
    seen += 1.0
    return np.full(len(seen), 4)


def test_observations_may_be_written_to():
    """PyTorch warns of arrays that may not."""
    for world in ("lanewise", "highway-env"):
        lanewise.evaluate(idle, episodes=1, world=world)


@pytest.mark.slow
def test_another_name_is_not_compiled_anew():
    lanewise.evaluate(lambda seen: 4, episodes=1)
    before = stepwise._step.__wrapped__._cache_size()
    found = lanewise.evaluate(lambda seen: 5, episodes=1, name="another")
    assert stepwise._step.__wrapped__._cache_size() == before
    assert found.summary.controller == found.record().controller == "another"


def one_by_one(seen):
    assert seen.shape == (26,)
    return int(greedy("single_level")(seen[None])[0])


@pytest.mark.parametrize("kind", ["batched", "one by one", "agent"])
def test_the_same_as_our_own(ours, kind, capsys):
    policy = {
        "batched": greedy("single_level"),
        "one by one": one_by_one,
        "agent": Agent(greedy("single_level")),
    }[kind]
    found = lanewise.evaluate(policy, episodes=EPISODES, name="mine", quiet=kind == "agent")
    assert ("mine: 100%" in capsys.readouterr().err) == (kind != "agent")
    alike(found.episodes, ours)
    assert found.summary.controller == "mine"
    expected = metrics.summarise(ours, controller="mine", world="lanewise")
    assert found.summary.values["success_rate"] == expected.values["success_rate"]
    assert "mine" in str(found)


def test_a_recurrent_agent_keeps_its_state_within_a_block_and_no_longer():
    agent = Agent(idle)
    lanewise.evaluate(agent, episodes=EPISODES)
    states = [state for state, _, _ in agent.asked]
    assert states == [None, *range(49)] * 2
    assert [start for _, start, _ in agent.asked] == [state is None for state in states]
    assert all(deterministic for *_, deterministic in agent.asked)


@pytest.mark.slow
def test_goals():
    course = recipe.evaluation_config(SETTINGS, "planned")
    expected = evaluator.evaluate(course, PARAMETERS, 0, 40)
    found = lanewise.evaluate(greedy("high_level"), actions="goal", episodes=40)
    alike(found.episodes, expected)
    assert found.episodes.goals.sum() > 0


@pytest.mark.slow
def test_continuous_actions():
    found = lanewise.evaluate(
        lambda seen: np.zeros((len(seen), 2)), actions="continuous", episodes=5
    )
    idle = lanewise.evaluate(lambda seen: np.full(len(seen), 4), episodes=5)
    alike(found.episodes, idle.episodes)
    assert (idle.episodes.accident == 0).all()  # at the speed of the trap nothing happens
    with pytest.raises(LanewiseError, match="continuous actions are not driven in highway-env"):
        lanewise.evaluate(lambda seen: np.zeros((1, 2)), actions="continuous", world="highway-env")


def test_in_highway_env():
    here = lanewise.evaluate(greedy("single_level"), episodes=3)
    there = lanewise.evaluate(greedy("single_level"), episodes=3, world="highway-env", name="mine")
    assert np.array_equal(here.episodes.success, there.episodes.success)
    assert np.allclose(here.episodes.average_speed, there.episodes.average_speed, atol=1e-2)
    assert "highway-env" in there.table(here)


@pytest.mark.parametrize(
    "place",
    [
        "pretrained/single-level",
        pytest.param("reference/rule-based", marks=pytest.mark.slow),
    ],
)
def test_a_controller_of_ours(place, capsys):
    found = lanewise.evaluate(place, episodes=10)
    assert "100%" in capsys.readouterr().err
    lanewise.evaluate(place, episodes=10, quiet=True)
    assert capsys.readouterr().err == ""
    assert len(found.episodes) == 10
    assert found.summary.controller == place.partition("/")[2]
    with pytest.raises(LanewiseError, match="its own settings"):
        lanewise.evaluate(place, trap_speed=9.0)


def survived(world):
    return world.vehicles.x[0] > 1.0


def test_the_user_s_own_success(tmp_path):
    task = lanewise.TaskFunctions(success=survived)
    found = lanewise.evaluate(lambda seen: 4, episodes=4, duration=2.0, task=task)
    assert found.episodes.success.all()
    found.save(tmp_path / "mine.json")
    assert json.loads((tmp_path / "mine.json").read_text())["success_rate"] == 1.0
    assert np.array_equal(
        metrics.from_csv((tmp_path / "mine.csv").read_text()).success, found.episodes.success
    )


def in_a_row(settings, *kinds):
    """Vehicles 30 m apart in the left lane, all as fast as the trap."""
    x, lane = 30.0 * jnp.arange(len(kinds)), jnp.zeros(len(kinds), jnp.int32)
    return World(
        road=road.straight_road(settings.lanes),
        drivers=build.make_drivers([settings.traffic.driver] * len(kinds), kinds),
        vehicles=build.make_vehicles(x, 0.0 * x, 0.0 * x + settings.trap_speed, lane),
    )


def alone(settings, key, split):
    return in_a_row(settings, EXTERNAL)


def among_traffic(settings, key, split):
    return in_a_row(settings, EXTERNAL, RULE_BASED, RULE_BASED)


def behind_three(settings, key, split):
    """More than the paper's twelve vehicles, the second of which is not there."""
    world = in_a_row(settings, EXTERNAL, *[CONSTANT] * 4, *[RULE_BASED] * 9)
    present = world.vehicles.present.at[1].set(False)
    return dataclasses.replace(world, vehicles=dataclasses.replace(world.vehicles, present=present))


@pytest.mark.parametrize("start", [alone, among_traffic])
def test_the_paper_s_success_wants_trap_cars(start):
    said = rf"start: {start.__name__} places no trap car.*; give success= too"
    with pytest.raises(LanewiseError, match=said) as refused:
        lanewise.evaluate(idle, task=lanewise.TaskFunctions(start=start), episodes=1)
    assert len(str(refused.value).splitlines()) == 1


@pytest.mark.parametrize("world", [pytest.param("lanewise", marks=pytest.mark.slow), "highway-env"])
@pytest.mark.parametrize(
    ("task", "roles"),
    [
        (lanewise.TaskFunctions(start=alone, success=survived), [0]),
        (lanewise.TaskFunctions(start=behind_three), [0, 1, 1, 1] + [2] * 9),
    ],
    ids=["1", "14"],
)
def test_any_number_of_vehicles_is_driven_and_drawn_by_what_they_are(tmp_path, task, roles, world):
    found = lanewise.evaluate(idle, episodes=1, duration=1.0, task=task, world=world)
    assert found.episodes.success.tolist() == [len(roles) == 1]
    recording = found.record()
    assert recording.role[recording.present].tolist() == roles
    found.clip(tmp_path / "own.gif")


def test_episodes_to_look_at(tmp_path):
    found = lanewise.evaluate(greedy("single_level"), episodes=110, name="mine")
    recording = found.record(105)
    assert recording.controller == "mine"
    assert recording.time[-1] == found.episodes.duration[105]
    assert recording.accident == found.episodes.accident[105]
    assert recording.accumulated_reward[-1] == pytest.approx(
        found.episodes.accumulated_reward[105], abs=1e-4
    )
    found.clip(tmp_path / "mine.gif")
    assert (tmp_path / "mine.gif").stat().st_size > 1000


@pytest.mark.parametrize(
    ("policy", "said"),
    [
        (lambda seen: np.zeros((7, 3)), "shape"),
        (lambda seen: np.full(len(seen), 9), "from 0 to 8"),
        (lambda seen: np.full(len(seen), 1.5), "whole numbers"),
        (3.0, "a policy is"),
        ("nowhere/at-all", "no run"),
    ],
    ids=["shape", "unknown", "fraction", "number", "no run"],
)
def test_policies_that_make_no_sense(policy, said):
    with pytest.raises(LanewiseError, match=said):
        lanewise.evaluate(policy, episodes=2)


class Remembers:
    """Goes straight on, and harder to the right the more often it was asked."""

    def __init__(self, batched):
        self.asked, self.batched = 0, batched

    def __call__(self, seen):
        if not self.batched:
            assert seen.shape == (26,)
        self.asked += 1
        action = 4 if self.asked < 20 else 5
        return np.full(len(seen), action) if self.batched else action


@pytest.mark.parametrize("world", api.WORLDS)
@pytest.mark.parametrize("batched", [True, False])
def test_a_function_that_remembers_is_told_how_to(world, batched):
    said = r"with 4 and later with 5.*\n.* an object with predict\(observation, state"
    with pytest.raises(LanewiseError, match=said) as refused:
        lanewise.evaluate(Remembers(batched), batched=batched, episodes=1, world=world)
    assert len(str(refused.value).splitlines()) == 2


def test_a_function_that_draws_is_tested_where_it_says_so():
    chance = np.random.default_rng(0)

    def at_random(seen):
        return chance.integers(9, size=len(seen))

    with pytest.raises(LanewiseError, match="draws at random, deterministic=False"):
        lanewise.evaluate(at_random, episodes=1)
    assert len(lanewise.evaluate(at_random, episodes=2, deterministic=False).episodes) == 2
    agent = Agent(idle)
    lanewise.evaluate(agent, episodes=1, deterministic=False)
    assert not any(deterministic for *_, deterministic in agent.asked)
    with pytest.raises(LanewiseError, match=r"deterministic: .* leave it out"):
        lanewise.evaluate("pretrained/single-level", deterministic=False)


@pytest.mark.parametrize("world", api.WORLDS)
def test_a_function_of_one_observation_is_asked_for_the_episodes_under_way_alone(world):
    asked = []

    def swerve(seen):
        asked.append(seen)
        return 8

    found = lanewise.evaluate(swerve, batched=False, episodes=3, world=world, duration=25.0)
    decisions = int(found.episodes.duration.sum() * 2)
    assert decisions < 3 * 50, "episodes end early"
    # And now and then the first of them once more.
    assert decisions < len(asked) < decisions + 3 * 8
    asked.clear()
    found.record(1)
    assert found.episodes.duration[1] * 2 <= len(asked) < 50


def test_continuous_answers_may_differ_by_rounding():
    asked = []

    def rounding(seen):
        asked.append(seen)
        return np.full((len(seen), 2), 0.5 + 1e-6 * (len(asked) % 2))

    decide = external_policy.decider(rounding, True, 0)
    for decision in range(8):
        decide(np.zeros((3, 26), np.float32), np.ones(3, bool), decision == 0)


RETURNED = {
    "too large": ("continuous", lambda seen: np.full((len(seen), 2), 1e39)),
    "beyond the limit": ("continuous", lambda seen: np.full((len(seen), 2), 1.5)),
    "not a number": ("continuous", lambda seen: np.full((len(seen), 2), np.nan)),
    "complex": ("continuous", lambda seen: np.full((len(seen), 2), 0.5 + 1j)),
    "truth": ("continuous", lambda seen: np.full((len(seen), 2), True)),
    "one complex": ("continuous", lambda seen: [0.5, 1j]),
    "ragged": ("low-level", lambda seen: [[4]] + [[4, 4]] * (len(seen) - 1)),
    "text": ("low-level", lambda seen: ["4"] * len(seen)),
    "one text": ("low-level", lambda seen: "4"),
    "nothing": ("low-level", lambda seen: None),
    "truths": ("low-level", lambda seen: [True] * len(seen)),
    "objects": ("low-level", lambda seen: np.full(len(seen), 4, object)),
    "one shape, then another": ("low-level", lambda seen: [4] * (1 + (seen[0] > 0))),
    "predicts ragged": ("low-level", Agent(lambda seen: [[4]] + [[4, 4]] * (len(seen) - 1))),
    "predicts nothing": ("low-level", Agent(lambda seen: None)),
}


@pytest.mark.parametrize(("actions", "policy"), RETURNED.values(), ids=list(RETURNED))
@pytest.mark.parametrize("batched", [None, True])
def test_what_is_no_action_is_refused_in_a_line(actions, policy, batched):
    count = 0 if actions == "continuous" else 9
    given = None if hasattr(policy, "predict") else batched
    decide = external_policy.decider(policy, given, count)
    with pytest.raises(LanewiseError, match="the policy must return") as refused:
        decide(np.zeros((4, 26), np.float32), np.ones(4, bool), True)
    assert len(str(refused.value).splitlines()) == 1


def test_predict_returns_actions_and_at_most_a_state():
    class Three:
        def predict(self, observation):
            return np.full(len(observation), 4), None, None

    with pytest.raises(LanewiseError, match=r"predict\(\) .* it returned 3 values"):
        lanewise.evaluate(Three(), episodes=1)


@pytest.mark.parametrize("world", api.WORLDS)
def test_both_worlds_refuse_what_is_no_action(world):
    with pytest.raises(LanewiseError, match="the policy must return"):
        lanewise.evaluate(lambda seen: None, episodes=1, world=world)


def test_a_policy_that_fails_says_so_itself():
    def failing(seen):
        raise RuntimeError("out of ideas")

    with pytest.raises(RuntimeError, match="out of ideas"):
        lanewise.evaluate(failing, episodes=2)


def test_names_are_looked_up():
    with pytest.raises(AttributeError, match="evaluat"):
        lanewise.evaluat  # noqa: B018
    with pytest.raises(LanewiseError, match="did you mean highway-env"):
        lanewise.evaluate("reference/search", world="highwayenv")
