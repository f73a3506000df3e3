"""Can a start of the trap be won at all? A search over the nine actions, without other traffic.

The ego's reachable set among the trap cars is spread decision by decision, with the world's own
motion, collisions and accidents, so that every state in it lies at the end of a real trajectory.
Kept narrow, alike states merged, it finds an escape fast where one is easy to find; kept whole,
only states that are the same to the last bit are merged, because a grid, however fine, would merge
away the escapes that pass the trap by centimetres. A start is unwinnable only where the whole set
holds no escape.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from numpy.typing import NDArray

from lanewise.driving import accidents, actions, episode
from lanewise.driving.episode import Episode
from lanewise.driving.settings import DrivingSettings
from lanewise.scenario import trap
from lanewise.scenario.settings import TrapSettings
from lanewise.scenario.trap import Start
from lanewise.system import pinned
from lanewise.world import bicycle, collision, motion
from lanewise.world.state import World

KNOWN = 32
"""Escapes of other starts that are tried before any search."""
CHUNK = 512
"""States spread at once."""
WIDTHS = (256, 4096)
"""States that the narrow searches keep after each decision, one search after the other."""
MOST_STATES = 200_000
"""A whole set larger than this is not about to die out, and is narrowed."""
ALONG, ACROSS, TURN = 1.0, 0.25, 0.03
"""Cells of the narrow searches: m, m and rad; speeds differ by whole actions."""

Decided = tuple[Episode, Array]
"""An episode, and whether it has failed by now."""


@dataclass(frozen=True)
class ReachabilityConfig:
    """What stays the same from start to start. Static."""

    scenario: TrapSettings
    """Its number of lanes is the largest of a start."""
    driving: DrivingSettings
    duration: int
    """Decisions within which the ego must escape, and must have no accident."""
    clearance: float = 0.0
    """The trap cars are larger by this on every side, m: escapes keep that distance from them."""


class Layer(NamedTuple):
    """The states reached after so many decisions."""

    egos: NDArray[np.float32]
    """[S, 4] the ego's x in m, y in m, heading in rad, speed in m/s."""
    escaped: NDArray[np.bool_]
    """[S] whether it has been past the trap."""
    parent: NDArray[np.intp]
    """[S] the state before, in the layer before."""
    action: NDArray[np.intp]
    """[S] the action that led here from it."""

    def at(self, states: NDArray[np.intp]) -> "Layer":
        """Some of the states."""
        return Layer(*(values[states] for values in self))  # type: ignore[arg-type]


@dataclass(frozen=True)
class Verdict:
    """Whether a start can be won, and how that is known."""

    winnable: bool
    """False only where the whole reachable set holds no escape."""
    actions: tuple[int, ...]
    """An escape, one action a decision, confirmed in the world; empty if none was found."""
    states: int
    """States visited by the exhaustive search; 0 where none was needed."""

    @property
    def decided(self) -> bool:
        """False where the search was given up; the start then counts as winnable."""
        return bool(self.actions) or not self.winnable


def judge(
    config: ReachabilityConfig, start: Start, known: Sequence[tuple[int, ...]] = ()
) -> Verdict:
    """Whether the ego can be past the trap and have no accident within the config's duration.

    Of ``known``, escapes of other starts and the most promising first, the first `KNOWN` are tried.
    The traffic of ``start`` does not matter.
    """
    for escape, holds in zip(known, replay(config, start, known[:KNOWN]), strict=False):
        if holds:
            return Verdict(True, escape, 0)
    world = begin(config, start)
    for width in WIDTHS:
        layers, _ = _search(config, world, width)
        if escape := _confirmed(config, start, layers):
            return Verdict(True, escape, 0)
    layers, whole = _search(config, world, None)
    states = sum(len(layer.egos) for layer in layers[1:])
    return Verdict(not whole, () if whole else _confirmed(config, start, layers), states)


def replay(
    config: ReachabilityConfig, start: Start, sequences: Sequence[tuple[int, ...]]
) -> NDArray[np.bool_]:
    """Which of at most `KNOWN` action sequences, each of the config's duration, are escapes.

    They are driven in the world as any test episode is: past the trap at the end of some decision,
    and no accident.
    """
    if not sequences:
        return np.zeros(0, bool)
    padded = np.full((KNOWN, config.duration), actions.IDLE, np.int32)
    padded[: len(sequences)] = sequences
    world = begin(config, start)
    escaped: NDArray[np.bool_] = np.asarray(_replay(config.driving, world, padded))
    return escaped[: len(sequences)]


