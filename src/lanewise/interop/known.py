"""What of highway-env 1.12.1 our world represents: all else is refused by its name.

A class may add what highway-env never asks for and construct itself as it likes. Whatever else it,
or an object of it, changes of highway-env's own class must be one of the numbers that are read.
"""

from collections.abc import Iterable
from typing import Any, NoReturn

import numpy as np
from highway_env.envs.common.abstract import AbstractEnv
from highway_env.envs.common.action import ContinuousAction, DiscreteAction, MultiAgentAction
from highway_env.road.lane import StraightLane
from highway_env.road.road import Road, RoadNetwork
from highway_env.vehicle.behavior import IDMVehicle
from highway_env.vehicle.controller import ControlledVehicle
from highway_env.vehicle.kinematics import Vehicle

from lanewise.errors import SettingsError
from lanewise.world.road import MOST_LANES

SIZES = frozenset({"LENGTH", "WIDTH"})
"""Numbers that are read from every vehicle."""
DRIVING = frozenset(
    {
        "ACC_MAX", "COMFORT_ACC_MAX", "COMFORT_ACC_MIN", "DELTA", "DISTANCE_WANTED",
        "LANE_CHANGE_DELAY", "LANE_CHANGE_MAX_BRAKING_IMPOSED", "LANE_CHANGE_MIN_ACC_GAIN",
        "MAX_STEERING_ANGLE", "POLITENESS", "TIME_WANTED",
    }
)  # fmt: skip
"""Numbers that are read from every `IDMVehicle`."""
NUMBERS = ("position", "heading", "speed", "timer", "target_speed")
"""The state that is read as numbers, where a vehicle has it."""
BEGINNING = frozenset(
    {"__init__", "create_random", "create_from", "make_on_lane", "randomize_behavior",
     "DEFAULT_INITIAL_SPEEDS", "DELTA_RANGE", "HISTORY_SIZE"}
)  # fmt: skip
"""Matters only before an object is read, or to a picture."""
TECHNICAL = frozenset(
    {"__abstractmethods__", "_abc_impl", "__annotate__", "__annotate_func__", "__annotations__",
     "__annotations_cache__", "__dict__", "__doc__", "__firstlineno__", "__module__",
     "__qualname__", "__repr__", "__slotnames__", "__static_attributes__", "__str__",
     "__weakref__"}
)  # fmt: skip
"""What Python itself notes in a class, and how an object prints."""


def _defined(kind: type) -> dict[str, Any]:
    """All that a class defines or inherits, by name."""
    found: dict[str, Any] = {}
    for base in reversed(kind.__mro__):
        found.update(vars(base))
    return found


_ORIGINAL = {
    kind: _defined(kind)
    for kind in (
        AbstractEnv, ContinuousAction, DiscreteAction, MultiAgentAction, Road, RoadNetwork,
        StraightLane, Vehicle, IDMVehicle,
    )
}  # fmt: skip
"""highway-env's own, before anything can have been changed."""
_STATE = {
    Vehicle: frozenset(vars(Vehicle(None, [0.0, 0.0]))) | {"target_speed"},
    IDMVehicle: frozenset(vars(IDMVehicle(None, [0.0, 0.0]))),
    StraightLane: frozenset(vars(StraightLane([0.0, 0.0], [1.0, 0.0]))),
    Road: frozenset(vars(Road())),
    RoadNetwork: frozenset(vars(RoadNetwork())),
}
"""What constructors set, and what drivers ask of others; a class must leave it to its objects."""


def _refuse(what: str, do: str) -> NoReturn:
    raise SettingsError(f"{what} cannot be read; {do}")


def _same(value: Any, original: Any) -> bool:
    numbers = isinstance(value, (int, float)) and isinstance(original, (int, float))
    return value is original or (numbers and value == original)


def _changes(thing: Any, original: type, read: frozenset[str] = frozenset()) -> list[str]:
    """What an object and its class change of highway-env's own class, by name."""
    usual, state = _ORIGINAL[original], _STATE.get(original, frozenset())

    def is_free(name: str, value: Any) -> bool:
        is_read = name in read and isinstance(value, (int, float, np.number))
        return is_read or name in BEGINNING | TECHNICAL or _same(value, usual.get(name))

    of_class = [
        name
        for name, value in _defined(type(thing)).items()
        if (name in usual or name in state or name.startswith("__")) and not is_free(name, value)
    ]
    of_object = [
        name
        for name, value in vars(thing).items()
        if name in usual and name not in state and not is_free(name, value)
    ]
    return list(dict.fromkeys(of_class + of_object))


