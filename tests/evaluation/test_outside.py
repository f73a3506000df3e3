"""Anyone's policy through the protocol: the same episodes as a controller of ours that does the
same."""

import json
from functools import cache

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import lanewise
from lanewise import config
from lanewise.errors import LanewiseError
from lanewise.evaluation import drive, metrics, outside
from lanewise.learning import network
from lanewise.training import recipe

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
    return drive.test(recipe.test_course(SETTINGS, "single-level"), PARAMETERS, 0, EPISODES)


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
    before = outside._advance.__wrapped__._cache_size()
    found = lanewise.evaluate(lambda seen: 5, episodes=1, name="another")
    assert outside._advance.__wrapped__._cache_size() == before
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
    course = recipe.test_course(SETTINGS, "planned")
    expected = drive.test(course, PARAMETERS, 0, 40)
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


def test_the_user_s_own_success(tmp_path):
    parts = lanewise.Parts(success=survived)
    found = lanewise.evaluate(lambda seen: 4, episodes=4, duration=2.0, parts=parts)
    assert found.episodes.success.all()
    found.save(tmp_path / "mine.json")
    assert json.loads((tmp_path / "mine.json").read_text())["success_rate"] == 1.0
    assert np.array_equal(
        metrics.from_csv((tmp_path / "mine.csv").read_text()).success, found.episodes.success
    )


def survived(world):
    return world.vehicles.x[0] > 1.0


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