@pinned.jit(static_argnums=0)
def _replay(driving: DrivingSettings, world: World, sequences: Array) -> Array:
    """Whether each of [B, T] actions is an escape, [B]."""

    def drive(chosen: Array) -> Array:
        def decide(before: Decided, action: Array) -> tuple[Decided, None]:
            after = episode.step(driving, before[0], action, chosen.size)
            return (after, before[1] | after.outcome.terminated), None

        (after, failed), _ = jax.lax.scan(decide, (episode.begin(world), jnp.bool_(False)), chosen)
        won: Array = after.stats.escaped & ~failed
        return won

    return jax.vmap(drive)(sequences)


def _confirmed(
    config: ReachabilityConfig, start: Start, layers: Sequence[Layer]
) -> tuple[int, ...]:
    """The actions that led to the first escaped state of the last layer, if they hold."""
    won = np.flatnonzero(layers[-1].escaped)
    if len(layers) <= config.duration or not len(won):
        return ()
    state, backwards = int(won[0]), []
    for layer in reversed(layers[1:]):
        backwards.append(int(layer.action[state]))
        state = int(layer.parent[state])
    escape = tuple(reversed(backwards))
    return escape if replay(config, start, [escape])[0] else ()


def _search(
    config: ReachabilityConfig, world: World, width: int | None
) -> tuple[list[Layer], bool]:
    """The reachable set from ``world`` up to the duration, or until nothing is left.

    ``width`` states are kept after each decision. None keeps all, until one has escaped or they
    are more than `MOST_STATES`: then the start is not shown to be unwinnable, and what remains is
    to bring an escape to its end.

    Returns:
        (the layers, from the start on; whether nothing was left out: then they hold no escape).
    """
    vehicles = world.vehicles
    ego = [np.asarray(of)[:1] for of in (vehicles.x, vehicles.y, vehicles.heading, vehicles.speed)]
    nothing = np.zeros(1, np.intp)
    whole = width is None
    layers = [Layer(np.stack(ego, axis=1), np.zeros(1, bool), nothing, nothing)]
    for _ in range(config.duration):
        spread = _spread(config, world, layers[-1])
        world = _coast(config.driving, world)
        if width is None and (spread.escaped.any() or len(spread.egos) > MOST_STATES):
            width, whole = WIDTHS[-1], False
        layers.append(_chosen(config, world, spread, width))
        if not len(spread.egos):
            break
    return layers, whole


def _spread(config: ReachabilityConfig, world: World, before: Layer) -> Layer:
    """Every action from every state; what has an accident is left out."""
    count = len(before.egos)
    padded = np.concatenate([before.egos, np.repeat(before.egos[-1:], -count % CHUNK, axis=0)])
    parts = [
        jax.device_get(_step_all(config.driving, world, padded[first : first + CHUNK]))
        for first in range(0, len(padded), CHUNK)
    ]
    egos, alive, past = (np.concatenate(part)[:count] for part in zip(*parts, strict=True))
    parent, action = np.nonzero(alive)
    escaped = before.escaped[parent] | past[parent, action]
    return Layer(egos[parent, action], escaped, parent, action)


def _chosen(config: ReachabilityConfig, world: World, layer: Layer, width: int | None) -> Layer:
    """One state of each cell: the most promising ones, or with no width all, merged if the same."""
    if not len(layer.egos):
        return layer
    if width is None:
        rows = np.concatenate([layer.egos, layer.escaped[:, None]], axis=1, dtype=np.float32)
        _, first = np.unique(rows, axis=0, return_index=True)
        return layer.at(first)
    order = np.argsort(_urgency(world, layer), kind="stable")
    _, first = np.unique(_cells(config, layer)[order], return_index=True)
    return layer.at(order[np.sort(first)[:width]])


def _cells(config: ReachabilityConfig, layer: Layer) -> NDArray[np.int64]:
    """The cell each state lies in, as one number; [S]."""
    quantum = config.driving.actions.acceleration * config.driving.decision_duration
    cell = layer.escaped.astype(np.int64)
    for values, size in zip(layer.egos.T, (ALONG, ACROSS, TURN, quantum), strict=True):
        # Speeds stand in the middle of their cells, not on an edge.
        cell = 100_003 * cell + np.floor(values.astype(np.float64) / size + 0.5).astype(np.int64)
    return cell


