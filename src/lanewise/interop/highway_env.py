"""Our world and highway-env's, one made from the other: the twin that judges our world.

It speaks of version 1.12.1 and of straight roads. What may be read is in `known`.
"""

import operator
from collections.abc import Callable, Iterable
from dataclasses import is_dataclass
from types import SimpleNamespace
from typing import Any

import numpy as np
from highway_env.envs import HighwayEnv
from highway_env.road.lane import StraightLane
from highway_env.road.road import Road as HighwayRoad
from highway_env.road.road import RoadNetwork
from highway_env.vehicle.behavior import IDMVehicle, LinearVehicle
from highway_env.vehicle.kinematics import Vehicle

from lanewise.driving.settings import DrivingSettings
from lanewise.errors import SettingsError
from lanewise.interop import known
from lanewise.world.state import (
    CONSTANT,
    EXTERNAL,
    RULE_BASED,
    Drivers,
    Linear,
    Road,
    Vehicles,
    World,
)

ORIGIN, DESTINATION = "0", "1"


def _slip_sine(steering: float) -> float:
    """`steering.slip_sine` in float64."""
    half_tangent = np.tan(steering) / 2
    return float(half_tangent / np.sqrt(1 + half_tangent**2))


def _steering(slip_sine: float) -> float:
    """The steering angle of a slip angle's sine, rad."""
    return float(np.arctan(2 * slip_sine / np.sqrt(1 - slip_sine**2)))


_CONVERTED: dict[str, tuple[Callable[[float], float], Callable[[float], float]]] = {
    "comfort_deceleration": (operator.neg, operator.neg),
    "slip_limit": (_slip_sine, _steering),
}
"""Functions that read and set a parameter which is not the same number in both."""


def _floats(values: Iterable[Any]) -> Any:
    return np.array([float(value) for value in values], np.float64)


def _flags(values: Iterable[Any]) -> Any:
    return np.array([bool(value) for value in values], bool)


def _read_road(lanes: list[Any]) -> Road:
    limits = [np.inf if lane.speed_limit is None else lane.speed_limit for lane in lanes]
    return Road(
        present=_flags(True for _ in lanes),
        centre=_floats(lane.start[1] for lane in lanes),
        width=_floats(lane.width for lane in lanes),
        start=_floats(lane.start[0] for lane in lanes),
        end=_floats(lane.end[0] for lane in lanes),
        speed_limit=_floats(limits),
        open_to_change=_flags(not lane.forbidden for lane in lanes),
    )


def _read_drivers(vehicles: list[Any], controlled: list[Any]) -> Drivers:
    def kind(vehicle: Any) -> int:
        if isinstance(vehicle, IDMVehicle):
            return RULE_BASED
        return EXTERNAL if any(vehicle is each for each in controlled) else CONSTANT

    kinds = [kind(vehicle) for vehicle in vehicles]
    rule_based = [v if isinstance(v, IDMVehicle) else IDMVehicle for v in vehicles]
    parameters = {}
    for name, theirs in known.PARAMETERS.items():
        read, _ = _CONVERTED.get(name, (float, float))
        parameters[name] = _floats(read(getattr(v, theirs)) for v in rule_based)
    return Drivers(
        kind=np.array(kinds, np.int32),  # type: ignore[arg-type]
        target_speed=_floats(getattr(v, "target_speed", 0) for v in vehicles),
        changes_lanes=_flags(getattr(v, "enable_lane_change", False) for v in vehicles),
        checks_collisions=_flags(v.check_collisions for v in vehicles),
        length=_floats(v.LENGTH for v in vehicles),
        width=_floats(v.WIDTH for v in vehicles),
        linear=_read_linear(vehicles),
        **parameters,
    )


def _read_linear(vehicles: list[Any]) -> Linear | None:
    applies = [isinstance(vehicle, LinearVehicle) for vehicle in vehicles]
    if not any(applies):
        return None
    of = [v if linear else LinearVehicle for v, linear in zip(vehicles, applies, strict=True)]
    gains = {
        name: _floats(getattr(v, theirs)[place] for v in of)
        for theirs, names in known.GAINS.items()
        for place, name in enumerate(names)
    }
    return Linear(applies=_flags(applies), **gains)


