import jax
import jax.numpy as jnp
import numpy as np
import pytest
from driving_worlds import world_of

from lanewise.driving import observation, percept
from lanewise.driving.settings import ObservationSettings
from lanewise.driving.task_functions import TaskFunctions
from lanewise.interop.highway_env import build_env

THEIRS = ObservationSettings(scaling="highway-env")
FINE = ObservationSettings(scaling="fine")
FEATURES = jax.jit(observation.features, static_argnums=0)


@pytest.fixture(autouse=True)
def float64():
    with jax.enable_x64(True):
        yield


def rows_of(features):
    """The features as highway-env's table, without the lane offset."""
    return np.delete(np.asarray(features), observation.LANE_OFFSET).reshape(5, 5)


def assert_equal_to_highway_env(world):
    env = build_env(world)
    np.testing.assert_allclose(
        rows_of(FEATURES(THEIRS, world)), env.observation_type.observe(), atol=1e-6
    )
    env.close()


def random_world(rng, count, lanes=3):
    return world_of(
        rng.uniform(0.0, 60.0) + np.concatenate([[0.0], rng.uniform(-60.0, 260.0, count - 1)]),
        rng.uniform(-1.0, 4.0 * lanes - 3.0, count),
        rng.uniform(0.0, 30.0, count),
        rng.uniform(-0.5, 0.5, count),
        lanes=lanes,
        dtype=np.float64,
    )


@pytest.mark.parametrize(("lanes", "count"), [(2, 3), (4, 12)])
def test_observation_is_highway_envs_kinematics_on_random_worlds(lanes, count):
    rng = np.random.default_rng(count)
    for _ in range(20):
        assert_equal_to_highway_env(random_world(rng, count, lanes))


@pytest.mark.parametrize("count", [1, 3])
def test_fewer_than_four_others_leave_zero_rows(count):
    x = 10.0 * np.arange(count)
    world = world_of(x, np.zeros(count), np.full(count, 9.0), dtype=np.float64)
    assert_equal_to_highway_env(world)
    rows = rows_of(FEATURES(THEIRS, world))
    np.testing.assert_array_equal(rows[:, 0], [1.0] * count + [0.0] * (5 - count))
    assert not rows[count:].any()


@pytest.mark.parametrize("along", [-10.1, -10.0, -9.9, 199.9, 200.0, 200.1])
def test_the_edges_of_sight_are_highway_envs(along):
    world = world_of([20.0, 20.0 + along], [4.0, 4.0], [10.0, 12.0], dtype=np.float64)
    assert_equal_to_highway_env(world)
    seen = rows_of(FEATURES(THEIRS, world))[1, 0] == 1.0
    assert seen == (-10.0 < along < 200.0)


def test_ties_keep_the_order_of_the_list():
    x = [50.0, 60.0, 45.0, 60.0, 55.0, 55.0, 70.0]
    y = [4.0, 0.0, 8.0, 8.0, 8.0, 0.0, 0.0]
    speed = [10.0, 11.0, 12.0, 13.0, 14.0, 15.0, 16.0]
    world = world_of(x, y, speed, dtype=np.float64)
    assert_equal_to_highway_env(world)
    indices, found = observation.nearest(world, 200.0)
    assert indices.tolist() == [2, 4, 5, 1]
    assert found.all()


def test_features_are_26_and_the_lane_offset_follows_the_ego():
    world = world_of([0.0, 10.0], [4.7, 0.0], [10.0, 10.0], dtype=np.float64)
    for settings in (THEIRS, FINE):
        features = FEATURES(settings, world)
        assert features.shape == (26,) == (observation.SIZE,)
        assert float(features[5]) == pytest.approx(0.7 / 2.0)
        np.testing.assert_allclose(features[5], percept.perceive(settings, world).features[5])


def test_the_percepts_lane_is_the_nearest_and_not_the_one_aimed_at():
    world = world_of([5.0], [6.5], [10.0], dtype=np.float64)
    aims = world.vehicles.__class__(**{**vars(world.vehicles), "target_lane": jnp.zeros(1, int)})
    world = world.__class__(world.road, world.drivers, aims)
    seen = percept.perceive(FINE, world, TaskFunctions(observe=lambda *_: jnp.zeros(1)))
    assert int(seen.lane) == 2
    assert (float(seen.x), float(seen.y), float(seen.speed)) == (5.0, 6.5, 10.0)


def test_lane_offset_is_to_the_nearest_lane_and_positive_to_the_right():
    for y, offset in [(0.0, 0.0), (1.5, 1.5), (2.5, -1.5), (-1.0, -1.0), (9.0, 1.0)]:
        world = world_of([5.0], [y], [10.0], dtype=np.float64)
        assert float(observation.lane_offset(world)) == pytest.approx(offset)


def test_fine_scaling_in_closed_form():
    world = world_of([100.0, 130.0, 94.0], [4.0, 8.0, 0.0], [12.0, 10.0, 25.0], dtype=np.float64)
    rows = rows_of(FEATURES(FINE, world))
    np.testing.assert_allclose(rows[0], [1.0, 0.5, 4.0 / 12.0, 12.0 / 15.0, 0.0])
    np.testing.assert_allclose(rows[1], [1.0, -6.0 / 60.0, -4.0 / 12.0, 2.0, 0.0])
    np.testing.assert_allclose(rows[2], [1.0, 30.0 / 60.0, 4.0 / 12.0, -2.0 / 5.0, 0.0])


def test_absent_vehicles_are_not_seen():
    world = world_of([0.0, 10.0, 20.0], [4.0, 4.0, 4.0], [10.0] * 3, dtype=np.float64)
    present = jnp.asarray([True, False, True])
    vehicles = world.vehicles.__class__(**{**vars(world.vehicles), "present": present})
    rows = rows_of(FEATURES(THEIRS, world.__class__(world.road, world.drivers, vehicles)))
    assert rows[1, 1] == pytest.approx(20.0 / 200.0)
    assert not rows[2:].any()