def _urgency(world: World, layer: Layer) -> NDArray[np.float64]:
    """A guess at the seconds to the escape, [S]; only the order of searching depends on it.

    The time to be past the trap, accelerating, and a second for every metre still missing to the
    right of both trap cars. Escaped states come first, the straightest ahead.
    """
    x, y, heading, speed = layer.egos.T.astype(np.float64)
    cars = np.asarray(world.vehicles.x)[list(trap.TRAP_CARS)]
    length, width = (float(np.max(of)) for of in (world.drivers.length, world.drivers.width))
    ahead = np.maximum(cars.max() + length - x, 0.0)
    faster = speed - float(world.vehicles.speed[1])
    aside = np.asarray(world.vehicles.y)[list(trap.TRAP_CARS)].max() + 1.1 * width - y
    to_go = np.sqrt(faster**2 + 2.0 * ahead) - faster + np.maximum(aside, 0.0)
    centres = np.asarray(world.road.centre)[np.asarray(world.road.present)]
    offset = np.abs(y[:, None] - centres).min(axis=1)
    urgency: NDArray[np.float64] = np.where(
        layer.escaped, -100.0 + 20.0 * np.abs(heading) + offset, to_go
    )
    return urgency


@pinned.jit(static_argnums=0)
def begin(config: ReachabilityConfig, start: Start) -> World:
    """The trap alone, whatever the traffic of ``start``, its cars grown by the clearance."""
    traffic = replace(config.scenario.traffic, vehicles_ahead=0, vehicles_behind=0)
    scenario = replace(config.scenario, traffic=traffic)
    alone = replace(start, vehicles_ahead=0, vehicles_behind=0)
    # The key draws traffic and the phases of waves; this start has neither.
    world = trap.place(scenario, alone, pinned.key(0))
    grown = 2.0 * config.clearance * jnp.asarray([0.0, 1.0, 1.0])
    drivers = world.drivers
    return replace(
        world,
        drivers=replace(drivers, length=drivers.length + grown, width=drivers.width + grown),
    )


@pinned.jit(static_argnums=0)
def _step_all(driving: DrivingSettings, world: World, egos: Array) -> tuple[Array, Array, Array]:
    """Every action from each of [B, 4] egos: ([B, 9, 4] egos, [B, 9] alive, [B, 9] past)."""
    each_action = jax.vmap(partial(_step, driving, world), in_axes=(None, 0))
    return jax.vmap(each_action, in_axes=(0, None))(egos, jnp.arange(actions.COUNT))


def _step(
    driving: DrivingSettings, world: World, ego: Array, action: Array
) -> tuple[Array, Array, Array]:
    """One decision of the ego among the trap cars of ``world``."""
    vehicles = world.vehicles
    state = (vehicles.x, vehicles.y, vehicles.heading, vehicles.speed)
    x, y, heading, speed = (old.at[0].set(own) for old, own in zip(state, ego, strict=True))
    world = replace(world, vehicles=replace(vehicles, x=x, y=y, heading=heading, speed=speed))
    world = bicycle.command(world, *actions.commands(driving.actions, action, ego.dtype))
    world = _ticks(driving, world)
    after = world.vehicles
    # A hit predicted for the next tick will come whatever is done.
    dead = accidents.ego_accident(world, driving.stopped_speed) != accidents.NONE
    alive = ~dead & ~after.impacted[0]
    moved = jnp.stack([after.x[0], after.y[0], after.heading[0], after.speed[0]])
    return moved, alive, trap.escaped(world)


@pinned.jit(static_argnums=0)
def _coast(driving: DrivingSettings, world: World) -> World:
    """The trap cars a decision later, whatever the ego has done."""
    present = world.vehicles.present
    alone = replace(world, vehicles=replace(world.vehicles, present=present.at[0].set(False)))
    later = _ticks(driving, alone)
    return replace(later, vehicles=replace(later.vehicles, present=present))


def _ticks(driving: DrivingSettings, world: World) -> World:
    """The ticks of a decision; all a tick does where nobody drives by rules is to move and to hit.

    Leaving the drivers' look around out makes it three times as fast.
    """
    duration = driving.tick_duration

    def tick(_: int, state: World) -> World:
        moved = bicycle.move(state, motion.heading_trig(state.vehicles), duration)
        return collision.resolve(moved, motion.heading_trig(moved.vehicles), duration)

    later: World = jax.lax.fori_loop(0, driving.ticks_per_decision, tick, world)
    return later
