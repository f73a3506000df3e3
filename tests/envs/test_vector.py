"""Many worlds in one call: equal to a loop of single ones, in each autoreset mode."""

import copy
import pickle

import gymnasium
import numpy as np
import pytest
from gymnasium.error import ResetNeeded
from gymnasium.utils.env_checker import data_equivalence
from gymnasium.vector import AutoresetMode, SyncVectorEnv

import lanewise  # noqa: F401  # tells Gymnasium of the environments
from lanewise.errors import LanewiseError, SettingsError

COUNT = 6
SETTINGS = {"duration": 8.0, "vehicles_ahead": 1}
"""Everywhere, so that tests share compiled programs, and these are small."""
NEXT, SAME, DISABLED = AutoresetMode
TRAP, GOAL, CONTINUOUS = (f"lanewise/Trap{kind}-v0" for kind in ("", "Goal", "Continuous"))


def make(count=COUNT, name=TRAP, **settings):
    return gymnasium.make_vec(name, count, **SETTINGS | settings)


@pytest.mark.parametrize(
    ("name", "mode", "limit"),
    [
        (TRAP, NEXT, {}),
        (TRAP, NEXT, {"max_episode_steps": 5}),
        (TRAP, SAME, {"max_episode_steps": 5}),
        pytest.param(TRAP, DISABLED, {"max_episode_steps": 5}, marks=pytest.mark.slow),
        pytest.param(GOAL, SAME, {}, marks=pytest.mark.slow),
        pytest.param(CONTINUOUS, DISABLED, {}, marks=pytest.mark.slow),
    ],
)
def test_equal_to_a_loop_of_single_ones(name, mode, limit):
    """Step by step, and so often that episodes end in all of them."""
    steps = 30 if limit else 60
    ours = make(name=name, autoreset_mode=mode, **limit)
    alone = lambda: gymnasium.make(name, **SETTINGS | limit)  # noqa: E731
    theirs = SyncVectorEnv([alone] * COUNT, autoreset_mode=mode)
    assert ours.observation_space == theirs.observation_space
    assert ours.action_space == theirs.action_space
    assert ours.metadata["autoreset_mode"] is theirs.metadata["autoreset_mode"] is mode
    assert data_equivalence(ours.reset(seed=11), theirs.reset(seed=11))
    ours.action_space.seed(1)
    ended = 0
    for _ in range(steps):
        actions = ours.action_space.sample()
        ours_now, theirs_now = ours.step(actions), theirs.step(actions)
        assert data_equivalence(ours_now, theirs_now)
        done = ours_now[2] | ours_now[3]
        ended += done.sum()
        if mode is DISABLED and done.any():
            with pytest.raises(ResetNeeded, match="reset_mask"):
                ours.step(actions)
            again = [each.reset(options={"reset_mask": done.copy()}) for each in (ours, theirs)]
            assert data_equivalence(*(_where(each, done) for each in again))
    assert ended > (20 if limit else COUNT)


def _where(reset, done):
    observations, info = reset
    return observations, {name: values[done] for name, values in info.items()}


def test_pictures_need_a_mode_and_an_episode():
    assert make().render() is None
    env = make(render_mode="rgb_array")
    with pytest.raises(ResetNeeded, match=r"nothing to render: call reset\(\) first"):
        env.render()
    env.reset(seed=0)
    one, other, *_ = env.render()
    assert one.shape == other.shape == (240, 960, 3)
    assert not np.array_equal(one, other)


@pytest.mark.parametrize(
    ("given", "says"),
    [
        ({"num_envs": 0}, "num_envs must be between 1 and 2147483647, got 0"),
        ({"num_envs": True}, "num_envs: expected a whole number, got true"),
        ({"num_envs": 2.0}, "num_envs: expected a whole number, got 2.0"),
        ({"max_episode_steps": 0}, "max_episode_steps must be between 1 and 2147483647, got 0"),
        ({"max_episode_steps": 2.5}, "max_episode_steps: expected a whole number, got 2.5"),
        ({"autoreset_mode": "sometimes"}, 'unknown autoreset_mode "sometimes"; known: NextStep'),
        ({"actions": "goal"}, "actions: each kind has an id of its own"),
    ],
)
def test_settings_that_make_no_sense(given, says):
    with pytest.raises(SettingsError, match=says):
        gymnasium.make_vec(TRAP, **given)