def _check_unchanged(thing: Any, original: type, read: frozenset[str] = frozenset()) -> None:
    changed = _changes(thing, original, read)
    if changed:
        _refuse(
            f"a {type(thing).__name__} with its own {', '.join(changed)}",
            f"use highway-env's {original.__name__}",
        )


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
    """Refuse rates under which no tick is simulated.

    Args:
        simulation_frequency: ticks a second, Hz.
        decision_frequency: decisions a second, Hz.

    Raises:
        SettingsError: a decision would last 0 ticks.
    """
    rates = (simulation_frequency, decision_frequency)
    if not all(np.isfinite(rate) and rate > 0 for rate in rates) or rates[0] < rates[1]:
        raise SettingsError(
            f"{simulation_frequency} ticks and {decision_frequency} decisions a second make 0 "
            "ticks a decision; use a simulation_frequency of at least the policy_frequency"
        )


def _check_env(env: Any) -> None:
    if not isinstance(env, AbstractEnv):
        _refuse(f"a {type(env).__name__}", "use an environment of highway-env")
    for name in ("step", "_simulate"):
        if _defined(type(env)).get(name) is not _ORIGINAL[AbstractEnv][name] or name in vars(env):
            _refuse(f"a {type(env).__name__} with its own {name}", "use HighwayEnv's")
    check_rates(env.config["simulation_frequency"], env.config["policy_frequency"])


def _check_road(road: Any) -> None:
    _check_unchanged(road, Road)
    _check_unchanged(road.network, RoadNetwork)
    for lane in lanes(road.network):
        _check_lane(lane)
    if road.objects:
        raise SettingsError("there are obstacles or landmarks on the road; they cannot be read")
    if road.neighbour_vehicles_connected_lanes:
        raise SettingsError("neighbour_vehicles_connected_lanes is on; it cannot be read")


def lanes(network: Any) -> list[Any]:
    """The lanes of a network's only road, from left to right.

    Raises:
        SettingsError: there are more roads, or more lanes than a world can have.
    """
    roads = [lanes for ends in network.graph.values() for lanes in ends.values()]
    if len(roads) != 1:
        raise SettingsError(f"the road network has {len(roads)} roads; only one can be read")
    if len(roads[0]) > MOST_LANES:
        raise SettingsError(f"the road has {len(roads[0])} lanes; at most {MOST_LANES} can be read")
    return list(roads[0])


def _check_lane(lane: Any) -> None:
    _check_unchanged(lane, StraightLane)
    along = lane.end[0] - lane.start[0]
    straight = (
        along > 0
        and lane.start[1] == lane.end[1]
        and lane.heading == 0
        and lane.length == along
        and np.array_equal(lane.direction, [1, 0])
        and np.array_equal(lane.direction_lateral, [0, 1])
    )
    if not straight:
        raise SettingsError("a lane is not straight along x; only such lanes can be read")
    limit = np.inf if lane.speed_limit is None else lane.speed_limit
    if not (lane.width > 0 and np.isfinite([*lane.start, along, lane.width]).all()):
        raise SettingsError("a lane's place or width is no finite number; it cannot be read")
    if np.isnan(limit):
        raise SettingsError("a lane's speed_limit is no number; use None for a lane without one")


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
        name = type(kind).__name__
        if type(kind) not in (DiscreteAction, ContinuousAction):
            _refuse(
                f'the action type "{name}"',
                'make the environment with config={"action": {"type": "DiscreteAction"}}, '
                'or "ContinuousAction"',
            )
        _check_unchanged(kind, type(kind))
        usual = (Vehicle.MIN_SPEED, Vehicle.MAX_SPEED)
        if kind.speed_range and tuple(kind.speed_range) != usual:
            _refuse(f"the speed_range {tuple(kind.speed_range)} of the action", f"leave {usual}")


