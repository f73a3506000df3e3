"""What our world does not represent is refused by name, when highway-env is read or built."""

import re
from contextlib import nullcontext
from functools import partial

import gymnasium as gym
import jax
import numpy as np
import pytest
from highway_env.envs import HighwayEnv, MergeEnv
from highway_env.road.lane import StraightLane
from highway_env.road.regulation import RegulatedRoad
from highway_env.vehicle.behavior import (
    AggressiveVehicle,
    DefensiveVehicle,
    IDMVehicle,
    LinearVehicle,
)
from highway_env.vehicle.controller import ControlledVehicle
from highway_env.vehicle.dynamics import BicycleVehicle
from highway_env.vehicle.kinematics import Vehicle
from highway_env.vehicle.objects import Obstacle
from highway_env.vehicle.uncertainty.estimation import MultipleModelVehicle
from highway_env.vehicle.uncertainty.prediction import IntervalVehicle

from lanewise.driving.settings import DrivingSettings
from lanewise.errors import SettingsError
from lanewise.interop import highway_env_evaluation
from lanewise.interop.highway_env import build_env, command_table, read_world
from lanewise.world import build
from lanewise.world.settings import (
    AGGRESSIVE_DRIVER,
    DEFENSIVE_DRIVER,
    HIGHWAY_ENV_DRIVER,
    LINEAR_DRIVER,
)
from lanewise.world.state import CONSTANT, EXTERNAL, RULE_BASED
from small_worlds import change, make_world, taken


def live(**config):
    env = HighwayEnv(config={"vehicles_count": 3, "action": {"type": "DiscreteAction"}} | config)
    env.reset(seed=0)
    return env


@pytest.fixture
def env():
    return live()


def several(count, kind="MultiAgentAction"):
    """An environment with so many controlled vehicles."""
    action = {"type": kind, "action_config": {"type": "DiscreteAction"}}
    return live(action=action, controlled_vehicles=count, vehicles_count=2 * count)


def in_another_order():
    env = several(2)
    env.controlled_vehicles.reverse()
    env.define_spaces()
    return env


def with_vehicle(kind):
    return lambda env: env.road.vehicles.append(kind(env.road, [300, 0], 0, 20))


def with_class(base, **defined):
    """Another vehicle on the road, of a class of its own."""
    return with_vehicle(type("Own", (base,), defined))


def with_attribute(name, value, which=1):
    """The ego (0) or a driver (1) with another attribute, set on the object."""
    return lambda env: setattr(env.road.vehicles[which], name, value)


def with_lane(name, value):
    return lambda env: setattr(env.road.network.get_lane(("0", "1", 1)), name, value)


def with_config(**config):
    return lambda env: env.config.update(config)


def with_lanes(count):
    def more(env):
        for lane in range(4, count):
            env.road.network.add_lane("0", "1", StraightLane([0, 4 * lane], [1e4, 4 * lane]))

    return more


def with_class_of(part, base, **defined):
    """The environment or its road as one of a class of its own."""

    def other(env):
        changed = env if part == "env" else env.road
        changed.__class__ = type("Own", (base,), defined) if defined else base

    return other


def nothing(*args, **kwargs):
    return None


def with_unlimited_lane_and_negative_speed(env):
    with_lane("speed_limit", None)(env)
    with_attribute("target_speed", -5.0)(env)


def with_zero_target_beside_linear(env):
    with_vehicle(LinearVehicle)(env)
    with_attribute("target_speed", 0.0, 0)(env)


