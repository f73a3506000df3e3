import subprocess
import sys
from dataclasses import replace
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from lanewise.driving import accidents, actions, episode
from lanewise.driving.settings import DrivingSettings
from lanewise.evaluation.evaluator import EvaluationConfig, start
from lanewise.scenario import trap
from lanewise.scenario.settings import TrafficSettings, TrapSettings
from lanewise.world import build, road
from lanewise.world.settings import PAPER_DRIVER, TOP_SPEED
from lanewise.world.state import CONSTANT, EXTERNAL, RULE_BASED, World

SETTINGS = TrapSettings()


@partial(jax.jit, static_argnums=(0, 1, 2, 3))
def starts(split, count, settings=SETTINGS, seed=7):
    return jax.vmap(lambda i: trap.sample(settings, trap.start_key(seed, split, i), split))(
        jnp.arange(count)
    )


@partial(jax.jit, static_argnums=(1, 3))
def sample(seed, split, index, settings=SETTINGS):
    return trap.sample(settings, trap.start_key(seed, split, index), split)


def same(a, b):
    return all(
        np.array_equal(x, y) for x, y in zip(jax.tree.leaves(a), jax.tree.leaves(b), strict=True)
    )


@pytest.mark.parametrize(
    "split",
    [
        pytest.param(split, marks=pytest.mark.slow if split == "validation" else ())
        for split in trap.SPLITS
    ],
)
def test_a_start_is_the_same_alone_and_in_any_batch(split):
    many = starts(split, 102)
    config = EvaluationConfig(SETTINGS, DrivingSettings(), None, 50, split)
    # The last is of the second block.
    for index in (0, 1, 101):
        alone = sample(7, split, index)
        assert same(alone, jax.tree.map(lambda leaf: leaf[index], many))  # noqa: B023
        assert same(alone, start(config, 7, index))


def test_a_start_is_the_same_in_another_process():
    code = (
        "from lanewise.scenario import trap; from lanewise.scenario.settings import TrapSettings\n"
        "w = trap.sample(TrapSettings(), trap.start_key(7, 'test', 5), 'test')\n"
        "print(bytes(w.vehicles.x).hex(), bytes(w.vehicles.y).hex())"
    )
    out = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True
    ).stdout
    world = sample(7, "test", 5)
    assert out.split() == [
        np.asarray(part).tobytes().hex() for part in (world.vehicles.x, world.vehicles.y)
    ]


def test_indices_seeds_and_splits_differ():
    def traffic(seed, split, index):
        world = sample(seed, split, index)
        return tuple(np.asarray(world.vehicles.x[3:] - world.vehicles.x[1]))

    seen = {
        traffic(*at) for at in [(0, s, i) for s in trap.SPLITS for i in (0, 1)] + [(1, "test", 0)]
    }
    assert len(seen) == 7


@pytest.mark.parametrize("split", ["training", "validation"])
def test_trap_distances_fill_their_ranges(split):
    x = np.asarray(starts(split, 2000).vehicles.x)
    assert (x[:, 0] == 0).all()
    for distance, (low, high) in ((x[:, 1], (14.80, 16.44)), (x[:, 2], (4.06, 7.43))):
        assert distance.min() >= low - 1e-5
        assert distance.max() <= high + 1e-5
        # Uniform: 2000 draws come within half a percent of both ends, and the mean is the middle.
        assert distance.min() < low + 0.005 * (high - low) + 1e-5
        assert distance.max() > high - 0.005 * (high - low) - 1e-5
        assert distance.mean() == pytest.approx((low + high) / 2, abs=0.03 * (high - low))
    assert abs(np.corrcoef(x[:, 1], x[:, 2])[0, 1]) < 0.1


def test_trap_distances_are_fixed_in_tests():
    x = np.asarray(starts("test", 50).vehicles.x)
    np.testing.assert_allclose(x[:, 1], 15.62, rtol=1e-6)
    np.testing.assert_allclose(x[:, 2], 6.61, rtol=1e-6)


def test_the_trap_stands_in_the_two_leftmost_lanes():
    world = sample(0, "test", 0)
    assert world.vehicles.y[:3].tolist() == [0.0, 0.0, 4.0]
    assert world.vehicles.speed[:3].tolist() == [10.0, 10.0, 10.0]
    assert world.drivers.kind.tolist() == [EXTERNAL, CONSTANT, CONSTANT] + [RULE_BASED] * 9
    assert trap.roles(world).tolist() == [0, 1, 1] + [2] * 9
    assert trap.vehicle_count(SETTINGS) == 12 == world.vehicles.x.shape[0]


@pytest.mark.parametrize("others", [1, 2, 3, 4])
def test_the_ego_must_get_past_as_many_trap_cars_as_there_are(others):
    kinds = [EXTERNAL] + [CONSTANT] * others + [RULE_BASED] * 2
    lane = np.zeros(len(kinds), np.int32)
    x = np.r_[100.0, 90.0 - 10.0 * np.arange(others), 200.0, 300.0]
    world = World(
        road=road.straight_road(3),
        drivers=build.make_drivers([PAPER_DRIVER] * len(kinds), kinds),
        vehicles=build.make_vehicles(x, 0.0 * x, 0.0 * x, lane),
    )
    assert trap.roles(world).tolist() == [0] + [1] * others + [2, 2]
    assert trap.escaped(world)
    for car in range(1, others + 1):
        ahead = world.vehicles.x.at[car].set(120.0)
        there = replace(world, vehicles=replace(world.vehicles, x=ahead))
        assert not trap.escaped(there)
        absent = there.vehicles.present.at[car].set(False)
        assert trap.escaped(replace(there, vehicles=replace(there.vehicles, present=absent)))


