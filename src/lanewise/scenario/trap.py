"""The trap: a slow car ahead of the ego, another beside it, and traffic beyond.

Vehicles, in order: the ego, trap car 1 (ahead, same lane), trap car 2 (one lane to the right),
traffic ahead, traffic behind. A start is a function of (settings, seed, split, index) alone, so
it is the same start in every world, batch and process.
"""

from dataclasses import dataclass, replace
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from jax.typing import ArrayLike
from numpy.typing import NDArray

from lanewise.scenario import drivers
from lanewise.scenario.settings import TrapSettings
from lanewise.system import pinned
from lanewise.world import build, road, waves
from lanewise.world.settings import CAR_LENGTH
from lanewise.world.state import CONSTANT, RULE_BASED, Drivers, World, select_by_index

SPLITS = ("training", "validation", "test")
"""Where a start comes from; each split draws from its own key stream."""
TRAP_CARS = (1, 2)
"""Indices of the trap cars in the starts made here; see `trap_cars` for those of any world."""

# A start's key is split in three, for D1 and D2, the traffic's lanes and its gaps. Splitting counts
# from 0, and so does folding in, so that numbers drawn since then fold in what comes after.
_STREAMS = {
    "ego_speed": 3,
    "trap_speed": 4,
    "lanes": 5,
    "trap_speed_difference": 6,
    "trap_speed_wave": 7,
    "traffic_speed": 8,
    "spacing": 9,
    "vehicles_ahead": 10,
    "vehicles_behind": 11,
    "gap_behind": 12,
}
_TRAP_STREAM, _TRAFFIC_STREAM = 20, 21
WHOLE = ("lanes", "vehicles_ahead", "vehicles_behind")
"""What is drawn as a whole number."""
BUFFER = 1.0
"""Distance that an ego which brakes in time keeps from the trap car ahead, m."""


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
    """m/s, of both trap cars; of the first where they differ."""
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
    trap_speed_difference: ArrayLike
    """How much faster trap car 2 is, m/s."""
    trap_speed_wave: ArrayLike
    """How far the trap cars' speeds swing, m/s; 0 where the settings have no waves."""
    traffic_speed: ArrayLike
    """Of the traffic at the start, m/s."""
    gap_behind: ArrayLike
    """From the ego to the first vehicle behind, m."""

    @classmethod
    def of(cls, settings: TrapSettings, **others: Any) -> "Start":
        """The numbers of the settings' test starts, but for some."""
        traffic = settings.traffic
        numbers = {
            "lanes": settings.lanes,
            "ego_speed": settings.ego_speed,
            "trap_speed": settings.trap_speed,
            "front_distance": settings.test_front_distance,
            "side_distance": settings.test_side_distance,
            "spacing": traffic.spacing,
            "vehicles_ahead": traffic.vehicles_ahead,
            "vehicles_behind": traffic.vehicles_behind,
            "trap_speed_difference": settings.trap_speed_difference,
            "trap_speed_wave": settings.trap_speed_wave,
            "traffic_speed": traffic.speed,
            "gap_behind": traffic.gap_behind,
        }
        return cls(**numbers | others)


def sample(settings: TrapSettings, key: Array, split: str) -> World:
    """A start: where everyone stands, float32.

    The traffic is drawn in all splits. In the training and validation splits D1 and D2 are drawn
    from their ranges, and whatever else has one; in the test split all of these are fixed.
    """
    return place(of_split(settings, split), draw(settings, key, split), key)


def of_split(settings: TrapSettings, split: str) -> TrapSettings:
    """The settings with the most of everything that a split's starts have, and its populations.

    Lanes and vehicles that a start lacks are absent ones.
    """
    if split == "test":
        return settings

    def most(name: str, value: Any) -> Any:
        return max(getattr(settings, f"training_{name}"), default=value)

    traffic = replace(
        settings.traffic,
        vehicles_ahead=most("vehicles_ahead", settings.traffic.vehicles_ahead),
        vehicles_behind=most("vehicles_behind", settings.traffic.vehicles_behind),
        populations=settings.training_populations or settings.traffic.populations,
    )
    return replace(
        settings,
        lanes=most("lanes", settings.lanes),
        trap_speed_wave=most("trap_speed_wave", settings.trap_speed_wave),
        traffic=traffic,
    )


