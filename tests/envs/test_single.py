"""Environments of one world: what Gymnasium asks of them, seeds, endings, actions, pictures."""

import contextlib
import copy
import dataclasses
import pickle
import warnings
from functools import partial

import gymnasium
import numpy as np
import pytest
from gymnasium.error import ClosedEnvironmentError, ResetNeeded
from gymnasium.utils.env_checker import check_env, data_equivalence
from gymnasium.wrappers import RecordEpisodeStatistics, RecordVideo
from imageio_ffmpeg import count_frames_and_secs

import lanewise
from lanewise import config
from lanewise.config.settings import Settings
from lanewise.driving import observation
from lanewise.envs import keywords, single
from lanewise.envs.registration import ENVIRONMENTS
from lanewise.errors import LanewiseError, SettingsError

SETTINGS = {"duration": 8.0, "vehicles_ahead": 1}
"""Nearly everywhere, so that tests share compiled programs, and these are small."""
IDLE, FASTER = 4, 7
FASTER_BY_ID = {
    "lanewise/TrapGoal-v0": 5,
    "lanewise/TrapContinuous-v0": np.array([1.0, 0.0], np.float32),
}
"""The action that accelerates, where it is not `FASTER`."""
same = partial(data_equivalence, exact=True)


def make(name="lanewise/Trap-v0", **settings):
    return gymnasium.make(name, **SETTINGS | settings)


@pytest.fixture(scope="module", params=ENVIRONMENTS)
def env(request):
    made = make(f"lanewise:{request.param}", render_mode="rgb_array")
    yield made
    made.close()


def drive(env, actions, **reset):
    """Everything that steps return, until the episode's end."""
    found = [env.reset(**reset)]
    for action in actions:
        found.append(env.step(action))
        if found[-1][2] or found[-1][3]:
            break
    return found


def test_gymnasium_has_nothing_to_say(env):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        check_env(env.unwrapped)


def test_a_seed_gives_the_same_episodes_whatever_happened_before(env):
    env.action_space.seed(3)
    actions = [env.action_space.sample() for _ in range(60)]
    first, second = drive(env, actions, seed=7), drive(env, actions)
    drive(env, actions, seed=8)
    again = drive(env, actions, seed=7)
    assert same(again, first)
    assert same(drive(env, actions), second)
    assert not np.array_equal(first[0][0], second[0][0])
    assert not np.array_equal(first[0][0], env.reset(seed=9)[0])
    chosen = drive(env, actions, seed=7, options={"start": 1})
    assert same(chosen, second)


def test_an_episode_that_is_over_wants_a_reset(env):
    faster = FASTER_BY_ID.get(env.spec.id, FASTER)
    last = drive(env, [faster] * 60, seed=1)[-1]
    assert last[2:4] == (True, False)  # into the car ahead
    assert last[4]["accident"] == 1
    assert not last[4]["escaped"]
    assert not last[4]["is_success"]
    assert last[1] < 0
    with pytest.raises(ResetNeeded, match="call reset"):
        env.step(faster)
    env.reset()
    with pytest.raises(ValueError, match="action must be in"):
        env.step(99)


def test_info_tells_of_the_vehicle_ahead(env):
    info = env.reset(seed=1)[1]
    assert (type(info["lane"]), info["lane"]) == (int, 0)
    assert 9.8 <= info["gap_ahead"] <= 11.44  # D1 less a car length
    assert info["time_to_collision"] == np.inf
    faster = FASTER_BY_ID.get(env.spec.id, FASTER)
    closer = env.step(faster)[4]
    assert closer["gap_ahead"] < info["gap_ahead"]
    if "Goal" not in env.spec.id:
        approach = closer["speed"] - 10.0
        assert closer["time_to_collision"] == pytest.approx(closer["gap_ahead"] / approach)


def test_info_of_highway_env_is_its_own():
    env = make("lanewise/TrapHighwayEnv-v0")
    env.reset(seed=2)
    met = 0
    for action in (1, 1, 1, 8, 8, 6, 4, 4, 4, 7):
        info, road = env.step(action)[4], env.unwrapped.highway_env.unwrapped.road
        ego = env.unwrapped.highway_env.unwrapped.vehicle
        front, _ = road.neighbour_vehicles(ego, ego.lane_index)
        assert info["lane"] == ego.lane_index[2]
        gap = np.inf if front is None else front.position[0] - ego.position[0] - 5.0
        assert info["gap_ahead"] == pytest.approx(gap, abs=1e-3)
        met += np.isfinite(gap)
    env.close()
    assert met > 3


