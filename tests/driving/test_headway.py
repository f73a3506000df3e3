"""The headway against highway-env's own neighbours, and where there is none."""

import jax
import numpy as np
import pytest

from lanewise.driving import headway
from lanewise.interop.highway_env import build_env
from small_worlds import change, make_world, scattered

OF_EGO = jax.jit(headway.of_ego)


@pytest.mark.parametrize("count", [2, 8])
def test_the_vehicle_ahead_is_highway_env_s_neighbour(count):
    rng, met, closing = np.random.default_rng(count), 0, 0
    for _ in range(40):
        world = scattered(rng, count)
        found, env = OF_EGO(world), build_env(world)
        ego = env.vehicle
        assert found.lane == ego.lane_index[2]
        front, _ = env.road.neighbour_vehicles(ego, ego.lane_index)
        gap, seconds = np.inf, np.inf
        if front is not None:
            met += 1
            gap = front.position[0] - ego.position[0] - (front.LENGTH + ego.LENGTH) / 2
            approach = ego.velocity[0] - front.velocity[0]
            closing += approach > 0
            seconds = max(gap, 0.0) / approach if approach > 0 else np.inf
        assert found.gap == pytest.approx(gap, abs=1e-3)
        assert found.time_to_collision == pytest.approx(seconds, rel=1e-3, abs=1e-3)
        env.close()
    assert met > 5
    assert met > closing > 2


def test_nobody_counts_who_is_behind_elsewhere_or_absent():
    world = make_world([50.0, 40.0, 70.0, 80.0], [1, 1, 0, 1], 10.0, kinds=[0, 1, 1, 1], size=8)
    assert (OF_EGO(world).lane, OF_EGO(world).gap) == (1, 25.0)
    assert OF_EGO(world).time_to_collision == np.inf  # as fast as the ego
    alone = OF_EGO(change(world, present=[True, True, True, False]))
    assert (alone.gap, alone.time_to_collision) == (np.inf, np.inf)


def test_time_until_the_gap_is_gone():
    world = make_world([0.0, 25.0], [1, 1], [14.0, 9.0], kinds=[0, 1], size=8)
    found = OF_EGO(world)
    assert (found.gap, found.time_to_collision) == (20.0, 4.0)
    beside = OF_EGO(change(world, x=[0.0, 3.0], y=[4.0, 6.5]))
    assert (beside.gap, beside.time_to_collision) == (-2.0, 0.0)
    # Between two lanes the slower of two who are level counts.
    level = make_world([0.0, 25.0, 25.0], [1, 0, 2], [14.0, 4.0, 9.0], y=[4.0, 1.5, 6.5],
                       kinds=[0, 1, 1], size=8)  # fmt: skip
    assert OF_EGO(level).time_to_collision == 2.0
