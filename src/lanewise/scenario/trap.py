"""The trap: a slow car ahead of the ego, another beside it, and traffic beyond.

Vehicles, in order: the ego, trap car 1 (ahead, same lane), trap car 2 (one lane to the right),
traffic ahead, traffic behind. A start is a function of (settings, seed, split, index) alone, so
it is the same start in every world, batch and process.
"""

from dataclasses import replace

import jax
import jax.numpy as jnp
from jax import Array

from lanewise.scenario.settings import TrapSettings
from lanewise.world import build, road
from lanewise.world.settings import DriverSettings
from lanewise.world.state import CONSTANT, EXTERNAL, RULE_BASED, Drivers, Road, World

SPLITS = ("training", "validation", "test")
"""Where a start comes from; each split draws from its own key stream."""
TRAP_CARS = (1, 2)
"""Indices of the trap cars."""


def vehicle_count(settings: TrapSettings) -> int:
    """Number of vehicles, the ego included."""
    traffic = settings.traffic
    return 3 + traffic.vehicles_ahead + traffic.vehicles_behind


def roles(settings: TrapSettings) -> list[int]:
    """Role of each vehicle: 0 the ego, 1 a trap car, 2 traffic."""
    return [0, 1, 1] + [2] * (vehicle_count(settings) - 3)


def start_key(seed: int | Array, split: str, index: int | Array) -> Array:
    """The random key of start ``index`` of a split under ``seed``."""
    stream = jax.random.fold_in(jax.random.key(seed), SPLITS.index(split))
    return jax.random.fold_in(stream, index)


def sample(settings: TrapSettings, key: Array, split: str) -> World:
    """A start: where everyone stands, float32.

    In the training and validation splits D1 and D2 are drawn from their ranges, in the test split
    they are fixed; the traffic is drawn in all of them.
    """
    distances_key, lanes_key, spacing_key = jax.random.split(key, 3)
    front, side = _distances(settings, distances_key, split)
    traffic_x = _traffic_positions(settings, spacing_key, jnp.maximum(front, side))
    traffic = traffic_x.shape[0]
    lane = jnp.concatenate(
        [
            jnp.asarray([0, 0, 1], jnp.int32),
            jax.random.randint(lanes_key, (traffic,), 0, settings.lanes, jnp.int32),
        ]
    )
    x = jnp.concatenate([jnp.stack([jnp.zeros_like(front), front, side]), traffic_x])
    speed = jnp.asarray(
        [settings.ego_speed, settings.trap_speed, settings.trap_speed]
        + [settings.traffic.speed] * traffic,
        jnp.float32,
    )
    lanes = _lanes(settings)
    return World(
        road=lanes,
        drivers=_drivers(settings, traffic),
        vehicles=build.make_vehicles(x, road.pick(lanes.centre, lane), speed, lane),
    )


def escaped(world: World) -> Array:
    """Whether the ego's rear bumper is past the front bumpers of all trap cars now; bool []."""
    x, half = world.vehicles.x, world.drivers.length / 2.0
    rear = x[0] - half[0]
    return jnp.stack([rear > x[car] + half[car] for car in TRAP_CARS]).all()


def _lanes(settings: TrapSettings) -> Road:
    """The road: from the ego's start on, or from behind the last vehicle behind it.

    Neighbours are looked for only on the road, so one that began at the ego would hide the
    vehicles behind from one another.
    """
    lanes = road.straight_road(settings.lanes, settings.lane_width, settings.speed_limit)
    traffic = settings.traffic
    if not traffic.vehicles_behind:
        return lanes
    reach = traffic.gap_behind + traffic.vehicles_behind * (
        traffic.spacing + traffic.spacing_jitter
    )
    return replace(lanes, start=jnp.full_like(lanes.start, -reach))


def _distances(settings: TrapSettings, key: Array, split: str) -> tuple[Array, Array]:
    """(D1, D2) of a start, m."""
    if split == "test":
        return (
            jnp.float32(settings.test_front_distance),
            jnp.float32(settings.test_side_distance),
        )
    low1, high1 = settings.training_front_distance
    low2, high2 = settings.training_side_distance
    draw = jax.random.uniform(key, (2,), jnp.float32)
    return low1 + (high1 - low1) * draw[0], low2 + (high2 - low2) * draw[1]


def _traffic_positions(settings: TrapSettings, key: Array, trap_x: Array) -> Array:
    """Places of the vehicles ahead, then of those behind, m: a first gap, then jittered ones."""
    traffic = settings.traffic
    jitter = jax.random.uniform(
        key, (traffic.vehicles_ahead + traffic.vehicles_behind,), jnp.float32, -1.0, 1.0
    )
    spacing = traffic.spacing + traffic.spacing_jitter * jitter
    ahead = spacing[: traffic.vehicles_ahead]
    behind = spacing[traffic.vehicles_ahead :]
    first_ahead = traffic.first_gap - traffic.spacing
    first_behind = traffic.gap_behind - traffic.spacing
    return jnp.concatenate(
        [trap_x + first_ahead + jnp.cumsum(ahead), -(first_behind + jnp.cumsum(behind))]
    )


def _drivers(settings: TrapSettings, traffic: int) -> Drivers:
    """Drivers of the ego, the trap cars and the traffic, in this order."""
    by_rules = settings.ego_driver == "rule-based"
    ego = settings.traffic.driver if by_rules else DriverSettings(target_speed=settings.ego_speed)
    trap_car = DriverSettings(target_speed=settings.trap_speed)
    return build.make_drivers(
        [ego, trap_car, trap_car] + [settings.traffic.driver] * traffic,
        [RULE_BASED if by_rules else EXTERNAL, CONSTANT, CONSTANT] + [RULE_BASED] * traffic,
        missing_target_speed=settings.missing_target_speed,
    )
