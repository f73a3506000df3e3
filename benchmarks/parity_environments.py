"""Live highway-env environments, drawn at random and made in the ways that users make them."""

from dataclasses import asdict, dataclass
from functools import partial

import gymnasium
import highway_env  # noqa: F401, registers the environments
import numpy as np
from highway_env.envs import MergeEnv
from highway_env.road.lane import SineLane, StraightLane
from highway_env.road.regulation import RegulatedRoad
from highway_env.road.road import Road, RoadNetwork
from highway_env.vehicle.behavior import (
    AggressiveVehicle,
    DefensiveVehicle,
    IDMVehicle,
    LinearVehicle,
)
from highway_env.vehicle.controller import ControlledVehicle, MDPVehicle
from highway_env.vehicle.dynamics import BicycleVehicle
from highway_env.vehicle.kinematics import Vehicle
from highway_env.vehicle.objects import Landmark, Obstacle

RATES = (1, 2, 3, 5, 7, 10, 12, 15, 20, 30, 60)
LANES_MAX, OTHERS_MAX, CONTROLLED_MAX = 8, 80, 4
SHARE, AFFECTED = 0.25, 0.3
"""How often a configuration has each of `STARTS`, and how often it then befalls a vehicle."""
AFFORDED = 20.0
"""Seconds that a configuration may take, but for one in `LARGE`, whose vehicles may be many."""
LARGE = 20
UNREAD = 12
"""One configuration in so many holds something that our world does not represent."""
DISCRETE, CONTINUOUS = {"type": "DiscreteAction"}, {"type": "ContinuousAction"}
GENTLE = {"acceleration_range": (-1.0, 1.0), "steering_range": (-np.pi / 50, np.pi / 50)}
ACTIONS = {
    "discrete": DISCRETE,
    "discrete, gentle": DISCRETE | GENTLE,
    "discrete, five an axis": DISCRETE | GENTLE | {"actions_per_axis": 5},
    "discrete, lateral": DISCRETE | GENTLE | {"longitudinal": False},
    "continuous": CONTINUOUS,
    "continuous, gentle": CONTINUOUS | GENTLE,
    "continuous, longitudinal": CONTINUOUS | {"lateral": False},
}
TRAFFIC = ("reset", "create_random", "by hand")
ROADS = ("standard", "short", "own lanes")
DRIVERS = ("default", "randomised", "subclass", "own parameters")


class PaperDriver(IDMVehicle):
    """The way a user gives drivers other parameters: constants of a subclass."""

    COMFORT_ACC_MAX, COMFORT_ACC_MIN, ACC_MAX = 0.5, -0.5, 1.0
    POLITENESS, MAX_STEERING_ANGLE = 0.5, np.pi / 36


class Truck(IDMVehicle):
    """A longer and wider vehicle."""

    LENGTH, WIDTH = 12.0, 2.5


@dataclass(frozen=True)
class Configuration:
    """What a live environment is made from, with the random numbers of its seed."""

    number: int
    rate: int
    """Ticks a second, Hz."""
    period: int
    """Ticks a decision."""
    lanes: int
    others: int
    """Vehicles that are not controlled."""
    controlled: int
    action: str
    traffic: str
    road: str
    drivers: str
    starts: tuple
    unread: str | None
    """What makes `read_world` refuse it, a key of `UNREPRESENTED`."""

    def to_json(self):
        """As a row of the result file."""
        return asdict(self)


def seconds_of(rate, vehicles, seconds):
    """About how long highway-env takes, s."""
    return seconds * rate * (0.15e-3 * vehicles + 4.5e-6 * vehicles**2)