def test_pictures_are_drawn_without_a_window(env):
    env.reset(seed=0)
    picture = env.render()
    assert picture.shape == (240, 960, 3)
    assert picture.dtype == np.uint8
    assert len(np.unique(picture.reshape(-1, 3), axis=0)) > 20
    assert env.metadata["render_fps"] == 2


@pytest.mark.parametrize("name", [*ENVIRONMENTS, "many"])
def test_a_closed_environment_says_so(name):
    if name == "many":
        env = gymnasium.make_vec("lanewise/Trap-v0", 2, render_mode="rgb_array", **SETTINGS)
    else:
        env = make(name, render_mode="rgb_array").unwrapped
    env.reset(seed=0)
    for _ in range(2):
        env.close()
    action = env.action_space.sample()
    for call in (env.reset, env.render, lambda: env.step(action)):
        with pytest.raises(ClosedEnvironmentError, match="closed; make a new one"):
            call()


@pytest.mark.parametrize("name", ["lanewise/Trap-v0", "lanewise/TrapHighwayEnv-v0"])
@pytest.mark.parametrize(
    "again", [copy.copy, copy.deepcopy, lambda env: pickle.loads(pickle.dumps(env))]
)
def test_a_copy_goes_its_own_way(name, again):
    env = make(name, render_mode="rgb_array").unwrapped
    env.reset(seed=1)
    env.step(IDLE)
    other = again(env)
    ours = [env.step(action) for action in (5, 5, 7)]
    theirs = [other.step(action) for action in (5, 5, 7)]
    assert same(ours, theirs)
    other.reset(seed=4)
    env.step(IDLE)
    assert env.reset()[1]["seed"] == 1
    other.close()
    env.step(IDLE)


def test_a_video_of_an_episode_whose_time_runs_out_runs_in_real_time(tmp_path):
    env = RecordVideo(make(render_mode="rgb_array"), str(tmp_path / "videos"), disable_logger=True)
    found = drive(RecordEpisodeStatistics(env), [IDLE] * 20, seed=0)
    env.close()
    assert len(found) == 1 + 16
    assert found[-1][2:4] == (False, True)
    # One reward a second is every second decision's.
    rewards = [step[1] for step in found[2::2]]
    assert found[-1][4]["timestep_reward"] == pytest.approx(sum(rewards))
    assert found[-1][4]["episode"]["l"] == 16
    frames, seconds = count_frames_and_secs(str(tmp_path / "videos" / "rl-video-episode-0.mp4"))
    assert (frames, seconds) == (17, pytest.approx(8.5))


def test_decisions_shorter_than_their_frequency_says_fill_the_duration_in_real_time():
    env = gymnasium.make("lanewise/Trap-v0", simulation_frequency=15).unwrapped
    assert env.config.duration == 54
    assert env.metadata["render_fps"] == pytest.approx(15 / 7)
    many = gymnasium.make_vec("lanewise/Trap-v0", num_envs=1, simulation_frequency=15)
    assert many.metadata["render_fps"] == env.metadata["render_fps"]


def test_a_goal_lasts_until_the_critic_ends_it():
    low, high = make(), make("lanewise/TrapGoal-v0")
    assert high.action_space.n == 9
    high.reset(seed=2)
    low.reset(seed=2)
    # Go on: reached with the first decision.
    assert same([high.step(4)[:4]], [low.step(IDLE)[:4]])


def test_full_commands_are_the_low_level_actions():
    low, free = make(), make("lanewise/TrapContinuous-v0")
    for action, command in ((0, (-1, -1)), (5, (0, 1)), (7, (1, 0))):
        low.reset(seed=2)
        free.reset(seed=2)
        ours, theirs = low.step(action), free.step(np.array(command, np.float32))
        assert np.allclose(ours[0], theirs[0], atol=1e-6)
        assert ours[1] == pytest.approx(theirs[1], abs=1e-6)


