from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from driving_worlds import world_of

from lanewise.driving import accidents
from lanewise.interop.highway_env import build_env


def ego_world(y=4.0, speed=10.0, crashed=False, x=50.0):
    world = world_of([x], [y], [speed])
    vehicles = replace(world.vehicles, crashed=jnp.asarray([crashed]))
    return replace(world, vehicles=vehicles)


OF_EGO = jax.jit(accidents.ego_accident)
OFF_ROAD = jax.jit(accidents.off_road)


def code(world):
    return int(OF_EGO(world, 0.1))


def test_each_accident_has_its_code():
    assert code(ego_world()) == accidents.NONE
    assert code(ego_world(crashed=True)) == accidents.COLLISION
    assert code(ego_world(y=-2.1)) == accidents.OFF_ROAD
    assert code(ego_world(speed=0.05)) == accidents.STOPPED


def test_the_first_of_the_list_is_reported():
    assert code(ego_world(y=-2.1, speed=0.0, crashed=True)) == accidents.COLLISION
    assert code(ego_world(y=-2.1, speed=0.0)) == accidents.OFF_ROAD
    assert code(ego_world(speed=0.0, crashed=True)) == accidents.COLLISION


@pytest.mark.parametrize(
    ("speed", "stopped"), [(0.11, False), (0.1, False), (0.09, True), (-1.0, True)]
)
def test_stopped_is_below_the_threshold(speed, stopped):
    assert (code(ego_world(speed=speed)) == accidents.STOPPED) == stopped


def test_another_vehicles_crash_is_no_accident_of_the_ego():
    world = world_of([50.0, 90.0], [4.0, 4.0], [10.0, 10.0])
    vehicles = replace(world.vehicles, crashed=jnp.asarray([False, True]))
    assert code(replace(world, vehicles=vehicles)) == accidents.NONE


def test_off_road_is_highway_envs_on_road():
    """Compared at random places around a road of three lanes, its ends and edges included."""
    rng = np.random.default_rng(1)
    x = np.concatenate([rng.uniform(-10, 60, 40), [-5.1, -4.9, 10_004.9, 10_005.1, 9_999.0]])
    y = np.concatenate([rng.uniform(-4, 12, 40), np.full(5, 4.0)])
    edges = np.array([-2.0, -2.001, -1.999, 10.0, 10.001, 9.999])
    x, y = np.concatenate([x, np.full(6, 30.0)]), np.concatenate([y, edges])
    with jax.enable_x64(True):
        outcomes = set()
        for place in zip(x, y, strict=True):
            world = world_of([place[0]], [place[1]], [10.0], dtype=np.float64)
            env = build_env(world)
            assert bool(OFF_ROAD(world)) == (not env.vehicle.on_road), place
            outcomes.add(env.vehicle.on_road)
    assert outcomes == {True, False}