REFUSED = {
    # The environment and its actions.
    "own step": (with_class_of("env", HighwayEnv, step=nothing), "Own with its own step"),
    "patched _simulate": (lambda env: setattr(env, "_simulate", nothing), "_simulate"),
    "no ticks": (with_config(policy_frequency=20), "0 ticks"),
    "patched action": (lambda env: setattr(env.action_type, "act", nothing), "own act"),
    "uncontrolled ego": (lambda env: env.controlled_vehicles.clear(), "drive 1 of 0"),
    "ego off the list": (lambda env: env.road.vehicles.pop(0), "not on the road"),
    "controlled driver": (
        lambda env: setattr(env, "vehicle", env.road.vehicles[2]), "decides twice"
    ),
    # The road.
    "regulated road": (
        with_class_of("road", RegulatedRoad), "RegulatedRoad with its own step"
    ),
    "patched road": (lambda env: setattr(env.road, "neighbour_vehicles", nothing), "neighbour_veh"),
    "obstacles": (lambda env: env.road.objects.append(Obstacle(env.road, [50, 0])), "obstacles"),
    "connected lanes": (
        lambda env: setattr(env.road, "neighbour_vehicles_connected_lanes", True), "connected_lanes"
    ),
    "32 lanes": (with_lanes(32), "32 lanes"),
    "patched lane": (with_lane("is_reachable_from", nothing), "is_reachable_from"),
    "stretched lane": (with_lane("end", np.array([5e3, 4.0])), "straight along x"),
    "negative speed without limit": (with_unlimited_lane_and_negative_speed, "negative target"),
    # Classes of vehicles.
    "interval": (with_vehicle(IntervalVehicle), "own handle_collisions, step.* Linear"),
    "several models": (with_vehicle(MultipleModelVehicle), "MultipleModelVehicle with its own act"),
    "two gains": (
        with_class(LinearVehicle, ACCELERATION_PARAMETERS=[0.3, 2.0]), "ACCELERATION_PARAMETERS"
    ),
    "gain of nan": (
        with_class(LinearVehicle, STEERING_PARAMETERS=[5.0, float("nan")]), "STEERING_PARAM"
    ),
    "target speed of 0 beside linear": (
        with_zero_target_beside_linear, "target_speed of 0 beside a LinearVehicle"
    ),
    "controlled": (with_vehicle(ControlledVehicle), "cannot be read; use Vehicle, IDM"),
    "bicycle": (with_vehicle(BicycleVehicle), "BicycleVehicle with its own step, clip_actions"),
    **{
        f"class with {name}": (with_class(base, **{name: value}), f"its own {name}")
        for base, name, value in (
            (Vehicle, "MAX_SPEED", 20.0),
            (Vehicle, "clip_actions", nothing),
            (IDMVehicle, "velocity", property(lambda self: np.zeros(2))),
            (IDMVehicle, "DELTA", property(lambda self: 0, nothing)),
            (AggressiveVehicle, "acceleration_features", nothing),
            (LinearVehicle, "KP_LATERAL", 1.0),
        )
    },
    # Vehicles.
    "own top speed": (with_attribute("MAX_SPEED", 20.0, 0), "its own MAX_SPEED"),
    "patched vehicle": (with_attribute("mobil", nothing), "its own mobil"),
    "stale diagonal": (with_attribute("LENGTH", 12.0), "diagonal"),
    "not collidable": (with_attribute("collidable", False), "collidable"),
    "steering beyond pi/2": (with_attribute("MAX_STEERING_ANGLE", 1.6), "MAX_STEERING_ANGLE"),
    "comfort of 0": (with_attribute("COMFORT_ACC_MAX", 0.0), "COMFORT_ACC_MAX"),
    "parameter of nan": (with_attribute("TIME_WANTED", float("nan")), "TIME_WANTED"),
    "speed of inf": (with_attribute("speed", float("inf"), 0), "speed"),
    "place by hand": (
        lambda env: env.road.vehicles[1].position.__setitem__(1, 12.0), "lane_index"
    ),
    "route": (with_attribute("route", [("0", "1", 0)]), "route"),
    "target off the road": (with_attribute("target_lane_index", ("0", "1", 4)), "target_lane"),
}  # fmt: skip


@pytest.mark.parametrize(("change", "message"), REFUSED.values(), ids=REFUSED.keys())
def test_what_is_not_represented_is_refused_by_name(env, change, message):
    read_world(env)
    change(env)
    with pytest.raises(SettingsError, match=message):
        read_world(env)


def continuous(**more):
    return live(action={"type": "ContinuousAction"} | more)


WORKS = re.escape('config={"action": {"type": "DiscreteAction"}}, or "ContinuousAction"')


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: continuous(speed_range=(0, 20)), "speed_range"),
        (lambda: continuous(dynamical=True), "BicycleVehicle"),
        (lambda: HighwayEnv(config={"vehicles_count": 1}), f"DiscreteMetaAction.*{WORKS}"),
        (lambda: several(2, "DiscreteAction"), "drive 1 of 2"),
        (in_another_order, "another order"),
        (lambda: gym.make("CartPole-v1"), "CartPole"),
        (lambda: MergeEnv(config={"action": {"type": "DiscreteAction"}}), "roads"),
    ],
)
def test_environments_that_are_not_represented(make, message):
    with pytest.raises(SettingsError, match=message):
        read_world(make())


def test_classes_of_highway_env_changed_in_place(env, monkeypatch):
    monkeypatch.setattr(Vehicle, "MAX_SPEED", 20.0)
    with pytest.raises(SettingsError, match="its own MAX_SPEED"):
        read_world(env)


def test_what_is_known_is_accepted(env):
    """Numbers that are read, ways to begin, and what highway-env never asks for."""

    class Own(IDMVehicle):
        LENGTH, COMFORT_ACC_MAX, DELTA_RANGE = 9.0, 1.0, (1.0, 2.0)
        nickname = "own"

        def randomize_behavior(self):
            self.POLITENESS = 0.3

        def greet(self):
            return self.nickname

    with_vehicle(Vehicle)(env)
    own = Own.create_random(env.road)
    own.randomize_behavior()
    own.color = (1, 2, 3)
    env.road.vehicles.append(own)
    with_attribute("MAX_SPEED", 40.0, 0)(env)
    with_lane("speed_limit", None)(env)
    with_lanes(31)(env)
    world = read_world(env)
    assert world.drivers.kind.tolist() == [0, 2, 2, 2, 1, 2]
    assert world.drivers.length[-1] == 9.0
    assert world.drivers.politeness[-1] == 0.3
    assert world.road.speed_limit[1] == np.inf
    assert len(set(world.drivers.exponent[1:4])) == 3