def _read_vehicles(vehicles: list[Any]) -> Vehicles:
    impacts = [np.zeros(2) if v.impact is None else v.impact for v in vehicles]
    targets = [getattr(v, "target_lane_index", v.lane_index)[2] for v in vehicles]
    return Vehicles(
        present=_flags(True for _ in vehicles),
        x=_floats(v.position[0] for v in vehicles),
        y=_floats(v.position[1] for v in vehicles),
        heading=_floats(v.heading for v in vehicles),
        speed=_floats(v.speed for v in vehicles),
        slip_sine=_floats(_slip_sine(v.action["steering"]) for v in vehicles),
        acceleration=_floats(v.action["acceleration"] for v in vehicles),
        target_lane=np.array(targets, np.int32),  # type: ignore[arg-type]
        timer=_floats(getattr(v, "timer", 0.0) for v in vehicles),
        crashed=_flags(v.crashed for v in vehicles),
        impacted=_flags(v.impact is not None for v in vehicles),
        impact_x=_floats(impact[0] for impact in impacts),
        impact_y=_floats(impact[1] for impact in impacts),
    )


def read_world(env: Any) -> World:
    """Read the state of a live highway-env environment: one world in float64 NumPy arrays.

    It has as many vehicles and lanes as there are. Parameters are read from each vehicle, so that
    randomised ones are its own.

    Args:
        env: an environment with one straight road along x, whose vehicles are plain `Vehicle`s,
            `IDMVehicle`s and `LinearVehicle`s. Plain vehicles that the environment's actions drive
            become EXTERNAL, others CONSTANT. Its action type is "DiscreteAction" or
            "ContinuousAction", or "MultiAgentAction" of one of these.

    Raises:
        SettingsError: the environment holds something that is not known to be represented.
    """
    env = env.unwrapped
    known.check(env)
    vehicles = list(env.road.vehicles)
    return World(
        road=_read_road(known.lanes(env.road.network)),
        drivers=_read_drivers(vehicles, env.controlled_vehicles),
        vehicles=_read_vehicles(vehicles),
    )


def _row(part: Any, index: int) -> SimpleNamespace:
    """One vehicle's or lane's values as plain Python numbers."""

    def value(values: Any) -> Any:
        if is_dataclass(values):
            return _row(values, index)
        return None if values is None else np.asarray(values)[index].item()

    return SimpleNamespace(**{name: value(values) for name, values in vars(part).items()})


def _present(part: Any) -> list[int]:
    return [int(index) for index in np.flatnonzero(np.asarray(part.present))]


def _build_network(road: Road) -> RoadNetwork:
    indices = _present(road)
    if indices != list(range(len(indices))):
        raise SettingsError("absent lanes lie between present ones; highway-env has no such roads")
    network = RoadNetwork()
    for index in indices:
        lane = _row(road, index)
        network.add_lane(
            ORIGIN,
            DESTINATION,
            StraightLane(
                np.array([lane.start, lane.centre]),
                np.array([lane.end, lane.centre]),
                width=lane.width,
                forbidden=not lane.open_to_change,
                speed_limit=None if np.isinf(lane.speed_limit) else lane.speed_limit,
            ),
        )
    return network


def _build_vehicle(road: Any, state: SimpleNamespace, driver: SimpleNamespace) -> Any:
    place = (road, [state.x, state.y], state.heading, state.speed)
    vehicle: Any
    if driver.kind == RULE_BASED:
        if not 0 <= driver.slip_limit < 1:
            raise SettingsError(f"a slip_limit of {driver.slip_limit} is no sine below 1")
        law = driver.linear
        vehicle = LinearVehicle(*place) if law and law.applies else IDMVehicle(*place)
        for name, theirs in known.PARAMETERS.items():
            _, setting = _CONVERTED.get(name, (float, float))
            setattr(vehicle, theirs, setting(getattr(driver, name)))
        if isinstance(vehicle, LinearVehicle):
            for theirs, names in known.GAINS.items():
                setattr(vehicle, theirs, [getattr(law, name) for name in names])
        # The constructor replaces zeros by defaults, so zeros must be set afterwards.
        vehicle.target_speed = driver.target_speed
        vehicle.timer = state.timer
        vehicle.enable_lane_change = driver.changes_lanes
        vehicle.target_lane_index = (ORIGIN, DESTINATION, state.target_lane)
    else:
        vehicle = Vehicle(*place)
        if driver.target_speed != 0:
            vehicle.target_speed = driver.target_speed
    vehicle.LENGTH, vehicle.WIDTH = driver.length, driver.width
    vehicle.diagonal = np.sqrt(driver.length**2 + driver.width**2)
    vehicle.check_collisions = driver.checks_collisions
    vehicle.crashed = state.crashed
    vehicle.impact = np.array([state.impact_x, state.impact_y]) if state.impacted else None
    vehicle.action = {"steering": _steering(state.slip_sine), "acceleration": state.acceleration}
    return vehicle