def draw(settings: TrapSettings, key: Array, split: str) -> Start:
    """The numbers of a start: drawn where the split has a range for them, else as set."""
    if split == "test":
        return Start.of(settings)
    front, side = _distances(settings, jax.random.split(key, 3)[0])
    drawn = {"front_distance": front, "side_distance": side}
    for name, stream in _STREAMS.items():
        between = getattr(settings, f"training_{name}")
        if between:
            draws = _whole if name in WHOLE else _uniform
            drawn[name] = draws(jax.random.fold_in(key, stream), *between)
    start = Start.of(settings, **drawn)
    if settings.training_braking:
        room = jnp.maximum(front - CAR_LENGTH - BUFFER, 0.0)
        fastest = start.trap_speed + jnp.sqrt(2.0 * settings.training_braking * room)
        start = replace(start, ego_speed=jnp.minimum(start.ego_speed, fastest))
    return start


def place(settings: TrapSettings, start: Start, key: Array) -> World:
    """The world with these numbers, float32; ``key`` draws the traffic's lanes, gaps and drivers.

    The settings have at least as many lanes and vehicles as the start; what it lacks is absent.
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
    who, speed = _drivers(settings, start, key, traffic)
    where = road.straight_road(
        start.lanes, settings.lane_width, settings.speed_limit, settings.lanes
    )
    vehicles = build.make_vehicles(x, select_by_index(where.centre, lane), speed, lane)
    vehicles = replace(vehicles, present=_present(settings, start))
    return World(road=where, drivers=who, vehicles=vehicles)


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


def _distances(settings: TrapSettings, key: Array) -> tuple[Array, Array]:
    """(D1, D2) of a training start, m."""
    low1, high1 = settings.training_front_distance
    low2, high2 = settings.training_side_distance
    draw = jax.random.uniform(key, (2,), jnp.float32)
    return low1 + (high1 - low1) * draw[0], low2 + (high2 - low2) * draw[1]


def _whole(key: Array, low: int, high: int) -> Array:
    """A whole number between two, both included."""
    return jax.random.randint(key, (), low, high + 1, jnp.int32)


def _uniform(key: Array, low: float, high: float) -> Array:
    """A number between two."""
    return low + (high - low) * jax.random.uniform(key, (), jnp.float32)


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
    first_behind = jnp.asarray(start.gap_behind) - start.spacing
    return jnp.concatenate(
        [trap_x + first_ahead + jnp.cumsum(ahead), -(first_behind + jnp.cumsum(behind))]
    )


def _drivers(
    settings: TrapSettings, start: Start, key: Array, traffic: int
) -> tuple[Drivers, Array]:
    """(drivers, speeds at the start, m/s [N]) of the ego, the trap cars and the traffic."""
    trap_key, traffic_key = (jax.random.fold_in(key, i) for i in (_TRAP_STREAM, _TRAFFIC_STREAM))
    second = start.trap_speed + start.trap_speed_difference
    first_three = jnp.asarray([start.ego_speed, start.trap_speed, second], jnp.float32)
    own = drivers.of_first_three(settings, trap_key, first_three, start.trap_speed_wave)
    others = drivers.of_traffic(settings, traffic_key, traffic, start.traffic_speed)
    if others.linear is not None and own.linear is None:
        own = replace(own, linear=build.nobody_linear(3))
    if own.linear is not None and others.linear is None:
        others = replace(others, linear=build.nobody_linear(traffic))
    everybody: Drivers = jax.tree.map(lambda *parts: jnp.concatenate(parts), own, others)
    traffic_speeds = jnp.full(traffic, start.traffic_speed, jnp.float32)
    speed = jnp.concatenate([first_three, traffic_speeds])
    if everybody.waves is not None:
        # A trap car begins at the speed of its wave.
        constant = everybody.kind == CONSTANT
        speed = jnp.where(constant, waves.speed(everybody.waves, 0.0), speed)
    return everybody, speed