@pytest.mark.parametrize(
    ("kind", "settings"),
    [
        (IDMVehicle, HIGHWAY_ENV_DRIVER),
        (LinearVehicle, LINEAR_DRIVER),
        (AggressiveVehicle, AGGRESSIVE_DRIVER),
        (DefensiveVehicle, DEFENSIVE_DRIVER),
    ],
)
def test_drivers_of_highway_env_as_settings(env, kind, settings):
    env.road.vehicles.append(kind(env.road, [300, 0], 0, 20, target_speed=22.5))
    theirs = taken(read_world(env).drivers, slice(-1, None))
    ours = build.make_drivers([settings], [RULE_BASED])
    assert (theirs.linear is None) == (settings.model == "idm")
    jax.tree.map(partial(np.testing.assert_allclose, rtol=1e-6), ours, theirs)


def test_linear_drivers_have_gains_of_their_own(env):
    """Given by a class, an object, or at random; also those who have other classes' gains."""

    class Own(DefensiveVehicle):
        ACCELERATION_PARAMETERS, COMFORT_ACC_MAX = (0.1, 0.2, 0.4), 1.0

    with_vehicle(Own)(env)
    with_vehicle(AggressiveVehicle)(env)
    for _ in range(2):
        drawn = AggressiveVehicle.create_random(env.road)
        drawn.randomize_behavior()
        env.road.vehicles.append(drawn)
    world = read_world(env)
    linear = world.drivers.linear
    assert linear.applies.tolist() == [False] * 4 + [True] * 4
    assert linear.gap_gain[:6].tolist() == [2.0] * 4 + [0.4, 0.5]
    assert len(set(linear.gap_gain[4:])) == len(set(linear.heading_gain[5:])) + 1 == 4
    jax.tree.map(np.testing.assert_array_equal, read_world(build_env(world)).drivers.linear, linear)


@pytest.mark.parametrize("count", [2, 3])
def test_every_driven_vehicle_is_external_and_driven_in_the_twin(count):
    env = several(count)
    world = read_world(env)
    places = [env.road.vehicles.index(vehicle) for vehicle in env.controlled_vehicles]
    assert np.flatnonzero(world.drivers.kind == EXTERNAL).tolist() == places
    twin = build_env(world, simulation_frequency=15, decision_frequency=1)
    table = command_table(twin)
    twin.step((8, 0, 5)[:count])
    for vehicle, action in zip(twin.controlled_vehicles, (8, 0, 5), strict=False):
        assert vehicle.action["acceleration"] == table[action, 0]
    assert [twin.road.vehicles.index(vehicle) for vehicle in twin.controlled_vehicles] == places
    assert read_world(twin).drivers.kind.tolist() == world.drivers.kind.tolist()


def test_worlds_that_cannot_be_built_or_tested():
    def of(*kinds):
        return make_world([0, 50], [0, 0], kinds=kinds)

    twin = build_env(of(RULE_BASED, EXTERNAL))
    assert twin.vehicle is twin.road.vehicles[1]
    world = of(EXTERNAL, RULE_BASED)
    with pytest.raises(SettingsError, match="0 ticks"):
        build_env(world, simulation_frequency=1, decision_frequency=2)
    with pytest.raises(SettingsError, match="slip_limit"):
        build_env(change(world, "drivers", slip_limit=1.0))
    with pytest.raises(SettingsError, match="no vehicle is driven"):
        build_env(of(CONSTANT, RULE_BASED))
    for kinds in ((EXTERNAL, EXTERNAL), (RULE_BASED, EXTERNAL)):
        with pytest.raises(SettingsError, match="only vehicle 0"):
            highway_env_evaluation.live(DrivingSettings(), of(*kinds), 50)


@pytest.mark.parametrize(
    ("driving", "training", "name"),
    [
        ({"latency": 0.2}, False, "latency"),
        ({"latency": 0.2}, True, "latency"),
        ({"training_latency": (0.0, 0.2)}, True, "training_latency"),
        ({"latency": 0.2, "training_latency": (0.0, 0.0)}, True, None),
        ({"training_latency": (0.0, 0.2)}, False, None),
    ],
)
def test_highway_env_knows_no_latency(driving, training, name):
    world = make_world([0, 50], [0, 0], kinds=(EXTERNAL, RULE_BASED))
    wanted = pytest.raises(SettingsError, match=rf"^driving\.{name}: ") if name else nullcontext()
    with wanted:
        highway_env_evaluation.live(DrivingSettings(**driving), world, 50, training)
