"""The trap: a slow car ahead of the ego, another beside it, and traffic beyond.

Vehicles, in order: the ego, trap car 1 (ahead, same lane), trap car 2 (one lane to the right),
traffic ahead, traffic behind. A start is a function of (settings, seed, split, index) alone, so
it is the same start in every world, batch and process.
"""

from dataclasses import dataclass, replace

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from jax.typing import ArrayLike
from numpy.typing import NDArray

from lanewise.scenario.settings import TrapSettings
from lanewise.system import pinned
from lanewise.world import build, road
from lanewise.world.settings import DriverSettings
from lanewise.world.state import CONSTANT, EXTERNAL, RULE_BASED, Drivers, World, select_by_index

SPLITS = ("training", "validation", "test")
"""Where a start comes from; each split draws from its own key stream."""
TRAP_CARS = (1, 2)
"""Indices of the trap cars in the starts made here; see `trap_cars` for those of any world."""

# A start's key is split in three, for D1 and D2, the traffic's lanes and its gaps. Splitting counts
# from 0, and so does folding in, so that numbers drawn since then fold in what comes after.
_EGO_STREAM, _TRAP_STREAM, _LANES_STREAM = 3, 4, 5


def vehicle_count(settings: TrapSettings) -> int:
    """Number of vehicles, the ego included."""
    traffic = settings.traffic
    return 3 + traffic.vehicles_ahead + traffic.vehicles_behind


def trap_cars(world: World) -> Array:
    """Which vehicles are trap cars: there, not the ego, and not driven by rules; bool [N]."""
    kind = world.drivers.kind
    others = jnp.arange(kind.shape[0]) > 0
    # highway-env knows no other plain vehicles than the ego and CONSTANT ones.
    return world.vehicles.present & others & (kind != RULE_BASED)


def roles(world: World) -> NDArray[np.int8]:
    """Role of each vehicle: 0 the ego, 1 a trap car, 2 traffic; int8 [N]."""
    role = np.where(np.asarray(trap_cars(world)), 1, 2).astype(np.int8)
    role[0] = 0
    return role


def start_key(seed: int | Array, split: str, index: int | Array) -> Array:
    """The random key of start ``index`` of a split under ``seed``."""
    stream = jax.random.fold_in(pinned.key(seed), SPLITS.index(split))
    return jax.random.fold_in(stream, index)


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Start:
    """The numbers that make a start; each a plain number or a traced scalar.

    Only maxima are static, so that one compilation places, and drives, any of them.
    """

    lanes: int | Array
    """Number of lanes."""
    ego_speed: ArrayLike
    """m/s."""
    trap_speed: ArrayLike
    """m/s, of both trap cars."""
    front_distance: ArrayLike
    """D1, from the ego to trap car 1, centre to centre, m."""
    side_distance: ArrayLike
    """D2, from the ego to trap car 2 along the road, m."""
    spacing: ArrayLike
    """Mean distance from one traffic vehicle to the next, m."""
    vehicles_ahead: int | Array
    """Traffic vehicles beyond the trap, at most as many as the settings have."""
    vehicles_behind: int | Array
    """Traffic vehicles behind the ego, at most as many as the settings have."""


def sample(settings: TrapSettings, key: Array, split: str) -> World:
    """A start: where everyone stands, float32.

    The traffic is drawn in all splits. In the training and validation splits D1 and D2 are drawn
    from their ranges, and the speeds and the number of lanes where they have one; in the test split
    all of these are fixed.
    """
    return place(settings, draw(settings, key, split), key, lanes_max(settings, split))


def lanes_max(settings: TrapSettings, split: str) -> int:
    """Static number of lanes of a split's worlds; the lanes a start lacks are absent ones."""
    if split == "test" or not settings.training_lanes:
        return settings.lanes
    return settings.training_lanes[1]


def draw(settings: TrapSettings, key: Array, split: str) -> Start:
    """The numbers of a start: drawn where the split has a range for them, else as set."""
    front, side = _distances(settings, jax.random.split(key, 3)[0], split)
    drawn = split != "test"
    lanes: int | Array = settings.lanes
    if drawn and settings.training_lanes:
        low, high = settings.training_lanes
        lanes = jax.random.randint(
            jax.random.fold_in(key, _LANES_STREAM), (), low, high + 1, jnp.int32
        )

    def speed(fixed: float, between: tuple[float, ...], stream: int) -> ArrayLike:
        if not (drawn and between):
            return fixed
        share = jax.random.uniform(jax.random.fold_in(key, stream), (), jnp.float32)
        return between[0] + (between[1] - between[0]) * share

    return Start(
        lanes=lanes,
        ego_speed=speed(settings.ego_speed, settings.training_ego_speed, _EGO_STREAM),
        trap_speed=speed(settings.trap_speed, settings.training_trap_speed, _TRAP_STREAM),
        front_distance=front,
        side_distance=side,
        spacing=settings.traffic.spacing,
        vehicles_ahead=settings.traffic.vehicles_ahead,
        vehicles_behind=settings.traffic.vehicles_behind,
    )