def test_highway_env_gives_the_same_episode():
    actions = [4, 4, 7, 4, 5, 3, 4, 4, 1, 4, 4]
    ours, theirs = (
        drive(make(name), actions, seed=5)
        for name in ("lanewise/Trap-v0", "lanewise/TrapHighwayEnv-v0")
    )
    assert len(ours) == len(theirs)
    for one, other in zip(ours[1:], theirs[1:], strict=True):
        assert np.allclose(one[0], other[0], atol=1e-4)
        assert one[1] == pytest.approx(other[1], abs=1e-3)
        assert one[2:4] == other[2:4]


def test_settings_by_keyword():
    env = make(trap_speed=9.0, scenario={"ego_speed": 14.0})
    seen, _ = env.reset(seed=0)
    assert seen[3] * 15.0 == pytest.approx(14.0)
    assert seen[observation.LANE_OFFSET + 4] * 5.0 == pytest.approx(9.0 - 14.0)
    task = make(**{"scenario.traffic.spacing": 30.0}).unwrapped.config
    assert task.scenario.traffic.spacing == 30.0
    assert make(scaling="highway-env").observation_space.high.max() == 1.0


@pytest.mark.parametrize(
    ("name", "gained"), [("lanewise/Trap-v0", 0.5), ("lanewise/TrapGoal-v0", 1.0)]
)
def test_noise_and_latency_are_those_of_the_split(name, gained):
    """A test has none, as set; in training a late decision gains less speed."""
    training = {"training_noise": (0.1, 0.1), "training_latency": (0.2, 0.2)}
    faster = FASTER_BY_ID.get(name, FASTER)
    for split, lost in (("test", 0.0), ("training", 0.2)):
        env = make(name, split=split, **training)
        (begun, _), (seen, *_, info) = drive(env, [faster], seed=1)
        assert info["speed"] == pytest.approx(10.0 + gained - lost)
        exact = np.isclose([begun[3] * 15.0, seen[3] * 15.0], [10.0, info["speed"]])
        assert exact.tolist() == [split == "test"] * 2


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ({"trap_speed": 9.0, "scenario.trap_speed": 9.0}, "given twice"),
        ({"split": "train"}, "did you mean training"),
        ({"split": 0}, "split: expected text, one of training, validation, test, got 0"),
        ({"duration": 0}, "duration must be"),
        ({"duration": 4000}, "duration: in 4000 s a vehicle could get"),
        ({"task": 3}, r"task: expected lanewise\.TaskFunctions\(\.\.\.\), got 3"),
        ({"actions": "goal"}, "actions: each kind has an id of its own: .*lanewise/TrapGoal-v0"),
        ({"scenario": 3}, "scenario is a section, not a setting"),
        ({"trap": "trap-11"}, "did you mean trap-10"),
        ({"render_mode": "rgb"}, 'unknown render_mode "rgb"; did you mean rgb_array'),
    ],
)
def test_misspelt_settings_are_refused(given, said):
    with pytest.raises(SettingsError, match=said):
        single.TrapEnv(**given)


SHORT = """
lanes lane_width speed_limit ego_driver ego_speed trap_speed training_ego_speed
training_trap_speed training_lanes training_front_distance training_side_distance
test_front_distance test_side_distance missing_target_speed vehicles_ahead vehicles_behind
spacing spacing_jitter gap_behind simulation_frequency decision_frequency stopped_speed scaling
x_range relative_speed_range perception_distance speed_weight steering_weight centring_weight
accident_penalty validation_episodes validation_interval fresh_episodes populations latency noise
training_latency training_noise training_braking
trap_speed_difference trap_speed_wave trap_wave_period training_trap_speed_difference
training_trap_speed_wave training_traffic_speed training_spacing training_vehicles_ahead
training_vehicles_behind training_gap_behind training_populations
"""
"""The last words that say by themselves what they are; whoever adds a setting judges its own."""


def test_a_short_name_that_may_be_misread_is_refused():
    accepted = set()
    for full, value in config.flatten(Settings()).items():
        last = full.rpartition(".")[2]
        sections = [section.name for section in dataclasses.fields(Settings)]
        with contextlib.suppress(SettingsError):
            keywords.compose("quick", "trap-10", {last: value}, sections)
            accepted.add(last)
        section, _, rest = full.partition(".")
        keywords.compose("quick", "trap-10", {section: {rest: value}}, sections)
    assert accepted == set(SHORT.split())