def _check_controlled(env: Any) -> None:
    places = {id(vehicle): place for place, vehicle in enumerate(env.road.vehicles)}
    if len(places) < len(env.road.vehicles):
        raise SettingsError("a vehicle is twice on the road; it cannot be read")
    if not all(id(vehicle) in places for vehicle in env.controlled_vehicles):
        raise SettingsError("a controlled vehicle is not on the road; it cannot be read")
    order = [places[id(vehicle)] for vehicle in env.controlled_vehicles]
    if order != sorted(set(order)):
        raise SettingsError("controlled vehicles are in another order than on the road")
    acting = _acting(env)
    driven = [places.get(id(kind.controlled_vehicle)) for kind in acting]
    if acting and driven != order:
        raise SettingsError(
            f"the actions drive {len(driven)} of {len(order)} controlled vehicles; use the action "
            'type "MultiAgentAction" and reset the environment'
        )
    if acting and any(isinstance(vehicle, IDMVehicle) for vehicle in env.controlled_vehicles):
        raise SettingsError("a controlled IDMVehicle decides twice in a tick; it cannot be read")


def _check_vehicle(vehicle: Any, road: Any) -> None:
    kind, rule_based = type(vehicle).__name__, isinstance(vehicle, IDMVehicle)
    plain = isinstance(vehicle, Vehicle) and not isinstance(vehicle, ControlledVehicle)
    if not (plain or rule_based):
        _refuse(f"a {kind}", "use Vehicle or IDMVehicle")
    original, read = (IDMVehicle, SIZES | DRIVING) if rule_based else (Vehicle, SIZES)
    _check_unchanged(vehicle, original, read)
    _check_numbers(vehicle, [*read, *NUMBERS])
    _check_place(vehicle, road)
    for name in ("collidable", "solid"):
        if not getattr(vehicle, name):
            _refuse(f"a {kind} whose {name} is off", "leave it on")
    if not np.isclose(vehicle.diagonal, np.hypot(vehicle.LENGTH, vehicle.WIDTH), rtol=1e-12):
        _refuse(f"a {kind} whose diagonal is not of its LENGTH and WIDTH", "set all three")
    unlimited = any(lane.speed_limit is None for lane in lanes(road.network))
    if unlimited and getattr(vehicle, "target_speed", 0) < 0:
        _refuse(f"a {kind} with a negative target_speed where a lane has no speed_limit", "set one")
    if rule_based:
        _check_driver(vehicle)


def _check_numbers(vehicle: Any, names: Iterable[str]) -> None:
    values = {name: getattr(vehicle, name) for name in names if hasattr(vehicle, name)}
    values |= {f"commanded {name}": value for name, value in vehicle.action.items()}
    values["impact"] = 0 if vehicle.impact is None else vehicle.impact
    for name, value in values.items():
        if not np.isfinite(np.asarray(value, np.float64)).all():
            _refuse(f"a {type(vehicle).__name__} whose {name} is {value}", "use finite numbers")


def _check_place(vehicle: Any, road: Any) -> None:
    kind, network = type(vehicle).__name__, road.network
    if vehicle.road is not road:
        raise SettingsError(f"a {kind} belongs to another road; it cannot be read")
    place = network.get_closest_lane_index(vehicle.position, vehicle.heading)
    if vehicle.lane_index != place or vehicle.lane is not network.get_lane(place):
        raise SettingsError(
            f"a {kind}'s lane_index is not that of its position; call its on_state_update()"
        )


def _check_driver(vehicle: Any) -> None:
    kind = type(vehicle).__name__
    if vehicle.route:
        raise SettingsError("a vehicle follows a route; routes cannot be read")
    if vehicle.target_lane_index not in vehicle.road.network.all_side_lanes(vehicle.lane_index):
        _refuse(f"a {kind} whose target_lane_index is no lane of the road", "use one")
    within = {
        "MAX_STEERING_ANGLE": 0 <= vehicle.MAX_STEERING_ANGLE < np.pi / 2,
        "DELTA": vehicle.DELTA > 0,
        "COMFORT_ACC_MAX": vehicle.COMFORT_ACC_MAX > 0,
        "COMFORT_ACC_MIN": vehicle.COMFORT_ACC_MIN < 0,
    }
    for name, holds in within.items():
        if not holds:
            _refuse(
                f"a {kind} with a {name} of {getattr(vehicle, name)}",
                "use a steering angle from 0 to below pi/2, COMFORT_ACC_MIN below 0, others above",
            )
