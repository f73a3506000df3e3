"""Live highway-env environments, drawn at random and made in the ways that users make them."""

from dataclasses import dataclass

import gymnasium
import highway_env  # noqa: F401, registers the environments
import numpy as np
from highway_env.envs import HighwayEnv
from highway_env.road.lane import StraightLane
from highway_env.road.road import Road, RoadNetwork
from highway_env.vehicle.behavior import (
    AggressiveVehicle,
    DefensiveVehicle,
    IDMVehicle,
    LinearVehicle,
)
from highway_env.vehicle.kinematics import Vehicle

RATES = (1, 2, 3, 5, 7, 10, 12, 15, 20, 30, 60)
LANES_MAX, OTHERS_MAX, CONTROLLED_MAX = 8, 80, 4
SHARE, AFFECTED = 0.25, 0.3
"""How often a configuration has each of `STARTS`, and how often it then befalls a vehicle."""
AFFORDED = 20.0
"""Seconds that a configuration may take, but for one in `LARGE`, whose vehicles may be many."""
LARGE = 20
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
STARTS = (
    *("off the road", "overlapping", "reversing", "at the end of the road", "before the road"),
    *("astray", "above 35 m/s", "standing", "crashed"),
)


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


def seconds_of(rate, vehicles, seconds):
    """About how long highway-env takes, s."""
    return seconds * rate * (0.15e-3 * vehicles + 4.5e-6 * vehicles**2)


def draw(seed, number, seconds=40.0, most=OTHERS_MAX):
    """Draw a configuration; rates and lanes go in turn, so that each meets each."""
    rng = np.random.default_rng([seed, 4, number])
    rate, lanes = RATES[number % len(RATES)], 1 + number // len(RATES) % LANES_MAX
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
    )


def make(seed, configuration):
    """Make the environment of a configuration as `gymnasium.make` does, reset and filled."""
    rng = np.random.default_rng([seed, 5, configuration.number])
    env = gymnasium.make("highway-v0", config=_config(configuration, rng))
    env.reset(seed=int(rng.integers(2**31)))
    live = env.unwrapped
    if configuration.traffic != "reset":
        _fill(live, configuration, rng)
    for start in configuration.starts:
        for vehicle in live.road.vehicles:
            if rng.random() < AFFECTED:
                _befall(vehicle, start, live.road, rng)
                vehicle.on_state_update()
    env.action_space.seed(int(rng.integers(2**31)))
    return env


def default_env(seed, **config):
    """highway-env's own default traffic: 50 vehicles, four lanes, 15 Hz, under DiscreteAction."""
    config |= {"action": DISCRETE | GENTLE, "policy_frequency": 1, "simulation_frequency": 15}
    env = HighwayEnv(config=config)
    env.reset(seed=seed)
    env.action_space.seed(seed)
    return env


def linear_env(seed, others):
    """Default and linear drivers in turn, half of them randomised, on highway-env's own road."""
    env = default_env(seed, vehicles_count=0)
    for number in range(others):
        kind = (AggressiveVehicle, IDMVehicle, DefensiveVehicle, LinearVehicle)[number % 4]
        vehicle = kind.create_random(env.road, spacing=0.7)
        if number % 8 < 4:
            vehicle.randomize_behavior()
        env.road.vehicles.append(vehicle)
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


def _befall(vehicle, start, road, rng):
    """Give a vehicle one of the unusual places, speeds or states of `STARTS`."""
    lanes = road.network.lanes_list()
    match start:
        case "off the road":
            beyond = float(rng.uniform(2, 15))
            left, right = lanes[0].start[1] - beyond, lanes[-1].start[1] + beyond
            vehicle.position[1] = left if rng.random() < 0.5 else right
        case "overlapping":
            other = road.vehicles[int(rng.integers(len(road.vehicles)))]
            shift = rng.normal(0, [3.0, 1.0]) if rng.random() < 0.8 else 0.0
            vehicle.position = other.position + shift
        case "reversing":
            vehicle.speed = -float(rng.uniform(0.3, 12))
        case "at the end of the road":
            vehicle.position[0] = vehicle.lane.end[0] - rng.uniform(-20, 150)
        case "before the road":
            vehicle.position[0] = vehicle.lane.start[0] - rng.uniform(0, 60)
        case "astray":
            turned = rng.normal(0, 0.3) if rng.random() < 0.8 else rng.uniform(-7, 7)
            vehicle.heading = float(turned)
            vehicle.position[1] += rng.normal(0, 1.5)
        case "above 35 m/s":
            vehicle.speed = float(rng.uniform(35, 45))
        case "standing":
            vehicle.speed = float(rng.choice([0.0, 0.005, 0.5]))
        case "crashed":
            vehicle.crashed = True