@pytest.mark.parametrize(
    ("given", "full"),
    [
        ({"driver": {"target_speed": 14.0}}, "scenario.traffic.driver.target_speed"),
        ({"acceleration": 2.0}, "driving.actions.acceleration"),
    ],
)
def test_what_would_be_read_as_the_ego_s_is_given_in_full(given, full):
    (name,) = given
    for use in (
        lambda: gymnasium.make("lanewise/Trap-v0", **given),
        lambda: gymnasium.make_vec("lanewise/Trap-v0", 2, **given),
        lambda: lanewise.evaluate(lambda seen: 4, **given),
        lambda: lanewise.train("never", **given),
    ):
        with pytest.raises(SettingsError, match=rf'"{name}.*" alone .* {full}: give it in full'):
            use()
    composed = keywords.compose("quick", "trap-10", {full: 3.0})
    assert config.flatten(composed)[full] == 3.0
    traffic = {"traffic": {"speed": 9.0, "driver": {"target_speed": 14.0}}}
    scenario = keywords.compose("quick", "trap-10", traffic).scenario
    assert (scenario.traffic.speed, scenario.traffic.driver.target_speed) == (9.0, 14.0)


@pytest.mark.parametrize(
    ("seed", "options"),
    [
        *((seed, None) for seed in (-1, 2**32, 1.5, True, "7", [7])),
        *((7, options) for options in ({"start": -1}, {"start": 2**31}, {"stat": 1}, "start")),
    ],
)
def test_a_reset_that_is_refused_changes_nothing(seed, options):
    env = make().unwrapped
    env.reset(seed=1)
    number = env.np_random.random()
    with pytest.raises(LanewiseError):
        env.reset(seed=seed, options=options)
    info = env.reset()[1]
    assert (info["seed"], info["start"]) == (1, 1)
    env.reset(seed=1)
    assert env.np_random.random() == number


def test_a_seed_may_be_of_numpy_and_of_32_bits():
    env = make()
    assert env.reset(seed=np.int64(7), options={"start": np.int32(2)})[1]["seed"] == 7
    assert not np.array_equal(env.reset(seed=2**32 - 1)[0], env.reset(seed=2**31 - 1)[0])


def test_a_picture_needs_a_mode_and_an_episode_and_a_step_a_reset():
    assert make().unwrapped.render() is None
    env = make("lanewise/TrapContinuous-v0", render_mode="rgb_array").unwrapped
    with pytest.raises(ResetNeeded, match=r"nothing to render: call reset\(\) first"):
        env.render()
    with pytest.raises(ResetNeeded):
        env.step([np.nan, 0.0])


OF_NO_KIND = (None, "0", True, 0j, np.array(0, object), np.timedelta64(0), 2**70, [[0], [0, 0]])
"""Neither whole numbers nor floats, though NumPy makes numbers of most."""
NONE = {
    "lanewise/Trap-v0": (*OF_NO_KIND, np.nan, np.inf, 2.5, 9, -1),
    "lanewise/TrapContinuous-v0": tuple([value, value] for value in OF_NO_KIND) + tuple(
        [0.0, value] for value in
        (np.nan, np.inf, -np.inf, 1.5, -1.001, 1e39, -1e300, np.longdouble("1e4000"))
    ),
}  # fmt: skip
"""Actions that there are not, by kind."""


@pytest.mark.parametrize("name", NONE)
def test_an_action_that_there_is_not_is_refused(name):
    env, many = make(name).unwrapped, gymnasium.make_vec(name, 2, **SETTINGS)
    usual = env.action_space.sample()
    assert env._checked(usual) == pytest.approx(usual)
    for action in NONE[name]:
        with pytest.raises(ValueError, match="action must be in") as refused:
            env._checked(action)
        assert len(str(refused.value).splitlines()) == 1
        with pytest.raises(ValueError, match="actions must be 2 of"):
            many._checked([action, action])


def test_what_rounds_to_the_limit_is_in_range():
    found = make("lanewise/TrapContinuous-v0").unwrapped._checked([1.0 + 1e-12, 0])
    assert found.tolist() == [1.0, 0.0]
