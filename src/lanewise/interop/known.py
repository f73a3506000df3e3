"""What of highway-env 1.12.1 our world represents: all else is refused by its name.

A class may add what highway-env never asks for and construct itself as it likes. Whatever else it,
or an object of it, changes of highway-env's own class must be one of the numbers that are read.
"""

from collections.abc import Iterable
from typing import Any

import numpy as np
from highway_env.envs.common.abstract import AbstractEnv
from highway_env.envs.common.action import ContinuousAction, DiscreteAction, MultiAgentAction
from highway_env.road.lane import StraightLane
from highway_env.road.road import Road, RoadNetwork
from highway_env.vehicle.behavior import IDMVehicle, LinearVehicle
from highway_env.vehicle.controller import ControlledVehicle
from highway_env.vehicle.kinematics import Vehicle

from lanewise.errors import SettingsError
from lanewise.world.road import MOST_LANES

SIZES = frozenset({"LENGTH", "WIDTH"})
"""Numbers that are read from every vehicle."""
PARAMETERS = {
    "comfort_acceleration": "COMFORT_ACC_MAX",
    "comfort_deceleration": "COMFORT_ACC_MIN",
    "jam_distance": "DISTANCE_WANTED",
    "time_gap": "TIME_WANTED",
    "exponent": "DELTA",
    "politeness": "POLITENESS",
    "minimum_gain": "LANE_CHANGE_MIN_ACC_GAIN",
    "imposed_braking": "LANE_CHANGE_MAX_BRAKING_IMPOSED",
    "change_delay": "LANE_CHANGE_DELAY",
    "acceleration_limit": "ACC_MAX",
    "slip_limit": "MAX_STEERING_ANGLE",
}
"""Our name of each parameter of a driver, and highway-env's."""
GAINS = {
    "ACCELERATION_PARAMETERS": ("target_speed_gain", "relative_speed_gain", "gap_gain"),
    "STEERING_PARAMETERS": ("heading_gain", "offset_gain"),
}
"""highway-env's lists of a linear driver's gains, and our name of each."""
DRIVING = SIZES.union(PARAMETERS.values())
"""Numbers that are read from every `IDMVehicle`."""
READ = {LinearVehicle: DRIVING.union(GAINS), IDMVehicle: DRIVING, Vehicle: SIZES}
"""What is read from each class of vehicles, and from those derived from it; the first counts."""
NUMBERS = ("position", "heading", "speed", "timer", "target_speed")
"""The state that is read as numbers, where a vehicle has it."""
BEGINNING = frozenset(
    {"create_random", "create_from", "make_on_lane", "randomize_behavior",
     "DEFAULT_INITIAL_SPEEDS", "DELTA_RANGE", "ACCELERATION_RANGE", "STEERING_RANGE",
     "HISTORY_SIZE"}
)  # fmt: skip
"""Matters only before an object is read, or to a picture."""


def _defined(kind: type) -> dict[str, Any]:
    """All that a class defines or inherits, by name, without what every class has."""
    found: dict[str, Any] = {}
    for base in reversed(kind.__mro__):
        found.update(vars(base))
    return {name: value for name, value in found.items() if not name.startswith(("__", "_abc_"))}


_ORIGINAL = {
    kind: _defined(kind)
    for kind in (
        AbstractEnv, ContinuousAction, DiscreteAction, MultiAgentAction, Road, RoadNetwork,
        StraightLane, *READ,
    )
}  # fmt: skip
"""highway-env's own, before anything can have been changed."""


def _require(holds: Any, what: str, do: str = "") -> None:
    if not holds:
        raise SettingsError(f"{what} cannot be read" + (f"; {do}" if do else ""))


def _check_unchanged(thing: Any, original: type, read: frozenset[str] = frozenset()) -> None:
    """Refuse what an object or its class changes of highway-env's own class, by name."""
    own = _defined(type(thing)) | vars(thing)
    changed = [
        name
        for name, usual in _ORIGINAL[original].items()
        if name not in BEGINNING and not _is_fine(own[name], usual, name in read)
    ]
    what = f"a {type(thing).__name__} with its own {', '.join(changed)}"
    _require(not changed, what, f"use highway-env's {original.__name__}")