@pytest.mark.parametrize(
    "again", [copy.copy, copy.deepcopy, lambda env: pickle.loads(pickle.dumps(env))]
)
def test_a_copy_goes_its_own_way(again):
    env = make(max_episode_steps=4)
    env.reset(seed=1)
    env.step([4] * COUNT)
    other = again(env)
    other.reset(seed=9, options={"reset_mask": np.arange(COUNT) == 0})
    ours = [env.step([4] * COUNT) for _ in range(4)]
    theirs = [other.step([4] * COUNT) for _ in range(4)]
    for one, two in zip(ours, theirs, strict=True):
        assert np.array_equal(one[0][1:], two[0][1:])
        assert not np.array_equal(one[0][0], two[0][0])
    assert [np.flatnonzero(step[3]).tolist() for step in ours[2:]] == [list(range(COUNT)), []]
    assert [np.flatnonzero(step[3]).tolist() for step in theirs[2:]] == [[*range(1, COUNT)], [0]]


def test_mistakes():
    env, idle = make(autoreset_mode="Disabled"), [4] * COUNT
    with pytest.raises(ResetNeeded):
        env.step(idle)
    with pytest.raises(ResetNeeded, match="all environments"):
        env.reset(seed=5, options={"reset_mask": np.arange(COUNT) == 0})
    env.reset(seed=list(range(5, 5 + COUNT)))
    with pytest.raises(ValueError, match=f"actions must be {COUNT} of"):
        env.step(idle[1:])


@pytest.fixture(scope="module")
def seeded():
    """Many worlds to be reset."""
    return make()


LAST = 2**32 - 1


@pytest.mark.parametrize(
    ("given", "says"),
    [
        ({"seed": [1, 2, 3]}, "3 seeds for 6 environments"),
        ({"seed": [9, 10, 11, 12, 13, -1]}, "must be a whole number between 0 and .*, got -1"),
        ({"seed": [9, 10, 11, 12, 13, LAST + 1]}, "must be a whole number .*, got 4294967296"),
        ({"seed": LAST - COUNT + 2}, "must be a whole number .*, got 4294967296"),
        ({"seed": np.zeros((6, 2), int)}, r"got \[0, 0\]"),
        ({"seed": 5, "options": {"reset_mask": [True, False]}}, "reset_mask must be"),
        ({"seed": 5, "options": {"reset_mask": np.zeros(COUNT, bool)}}, "reset_mask must be"),
    ],
)
def test_a_reset_that_is_refused_changes_nothing(seeded, given, says):
    seeded.reset(seed=1)
    with pytest.raises((LanewiseError, ValueError), match=says):
        seeded.reset(**given)
    info = seeded.reset()[1]
    assert info["seed"].tolist() == list(range(1, 1 + COUNT))
    assert info["start"].tolist() == [1] * COUNT


def test_seeds_of_none_are_drawn_for_each_world_alone():
    env = make()
    observations, info = env.reset(seed=[None] * (COUNT - 1) + [7])
    assert len(set(info["seed"])) == len(np.unique(observations, axis=0)) == COUNT
    assert (info["seed"][-1], set(info["start"])) == (7, {0})
    again = env.reset(seed=[3] + [None] * (COUNT - 1))[1]
    assert again["seed"].tolist() == [3, *info["seed"][1:]]
    assert again["start"].tolist() == [0] + [1] * (COUNT - 1)


def test_numbers_may_be_of_numpy():
    env = make(np.array([2])[0], trap_speed=np.float32(9.0))
    assert (type(env.num_envs), env.num_envs, env.config.scenario.trap_speed) == (int, 2, 9.0)
    for seed in (np.arange(3, 5), np.uint8(3)):
        assert env.reset(seed=seed)[1]["seed"].tolist() == [3, 4]