def place(settings: TrapSettings, start: Start, key: Array, lanes: int) -> World:
    """The world with these numbers, float32; ``key`` draws the traffic's lanes and gaps.

    ``lanes`` is the static number of lanes, at least ``start.lanes``. Lanes and traffic that the
    start has fewer of are absent.
    """
    _, lanes_key, spacing_key = jax.random.split(key, 3)
    front = jnp.asarray(start.front_distance, jnp.float32)
    side = jnp.asarray(start.side_distance, jnp.float32)
    traffic_x = _traffic_positions(settings, start, spacing_key, jnp.maximum(front, side))
    traffic = traffic_x.shape[0]
    lane = jnp.concatenate(
        [
            jnp.asarray([0, 0, 1], jnp.int32),
            jax.random.randint(lanes_key, (traffic,), 0, start.lanes, jnp.int32),
        ]
    )
    x = jnp.concatenate([jnp.stack([jnp.zeros_like(front), front, side]), traffic_x])
    speed = jnp.asarray(
        [start.ego_speed, start.trap_speed, start.trap_speed] + [settings.traffic.speed] * traffic,
        jnp.float32,
    )
    where = road.straight_road(start.lanes, settings.lane_width, settings.speed_limit, lanes)
    vehicles = build.make_vehicles(x, select_by_index(where.centre, lane), speed, lane)
    return World(
        road=where,
        drivers=_drivers(settings, start),
        vehicles=replace(vehicles, present=_present(settings, start)),
    )


def escaped(world: World) -> Array:
    """Whether the ego's rear bumper is past the front bumpers of all trap cars now; bool []."""
    x, half = world.vehicles.x, world.drivers.length / 2.0
    rear, fronts = x[0] - half[0], x + half
    return jnp.all((rear > fronts) | ~trap_cars(world))


def _present(settings: TrapSettings, start: Start) -> Array:
    """Which vehicles exist: the ego, the trap, and as much traffic as the start has; bool [N]."""
    traffic = settings.traffic
    return jnp.concatenate(
        [
            jnp.ones(3, bool),
            jnp.arange(traffic.vehicles_ahead) < start.vehicles_ahead,
            jnp.arange(traffic.vehicles_behind) < start.vehicles_behind,
        ]
    )


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


def _traffic_positions(settings: TrapSettings, start: Start, key: Array, trap_x: Array) -> Array:
    """Places of the vehicles ahead, then of those behind, m: a first gap, then jittered ones."""
    traffic = settings.traffic
    jitter = jax.random.uniform(
        key, (traffic.vehicles_ahead + traffic.vehicles_behind,), jnp.float32, -1.0, 1.0
    )
    spacing = start.spacing + traffic.spacing_jitter * jitter
    ahead = spacing[: traffic.vehicles_ahead]
    behind = spacing[traffic.vehicles_ahead :]
    first_ahead = traffic.first_gap - start.spacing
    first_behind = traffic.gap_behind - start.spacing
    return jnp.concatenate(
        [trap_x + first_ahead + jnp.cumsum(ahead), -(first_behind + jnp.cumsum(behind))]
    )


def _drivers(settings: TrapSettings, start: Start) -> Drivers:
    """Drivers of the ego, the trap cars and the traffic, in this order."""
    traffic = vehicle_count(settings) - 3
    by_rules = settings.ego_driver == "rule-based"
    ego = settings.traffic.driver if by_rules else DriverSettings()
    drivers = build.make_drivers(
        [ego, DriverSettings(), DriverSettings()] + [settings.traffic.driver] * traffic,
        [RULE_BASED if by_rules else EXTERNAL, CONSTANT, CONSTANT] + [RULE_BASED] * traffic,
        missing_target_speed=settings.missing_target_speed,
    )
    if settings.missing_target_speed:
        return drivers
    ego_speed = drivers.target_speed[0] if by_rules else start.ego_speed
    own = jnp.asarray([ego_speed, start.trap_speed, start.trap_speed], jnp.float32)
    return replace(drivers, target_speed=drivers.target_speed.at[:3].set(own))