def _is_fine(value: Any, usual: Any, read: bool) -> bool:
    """Whether it is highway-env's own, or a number or several that are as usual or are read."""
    if value is usual:
        return True
    value = value.tolist() if isinstance(value, np.ndarray) else value
    several = isinstance(value, list | tuple) and isinstance(usual, list)
    values, as_usual = (list(value), usual) if several else ([value], [usual])
    numbers = all(isinstance(each, int | float | np.number) for each in values)
    return numbers and len(values) == len(as_usual) and (read or values == as_usual)


def check(env: Any) -> None:
    """Refuse an environment that holds something our world does not represent.

    Args:
        env: unwrapped, of highway-env.

    Raises:
        SettingsError: naming what it is.
    """
    _check_env(env)
    _check_road(env.road)
    _check_actions(env)
    for vehicle in env.road.vehicles:
        _check_vehicle(vehicle, env.road)
    _check_controlled(env)


def check_rates(simulation_frequency: float, decision_frequency: float) -> None:
    """Refuse rates, Hz, under which no tick is simulated."""
    rates = (simulation_frequency, decision_frequency)
    if not all(np.isfinite(rate) and rate > 0 for rate in rates) or rates[0] < rates[1]:
        raise SettingsError(
            f"{simulation_frequency} ticks and {decision_frequency} decisions a second make 0 "
            "ticks a decision; use a simulation_frequency of at least the policy_frequency"
        )


def _check_env(env: Any) -> None:
    kind = f"a {type(env).__name__}"
    _require(isinstance(env, AbstractEnv), kind, "use an environment of highway-env")
    own = _defined(type(env)) | vars(env)
    for name in ("step", "_simulate"):
        usual = own[name] is _ORIGINAL[AbstractEnv][name]
        _require(usual, f"{kind} with its own {name}", "use HighwayEnv's")
    check_rates(env.config["simulation_frequency"], env.config["policy_frequency"])


def _check_road(road: Any) -> None:
    _check_unchanged(road, Road)
    _check_unchanged(road.network, RoadNetwork)
    for lane in lanes(road.network):
        _check_lane(lane)
    _require(not road.objects, "a road with obstacles or landmarks")
    connected = road.neighbour_vehicles_connected_lanes
    _require(not connected, "a road with neighbour_vehicles_connected_lanes")


def lanes(network: Any) -> list[Any]:
    """The lanes of a network's only road, from left to right.

    Raises:
        SettingsError: there are more roads, or more lanes than a world can have.
    """
    roads = [lanes for ends in network.graph.values() for lanes in ends.values()]
    _require(len(roads) == 1, f"a network of {len(roads)} roads", "use one straight road")
    count = len(roads[0])
    _require(count <= MOST_LANES, f"a road of {count} lanes", f"use at most {MOST_LANES}")
    return list(roads[0])


def _check_lane(lane: Any) -> None:
    _check_unchanged(lane, StraightLane, frozenset({"length"}))
    along = lane.end[0] - lane.start[0]
    straight = lane.start[1] == lane.end[1] and lane.length == along > 0
    _require(straight, "a lane that is not straight along x")


def heeds_nothing(action: Any) -> None:
    """Acts as an environment's action type whose ego decides for itself."""


def _acting(env: Any) -> list[Any]:
    """The action types that drive a vehicle each; none where the ego decides for itself."""
    kind = env.action_type
    if vars(kind).get("act") is heeds_nothing:
        return []
    return list(kind.agents_action_types) if type(kind) is MultiAgentAction else [kind]


def _check_actions(env: Any) -> None:
    if type(env.action_type) is MultiAgentAction:
        _check_unchanged(env.action_type, MultiAgentAction)
    for kind in _acting(env):
        _require(
            type(kind) in (DiscreteAction, ContinuousAction),
            f'the action type "{type(kind).__name__}"',
            'make the environment with config={"action": {"type": "DiscreteAction"}}, '
            'or "ContinuousAction"',
        )
        _check_unchanged(kind, type(kind))
        usual, given = (Vehicle.MIN_SPEED, Vehicle.MAX_SPEED), kind.speed_range
        same = not given or tuple(given) == usual
        _require(same, f"the speed_range {given} of the action", f"leave {usual}")