def draw(seed, number, seconds=40.0, most=OTHERS_MAX):
    """Draw a configuration; rates and lanes go in turn, so that each meets each.

    Args:
        seed: of the campaign.
        number: of the configuration.
        seconds: simulated, s.
        most: vehicles that are not controlled.
    """
    rng = np.random.default_rng([seed, 4, number])
    rate, lanes = RATES[number % len(RATES)], 1 + number // len(RATES) % LANES_MAX
    unread = None
    if number % UNREAD == UNREAD - 1:
        unread = tuple(UNREPRESENTED)[number // UNREAD % len(UNREPRESENTED)]
    affordable = max(n for n in range(most + 1) if seconds_of(rate, n, seconds) <= AFFORDED)
    low, high = (affordable, most) if number % LARGE == 0 else (0, affordable)
    traffic = str(rng.choice(TRAFFIC))
    return Configuration(
        number=number,
        rate=rate,
        period=int(rng.choice([p for p in (1, 2, 5, 15) if p <= rate])),
        lanes=lanes,
        others=int(rng.integers(low, high + 1)),
        controlled=int(rng.choice([1, 1, 1, 2, 3, CONTROLLED_MAX])),
        action=str(rng.choice(list(ACTIONS))),
        traffic=traffic,
        road="standard" if traffic == "reset" else str(rng.choice(ROADS)),
        drivers="randomised" if traffic == "reset" else str(rng.choice(DRIVERS)),
        starts=tuple(name for name in STARTS if rng.random() < SHARE),
        unread=unread,
    )


def make(seed, configuration):
    """Make the environment of a configuration, reset and filled.

    Args:
        seed: of the campaign.
        configuration: what to make.

    Returns:
        A wrapped environment, as `gymnasium.make` returns it.
    """
    rng = np.random.default_rng([seed, 5, configuration.number])
    if configuration.unread is not None:
        env = UNREPRESENTED[configuration.unread]()
    else:
        env = _registered(_config(configuration, rng), int(rng.integers(2**31)))
        live = env.unwrapped
        if configuration.traffic != "reset":
            _fill(live, configuration, rng)
        _befall(live, configuration.starts, rng)
    env.action_space.seed(int(rng.integers(2**31)))
    return env


def _registered(config, seed=0):
    env = gymnasium.make("highway-v0", config=config)
    env.reset(seed=seed)
    return env


def _config(configuration, rng):
    action, observation = ACTIONS[configuration.action], {"type": "Kinematics"}
    if configuration.controlled > 1:
        action = {"type": "MultiAgentAction", "action_config": action}
        observation = {"type": "MultiAgentObservation", "observation_config": observation}
    return {
        "action": action,
        "observation": observation,
        "lanes_count": configuration.lanes,
        "vehicles_count": configuration.others if configuration.traffic == "reset" else 0,
        "controlled_vehicles": configuration.controlled,
        "vehicles_density": float(rng.uniform(0.5, 3.0)),
        "simulation_frequency": configuration.rate,
        "policy_frequency": configuration.rate // configuration.period,
    }


def _fill(live, configuration, rng):
    """Replace road and vehicles, as a user does who places vehicles by hand."""
    network = _network(configuration, rng)
    road = Road(network=network, np_random=live.np_random, record_history=False)
    for _ in range(configuration.others):
        new = _random_vehicle if configuration.traffic == "create_random" else _placed_vehicle
        vehicle = new(road, configuration, rng)
        if isinstance(vehicle, IDMVehicle) and configuration.drivers == "randomised":
            vehicle.randomize_behavior()
        if isinstance(vehicle, IDMVehicle) and configuration.drivers == "own parameters":
            _parametrise(vehicle, rng)
        road.vehicles.append(vehicle)
    places = np.sort(rng.integers(0, configuration.others + 1, configuration.controlled))
    live.controlled_vehicles = [_placed(Vehicle, road, configuration, rng) for _ in places]
    for before, vehicle in enumerate(live.controlled_vehicles):
        road.vehicles.insert(before + int(places[before]), vehicle)
    live.road = road
    live.define_spaces()


def _network(configuration, rng):
    lanes = configuration.lanes
    if configuration.road == "standard":
        return RoadNetwork.straight_road_network(lanes, speed_limit=30)
    start, length = float(rng.uniform(-300, 300)), float(rng.uniform(200, 900))
    if configuration.road == "short":
        return RoadNetwork.straight_road_network(
            lanes, start, length, speed_limit=float(rng.uniform(5, 35))
        )
    network, width = RoadNetwork(), float(rng.uniform(3, 5))
    for lane in range(lanes):
        limit = None if rng.random() < 0.2 else float(rng.uniform(5, 35))
        ends = [[start, lane * width], [start + 4 * length, lane * width]]
        closed = bool(rng.random() < 0.1)
        network.add_lane("a", "b", StraightLane(*ends, width, None, closed, limit))
    return network


def _class(configuration, rng):
    if configuration.drivers == "subclass":
        return (PaperDriver, Truck)[int(rng.integers(2))]
    return IDMVehicle


def _random_vehicle(road, configuration, rng):
    return _class(configuration, rng).create_random(road, spacing=float(rng.uniform(0.3, 2.0)))


def _placed_vehicle(road, configuration, rng):
    if rng.random() < 0.15:
        return _placed(Vehicle, road, configuration, rng)
    speed = float(rng.uniform(5, 30))
    lane = road.network.random_lane_index(rng) if rng.random() < 0.3 else None
    return _placed(
        _class(configuration, rng),
        road,
        configuration,
        rng,
        target_lane_index=lane,
        target_speed=speed if rng.random() < 0.7 else None,
        enable_lane_change=bool(rng.random() < 0.9),
        timer=float(rng.uniform(0, 2)) if rng.random() < 0.3 else None,
    )


def _placed(kind, road, configuration, rng, **more):
    """A vehicle in the middle of a lane, about 20 m of lane for each; some begin reversing."""
    lane = road.network.lanes_list()[int(rng.integers(configuration.lanes))]
    room = 20 * (configuration.others + configuration.controlled) / configuration.lanes
    place = lane.position(rng.uniform(0, min(room, lane.length)), 0)
    unlimited = any(other.speed_limit is None for other in road.network.lanes_list())
    slowest = 0 if unlimited else -5
    return kind(road, place, 0.0, float(rng.uniform(slowest, 30)), **more)


def _parametrise(vehicle, rng):
    vehicle.COMFORT_ACC_MAX, vehicle.COMFORT_ACC_MIN = rng.uniform(0.3, 4), -rng.uniform(0.3, 6)
    vehicle.DISTANCE_WANTED, vehicle.TIME_WANTED = rng.uniform(0, 15), rng.uniform(0.2, 3)
    vehicle.POLITENESS, vehicle.LANE_CHANGE_MIN_ACC_GAIN = rng.uniform(), rng.uniform(-0.1, 0.5)
    vehicle.LANE_CHANGE_MAX_BRAKING_IMPOSED = rng.uniform(0, 5)
    vehicle.LANE_CHANGE_DELAY = rng.uniform(0.2, 3)
    vehicle.ACC_MAX, vehicle.MAX_STEERING_ANGLE = rng.uniform(0.5, 8), rng.uniform(0.05, 1.2)
    vehicle.check_collisions = bool(rng.random() < 0.8)


def _befall(live, starts, rng):
    """Give the vehicles unusual places and speeds."""
    for name in starts:
        for vehicle in live.road.vehicles:
            if rng.random() < AFFECTED:
                STARTS[name](vehicle, live.road, rng)
                vehicle.on_state_update()


def _off_the_road(vehicle, road, rng):
    lanes = road.network.lanes_list()
    beyond = float(rng.uniform(2, 15))
    left, right = lanes[0].start[1] - beyond, lanes[-1].start[1] + beyond
    vehicle.position[1] = left if rng.random() < 0.5 else right


def _overlapping(vehicle, road, rng):
    other = road.vehicles[int(rng.integers(len(road.vehicles)))]
    shift = rng.normal(0, [3.0, 1.0]) if rng.random() < 0.8 else 0.0
    vehicle.position = other.position + shift


def _reversing(vehicle, road, rng):
    vehicle.speed = -float(rng.uniform(0.3, 12))


def _end_of_the_road(vehicle, road, rng):
    vehicle.position[0] = vehicle.lane.end[0] - rng.uniform(-20, 150)


def _before_the_road(vehicle, road, rng):
    vehicle.position[0] = vehicle.lane.start[0] - rng.uniform(0, 60)


def _astray(vehicle, road, rng):
    vehicle.heading = float(rng.normal(0, 0.3) if rng.random() < 0.8 else rng.uniform(-7, 7))
    vehicle.position[1] += rng.normal(0, 1.5)


def _fast(vehicle, road, rng):
    vehicle.speed = float(rng.uniform(35, 45))


def _standing(vehicle, road, rng):
    vehicle.speed = float(rng.choice([0.0, 0.005, 0.5]))


def _crashed(vehicle, road, rng):
    vehicle.crashed = True


STARTS = {
    "off the road": _off_the_road,
    "overlapping": _overlapping,
    "reversing": _reversing,
    "at the end of the road": _end_of_the_road,
    "before the road": _before_the_road,
    "astray": _astray,
    "above 35 m/s": _fast,
    "standing": _standing,
    "crashed": _crashed,
}


def _plain(**changes):
    return _registered({"vehicles_count": 5, "action": DISCRETE} | changes)


def _with_vehicle(kind, **more):
    env = _plain()
    road = env.unwrapped.road
    road.vehicles.append(kind(road, [300.0, 4.0], 0.0, 20.0, **more))
    return env


def _reversing_without_a_limit():
    env = _with_driver(target_speed=-5.0)
    for lane in env.unwrapped.road.network.lanes_list():
        lane.speed_limit = None
    return env


def _with_object(kind):
    env = _plain()
    road = env.unwrapped.road
    road.objects.append(kind(road, [300.0, 4.0]))
    return env


def _with_driver(**attributes):
    env = _plain()
    for name, value in attributes.items():
        setattr(env.unwrapped.road.vehicles[2], name, value)
    return env


def _with_lane(lane, origin="0", destination="1"):
    env = _plain()
    env.unwrapped.road.network.add_lane(origin, destination, lane)
    return env


def _merge():
    env = MergeEnv(config={"action": DISCRETE})
    env.reset(seed=0)
    return env


class _Hesitant(IDMVehicle):
    def acceleration(self, ego_vehicle, front_vehicle=None, rear_vehicle=None):
        return 0.5 * super().acceleration(ego_vehicle, front_vehicle, rear_vehicle)


class _Drifting(IDMVehicle):
    TAU_LATERAL = 3.0
    KP_LATERAL = 1 / TAU_LATERAL


def _regulated():
    env = _plain()
    live = env.unwrapped
    live.road = RegulatedRoad(live.road.network, live.road.vehicles, np_random=live.np_random)
    return env


UNREPRESENTED = {
    "LinearVehicle": partial(_with_vehicle, LinearVehicle),
    "AggressiveVehicle": partial(_with_vehicle, AggressiveVehicle),
    "DefensiveVehicle": partial(_with_vehicle, DefensiveVehicle),
    "ControlledVehicle": partial(_with_vehicle, ControlledVehicle),
    "MDPVehicle": partial(_with_vehicle, MDPVehicle),
    "BicycleVehicle": partial(_with_vehicle, BicycleVehicle),
    "traffic of another class": partial(
        _plain, other_vehicles_type="highway_env.vehicle.behavior.AggressiveVehicle"
    ),
    "meta actions": partial(_plain, action={"type": "DiscreteMetaAction"}),
    "dynamical actions": partial(_plain, action=DISCRETE | {"dynamical": True}),
    "overridden method": partial(_with_vehicle, _Hesitant),
    "route": partial(_with_vehicle, IDMVehicle, route=[("0", "1", 0)]),
    "obstacle": partial(_with_object, Obstacle),
    "landmark": partial(_with_object, Landmark),
    "connected lanes": partial(_plain, neighbour_vehicles_connected_lanes=True),
    "several roads": _merge,
    "oblique lane": partial(_with_lane, StraightLane([0.0, 16.0], [10_000.0, 40.0])),
    "curved lane": partial(_with_lane, SineLane([0.0, 16.0], [10_000.0, 16.0], 1, 0.1, 0)),
    "speed range": partial(_plain, action=CONTINUOUS | {"speed_range": (0.0, 20.0)}),
    "constants of steering": partial(_with_vehicle, _Drifting),
    "method of an instance": partial(_with_driver, steering_control=lambda lane: 0.0),
    "speed limit of an instance": partial(_with_driver, MAX_SPEED=20.0),
    "not collidable": partial(_with_driver, collidable=False),
    "not solid": partial(_with_driver, solid=False),
    "length without its diagonal": partial(_with_driver, LENGTH=12.0),
    "moved without an update": partial(_with_driver, position=np.array([150.0, 12.0])),
    "regulated road": _regulated,
    "reversing without a limit": _reversing_without_a_limit,
    "too many lanes": partial(_plain, lanes_count=40),
}
