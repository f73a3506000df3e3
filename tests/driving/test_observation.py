import jax
import jax.numpy as jnp
import numpy as np
import pytest

from lanewise.driving import observation, percept
from lanewise.driving.settings import ObservationSettings
from lanewise.driving.task_functions import TaskFunctions
from lanewise.interop import highway_env_evaluation
from lanewise.interop.highway_env import build_env
from small_worlds import change, make_world

pytestmark = pytest.mark.usefixtures("float64")
THEIRS = ObservationSettings(scaling="highway-env")
FINE = ObservationSettings(scaling="fine")
FEATURES = jax.jit(observation.features, static_argnums=0)
COUNT = 12


def world_of(x, y, speed, heading=0.0, lanes=3):
    """Vehicles as listed, the first one the ego, the others at constant commands."""
    lane = np.clip(np.round(np.asarray(y) / 4.0), 0, lanes - 1)
    kinds = [0] + [1] * (len(x) - 1)
    return make_world(x, lane, speed, y=y, kinds=kinds, heading=heading, lanes=lanes, size=COUNT)


def rows_of(features):
    """The features as highway-env's table, without the lane offset."""
    return np.delete(np.asarray(features), observation.LANE_OFFSET).reshape(5, 5)


def observed(world):
    """Our rows, which are highway-env's."""
    rows, env = rows_of(FEATURES(THEIRS, world)), build_env(world)
    np.testing.assert_allclose(rows, env.observation_type.observe(), atol=1e-6)
    env.close()
    return rows


@pytest.mark.parametrize(("lanes", "count"), [(2, 3), (4, COUNT)])
def test_observation_is_highway_envs_kinematics_on_random_worlds(lanes, count):
    rng = np.random.default_rng(count)
    for _ in range(20):
        others = np.concatenate([[0.0], rng.uniform(-60.0, 260.0, count - 1)])
        y = rng.uniform(-1.0, 4.0 * lanes - 3.0, count)
        speed, heading = rng.uniform(0.0, 30.0, count), rng.uniform(-0.5, 0.5, count)
        observed(world_of(rng.uniform(0.0, 260.0) + others, y, speed, heading, lanes))


def test_features_that_somebody_edited_leave_the_comparison_with_highway_env(monkeypatch):
    world = world_of([0.0, 12.0], [0.0, 4.0], 9.0)
    ours = rows_of(FEATURES(THEIRS, world))
    monkeypatch.setattr(observation, "features", lambda settings, world: jnp.zeros(27))
    batch = jax.tree.map(lambda leaf: leaf[None], world)
    found = highway_env_evaluation._expected(batch)
    np.testing.assert_allclose(found, ours[None], atol=1e-12)


@pytest.mark.parametrize("count", [1, 3])
def test_fewer_than_four_others_leave_zero_rows(count):
    rows = observed(world_of(10.0 * np.arange(count), np.zeros(count), 9.0))
    np.testing.assert_array_equal(rows[:, 0], [1.0] * count + [0.0] * (5 - count))
    assert not rows[count:].any()


@pytest.mark.parametrize("along", [-10.1, -10.0, -9.9, 199.9, 200.0, 200.1])
def test_the_edges_of_sight_are_highway_envs(along):
    rows = observed(world_of([20.0, 20.0 + along], [4.0, 4.0], [10.0, 12.0]))
    assert (rows[1, 0] == 1.0) == (-10.0 < along < 200.0)


def test_ties_keep_the_order_of_the_list():
    x = [50.0, 60.0, 45.0, 60.0, 55.0, 55.0, 70.0]
    y = [4.0, 0.0, 8.0, 8.0, 8.0, 0.0, 0.0]
    rows = observed(world_of(x, y, np.arange(10.0, 17.0)))
    # The speeds over the ego's tell who is who.
    np.testing.assert_allclose(rows[1:, 3] * 80.0, [2.0, 4.0, 5.0, 1.0])


def test_features_are_26_and_the_lane_offset_follows_the_ego():
    world = world_of([0.0, 10.0], [4.7, 0.0], 10.0)
    for settings in (THEIRS, FINE):
        features = FEATURES(settings, world)
        assert features.shape == (26,) == (observation.SIZE,)
        assert float(features[5]) == pytest.approx(0.7 / 2.0)


def test_the_percepts_lane_is_the_nearest_and_not_the_one_aimed_at():
    world = change(world_of([5.0], [6.5], 10.0), target_lane=0)
    task = TaskFunctions(observe=lambda *_: jnp.zeros(1))
    seen = jax.jit(lambda world: percept.perceive(FINE, world, task))(world)
    assert int(seen.lane) == 2
    assert (float(seen.x), float(seen.y), float(seen.speed)) == (5.0, 6.5, 10.0)


def test_lane_offset_is_to_the_nearest_lane_and_positive_to_the_right():
    for y, offset in [(0.0, 0.0), (1.5, 1.5), (2.5, -1.5), (-1.0, -1.0), (9.0, 1.0)]:
        found = FEATURES(FINE, world_of([5.0], [y], 10.0))[observation.LANE_OFFSET]
        assert float(found) == pytest.approx(offset / 2.0)


def test_fine_scaling_in_closed_form():
    world = world_of([100.0, 130.0, 94.0], [4.0, 8.0, 0.0], [12.0, 10.0, 25.0])
    rows = rows_of(FEATURES(FINE, world))
    np.testing.assert_allclose(rows[0], [1.0, 0.5, 4.0 / 12.0, 12.0 / 15.0, 0.0])
    np.testing.assert_allclose(rows[1], [1.0, -6.0 / 60.0, -4.0 / 12.0, 2.0, 0.0])
    np.testing.assert_allclose(rows[2], [1.0, 30.0 / 60.0, 4.0 / 12.0, -2.0 / 5.0, 0.0])