def test_trap_cars_keep_their_speed_and_lane_all_episode_long():
    state = episode.begin(sample(3, "test", 0))
    step = jax.jit(partial(episode.step, DrivingSettings()), static_argnums=2)
    first = np.asarray(state.world.vehicles.x[1:3])
    # The ego drives on at the trap's own speed, so that nobody is hit.
    for decision in range(1, 51):
        state = step(state, jnp.int32(actions.IDLE), 50)
        vehicles = state.world.vehicles
        assert vehicles.speed[1:3].tolist() == [10.0, 10.0]
        assert vehicles.y[1:3].tolist() == [0.0, 4.0]
        np.testing.assert_allclose(vehicles.x[1:3], first + 5.0 * decision, rtol=1e-5)
    assert not vehicles.crashed.any()


def test_traffic_spacing_lies_in_its_range():
    world = starts("training", 300)
    x, lane = np.asarray(world.vehicles.x), np.asarray(world.vehicles.target_lane)
    front = x[:, 1:3].max(axis=1)
    first, spacing = x[:, 3] - front, np.diff(x[:, 3:], axis=1)
    assert (np.abs(first - 45.0) <= 5.0 + 1e-3).all()
    assert (np.abs(spacing - 25.0) <= 5.0 + 1e-3).all()
    for gap, mean in ((first, 45.0), (spacing, 25.0)):
        assert gap.max() - mean > 4.5
        assert mean - gap.min() > 4.5
    assert set(lane[:, 3:].ravel()) == {0, 1, 2}
    np.testing.assert_array_equal(np.asarray(world.vehicles.y), 4.0 * lane)
    assert (np.asarray(world.vehicles.speed)[:, 3:] == 12.5).all()


def test_vehicles_behind_stand_behind():
    settings = replace(SETTINGS, traffic=TrafficSettings(vehicles_ahead=2, vehicles_behind=3))
    x = np.asarray(starts("test", 50, settings, 7).vehicles.x)
    assert x.shape == (50, 8) == (50, trap.vehicle_count(settings))
    assert (np.abs(x[:, 5] + 45.0) <= 5.0 + 1e-3).all()
    assert (np.abs(np.diff(x[:, 5:], axis=1) + 25.0) <= 5.0 + 1e-3).all()
    assert (x[:, 3:5] > x[:, 1:2]).all()
    # Gaps ahead and behind are drawn apart.
    gaps = x[:, 3] - np.maximum(x[:, 1], x[:, 2]), x[:, 4] - x[:, 3], -x[:, 5], x[:, 5] - x[:, 6]
    assert np.abs(np.corrcoef(gaps) - np.eye(4)).max() < 0.5


def test_the_missing_target_speed_can_be_switched_off():
    quirk = sample(0, "test", 0)
    plain = sample(0, "test", 0, replace(SETTINGS, missing_target_speed=False))
    assert quirk.drivers.target_speed[:3].tolist() == [0.0, 0.0, 0.0]
    assert plain.drivers.target_speed[:3].tolist() == [10.0, 10.0, 10.0]
    np.testing.assert_array_equal(quirk.drivers.target_speed[3:], [12.5] * 9)
    np.testing.assert_array_equal(plain.drivers.target_speed[3:], [12.5] * 9)


def test_settings_reach_the_road():
    settings = TrapSettings(
        lanes=4,
        lane_width=3.5,
        speed_limit=25.0,
        ego_speed=11.0,
        trap_speed=9.0,
        test_front_distance=20.0,
        test_side_distance=-3.0,
        traffic=TrafficSettings(vehicles_ahead=0),
    )
    world = sample(0, "test", 0, settings)
    np.testing.assert_allclose(world.road.centre, [0.0, 3.5, 7.0, 10.5])
    np.testing.assert_allclose(world.road.speed_limit, 25.0)
    np.testing.assert_allclose(world.vehicles.x, [0.0, 20.0, -3.0])
    np.testing.assert_allclose(world.vehicles.y, [0.0, 0.0, 3.5])
    np.testing.assert_allclose(world.vehicles.speed, [11.0, 9.0, 9.0])


CROWDED = TrafficSettings(vehicles_ahead=100, vehicles_behind=100, spacing=200.0)


@pytest.mark.parametrize(
    "settings",
    [TrapSettings(), TrapSettings(test_side_distance=-200.0), TrapSettings(traffic=CROWDED)],
    ids=["default", "trap car behind", "crowded"],
)
def test_everybody_stands_on_a_lane_as_far_as_a_drive_can_go(settings):
    world = trap.sample(settings, trap.start_key(0, "test", 0), "test")
    vehicles = world.vehicles
    longest = TOP_SPEED * 1600.0
    for drive in (0.0, longest, -longest):
        x = vehicles.x + drive
        assert (np.asarray(road.occupied_lanes(world.road, x, vehicles.y)) > 0).all()
        assert (np.asarray(road.reachable_lanes(world.road, x, vehicles.y)) > 0).all()
        there = replace(world, vehicles=replace(vehicles, x=x))
        assert not accidents.off_road(there)