def build_env(
    world: World,
    *,
    simulation_frequency: int = 10,
    decision_frequency: int = 2,
    acceleration: float = 1.0,
    steering: float = np.pi / 50,
    duration: float = 25.0,
    render_mode: str | None = None,
) -> HighwayEnv:
    """Make a live highway-env environment whose road and vehicles equal our world.

    It is not to be reset: a reset would replace the road and all vehicles. EXTERNAL and CONSTANT
    vehicles are plain `Vehicle`s, RULE_BASED ones `IDMVehicle`s or `LinearVehicle`s whose
    parameters are set on the instance. One EXTERNAL vehicle takes a DiscreteAction of nine actions.
    Several take a tuple of such actions, in their order (MultiAgentAction). Without any, the ego is
    vehicle 0, which must be RULE_BASED and ignores actions. The observation, reward and endings are
    those of the first driven vehicle; the observation is Kinematics with fixed ranges.

    Args:
        world: one world, any float type; absent vehicles are left out.
        simulation_frequency: ticks a second, Hz.
        decision_frequency: decisions a second, Hz.
        acceleration: size of the acceleration action, m/s^2.
        steering: size of the steering action, rad.
        duration: after which an episode is truncated, simulated s, rounded up to decisions.
        render_mode: as of Gymnasium.

    Raises:
        SettingsError: speeds swing, nobody could be driven, lanes are missing in between, a limit
            of the slip angle is not below 1, or a decision would last 0 ticks.
    """
    known.check_rates(simulation_frequency, decision_frequency)
    if world.drivers.waves is not None:
        raise SettingsError("highway-env has no drivers whose speed swings (waves)")
    indices = _present(world.vehicles)
    kinds = np.asarray(world.drivers.kind)[indices]
    driven = np.flatnonzero(kinds == EXTERNAL).tolist()
    if not driven and not (indices and indices[0] == 0 and kinds[0] == RULE_BASED):
        raise SettingsError("no vehicle is driven from outside, and vehicle 0 not by rules")
    driving = DrivingSettings(simulation_frequency, decision_frequency)
    network = _build_network(world.road)
    lanes = len(_present(world.road))
    width = lanes * float(np.asarray(world.road.width)[0])
    limits = {"x": 200.0, "y": width, "vx": 80.0, "vy": 80.0}
    ranges = {name: [-limit, limit] for name, limit in limits.items()}
    action = {
        "type": "DiscreteAction",
        "acceleration_range": (-acceleration, acceleration),
        "steering_range": (-steering, steering),
        "actions_per_axis": 3,
    }
    several = {"type": "MultiAgentAction", "action_config": action}
    config = {
        "lanes_count": lanes,
        "vehicles_count": 0,
        "simulation_frequency": simulation_frequency,
        "policy_frequency": decision_frequency,
        # On highway-env's clock, which counts 1 / `decision_frequency` for every decision however
        # long it lasts; half a decision early, as it is a sum of rounded numbers.
        "duration": (driving.decisions_in(duration) - 0.5) / decision_frequency,
        "action": action if len(driven) < 2 else several,
        "observation": {"type": "Kinematics", "features_range": ranges},
        "offscreen_rendering": True,
    }
    env = HighwayEnv(config=config, render_mode=render_mode)
    env.road = HighwayRoad(network=network, np_random=env.np_random, record_history=False)
    env.road.vehicles = [
        _build_vehicle(env.road, _row(world.vehicles, index), _row(world.drivers, index))
        for index in indices
    ]
    env.controlled_vehicles = [env.road.vehicles[place] for place in driven or [0]]
    env.define_spaces()
    if not driven:
        # The road lets it act at every tick, and a second time would be once too often.
        env.action_type.act = known.heeds_nothing
    env.time, env.steps, env.done = 0, 0, False
    return env


def command_table(env: Any) -> Any:
    """What the nine discrete actions of a driven vehicle stand for, [9, 2]: m/s^2 and rad.

    highway-env computes them in float32 (`float32-actions`), so that a steering of pi / 50 is not
    exactly that; comparisons in float64 must use these values.
    """
    kind = env.unwrapped.action_type
    kind = getattr(kind, "agents_action_types", [kind])[0]
    vehicle = kind.controlled_vehicle
    stored = dict(vehicle.action)
    table = []
    for action in range(kind.space().n):
        kind.act(action)
        table.append([float(vehicle.action[name]) for name in ("acceleration", "steering")])
    vehicle.action = stored
    return np.array(table)
