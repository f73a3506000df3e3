import jax
import numpy as np
import pytest

from lanewise.driving import accidents
from lanewise.interop.highway_env import build_env
from small_worlds import change, make_world

pytestmark = pytest.mark.usefixtures("float64")
OF_EGO = jax.jit(accidents.ego_accident)
OFF_ROAD = jax.jit(accidents.off_road)


def code(y=4.0, speed=10.0, crashed=(False, False)):
    world = make_world([50.0, 90.0], [1, 1], speed, y=[y, 4.0], kinds=[0, 1])
    return int(OF_EGO(change(world, crashed=crashed), 0.1))


def test_each_accident_has_its_code_and_the_first_of_the_list_is_reported():
    wreck = (True, False)
    assert code() == accidents.NONE
    assert code(crashed=(False, True)) == accidents.NONE  # another's
    assert code(crashed=wreck) == code(y=-2.1, speed=0.0, crashed=wreck) == accidents.COLLISION
    assert code(speed=0.0, crashed=wreck) == accidents.COLLISION
    assert code(y=-2.1) == code(y=-2.1, speed=0.0) == accidents.OFF_ROAD
    assert code(speed=0.05) == accidents.STOPPED


@pytest.mark.parametrize(
    ("speed", "stopped"), [(0.11, False), (0.1, False), (0.09, True), (-1.0, True)]
)
def test_stopped_is_below_the_threshold(speed, stopped):
    assert (code(speed=speed) == accidents.STOPPED) == stopped


def test_off_road_is_highway_envs_on_road():
    """Compared at random places around a road of three lanes, its ends and edges included."""
    rng = np.random.default_rng(1)
    x = np.concatenate([rng.uniform(-10, 60, 40), [-5.1, -4.9, 10_004.9, 10_005.1, 9_999.0]])
    y = np.concatenate([rng.uniform(-4, 12, 40), np.full(5, 4.0)])
    edges = np.array([-2.0, -2.001, -1.999, 10.0, 10.001, 9.999])
    x, y = np.concatenate([x, np.full(6, 30.0)]), np.concatenate([y, edges])
    outcomes = set()
    for place in zip(x, y, strict=True):
        world = make_world([place[0]], [1], 10.0, y=[place[1]])
        there = build_env(world).vehicle.on_road
        assert bool(OFF_ROAD(world)) == (not there), place
        outcomes.add(there)
    assert outcomes == {True, False}
