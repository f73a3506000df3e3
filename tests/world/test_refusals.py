import pytest
from highway_env.envs import HighwayEnv, MergeEnv
from highway_env.vehicle.behavior import AggressiveVehicle, IDMVehicle, LinearVehicle
from highway_env.vehicle.kinematics import Vehicle
from highway_env.vehicle.objects import Obstacle

from lanewise.errors import SettingsError
from lanewise.interop.highway_env import build_env, read_world
from lanewise.world import build
from lanewise.world.settings import PAPER_DRIVER
from lanewise.world.state import CONSTANT, RULE_BASED


@pytest.fixture
def env():
    live = HighwayEnv(config={"vehicles_count": 3, "action": {"type": "DiscreteAction"}})
    live.reset(seed=0)
    return live


def test_a_road_that_is_no_straight_road():
    with pytest.raises(SettingsError, match="roads"):
        read_world(MergeEnv(config={"action": {"type": "DiscreteAction"}}))


def test_obstacles(env):
    env.road.objects.append(Obstacle(env.road, [50, 0]))
    with pytest.raises(SettingsError, match="obstacles"):
        read_world(env)


def test_connected_lanes(env):
    env.road.neighbour_vehicles_connected_lanes = True
    with pytest.raises(SettingsError, match="connected_lanes"):
        read_world(env)


@pytest.mark.parametrize("kind", [LinearVehicle, AggressiveVehicle])
def test_other_drivers(env, kind):
    env.road.vehicles.append(kind(env.road, [300, 0], 0, 20))
    with pytest.raises(SettingsError, match="changes"):
        read_world(env)


def test_an_ego_with_meta_actions():
    with pytest.raises(SettingsError, match="MDPVehicle"):
        read_world(HighwayEnv(config={"vehicles_count": 1}))


def test_routes(env):
    env.road.vehicles.append(IDMVehicle(env.road, [300, 0], route=[("0", "1", 0)]))
    with pytest.raises(SettingsError, match="route"):
        read_world(env)


def test_an_ego_that_nobody_drives(make_world):
    with pytest.raises(SettingsError, match="vehicle 0"):
        build_env(make_world([0, 50], [0, 0], kinds=[CONSTANT, RULE_BASED]))


def test_plain_vehicles_are_read(env):
    env.road.vehicles.append(Vehicle(env.road, [300, 0], 0, 20))
    assert read_world(env).drivers.kind.tolist() == [0, 2, 2, 2, 1]


def test_too_many_vehicles(make_world):
    with pytest.raises(SettingsError, match="do not fit"):
        make_world([0, 50], [0, 0], maximum=1)
    with pytest.raises(SettingsError, match="2 vehicles"):
        build.make_drivers([PAPER_DRIVER], [0, 1])