def _check_controlled(env: Any) -> None:
    controlled = env.controlled_vehicles
    places = {id(vehicle): place for place, vehicle in enumerate(env.road.vehicles)}
    on_road = all(id(vehicle) in places for vehicle in controlled)
    _require(on_road, "a controlled vehicle that is not on the road")
    order = [places[id(vehicle)] for vehicle in controlled]
    ordered = order == sorted(set(order))
    _require(ordered, "controlled vehicles that are in another order than on the road")
    driven = [places.get(id(kind.controlled_vehicle)) for kind in _acting(env)]
    if not driven:
        return
    _require(
        driven == order,
        f"an environment whose actions drive {len(driven)} of {len(order)} controlled vehicles",
        'use the action type "MultiAgentAction" and reset the environment',
    )
    by_rules = any(isinstance(vehicle, IDMVehicle) for vehicle in controlled)
    _require(not by_rules, "a controlled IDMVehicle, which decides twice in a tick,")


def _check_vehicle(vehicle: Any, road: Any) -> None:
    kind, rule_based = f"a {type(vehicle).__name__}", isinstance(vehicle, IDMVehicle)
    plain = isinstance(vehicle, Vehicle) and not isinstance(vehicle, ControlledVehicle)
    _require(plain or rule_based, kind, "use Vehicle, IDMVehicle or LinearVehicle")
    original, read = next(each for each in READ.items() if isinstance(vehicle, each[0]))
    _check_unchanged(vehicle, original, read)
    _check_numbers(vehicle, [*read, *NUMBERS])
    place = road.network.get_closest_lane_index(vehicle.position, vehicle.heading)
    there = vehicle.lane_index == place and vehicle.lane is road.network.get_lane(place)
    what = f"{kind} whose lane_index is not that of its position"
    _require(there, what, "call its on_state_update()")
    for name in ("collidable", "solid"):
        _require(getattr(vehicle, name), f"{kind} whose {name} is off", "leave it on")
    fits = np.isclose(vehicle.diagonal, np.hypot(vehicle.LENGTH, vehicle.WIDTH), rtol=1e-12)
    _require(fits, f"{kind} whose diagonal is not of its LENGTH and WIDTH", "set all three")
    limited = all(lane.speed_limit is not None for lane in lanes(road.network))
    what = f"{kind} with a negative target_speed where a lane has no speed_limit"
    _require(limited or getattr(vehicle, "target_speed", 0) >= 0, what, "set one")
    if rule_based:
        _check_driver(vehicle, kind)
    elif getattr(vehicle, "target_speed", 1) == 0:
        alone = not any(isinstance(other, LinearVehicle) for other in road.vehicles)
        _require(alone, f"{kind} with a target_speed of 0 beside a LinearVehicle", "leave it out")


def _check_numbers(vehicle: Any, names: Iterable[str]) -> None:
    values = {name: getattr(vehicle, name) for name in names if hasattr(vehicle, name)}
    values |= {f"commanded {name}": value for name, value in vehicle.action.items()}
    values["impact"] = 0 if vehicle.impact is None else vehicle.impact
    for name, value in values.items():
        finite = np.isfinite(np.asarray(value, np.float64)).all()
        _require(finite, f"a {type(vehicle).__name__} whose {name} is {value}")


def _check_driver(vehicle: Any, kind: str) -> None:
    _require(not vehicle.route, f"{kind} that follows a route")
    lanes_beside = vehicle.road.network.all_side_lanes(vehicle.lane_index)
    on_road = vehicle.target_lane_index in lanes_beside
    _require(on_road, f"{kind} whose target_lane_index is no lane of the road")
    within = {
        "MAX_STEERING_ANGLE": 0 <= vehicle.MAX_STEERING_ANGLE < np.pi / 2,
        "DELTA": vehicle.DELTA > 0,
        "COMFORT_ACC_MAX": vehicle.COMFORT_ACC_MAX > 0,
        "COMFORT_ACC_MIN": vehicle.COMFORT_ACC_MIN < 0,
    }
    for name, holds in within.items():
        _require(
            holds,
            f"{kind} with a {name} of {getattr(vehicle, name)}",
            "use a steering angle from 0 to below pi/2, COMFORT_ACC_MIN below 0, others above",
        )
