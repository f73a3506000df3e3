"""Reference drivers, which need no training: the rules of the traffic, and a search.

`RuleBased` is IDM along the road and MOBIL across it, as all traffic drives. `Search` knows what no
driver knows: how everybody will drive. At an episode's start it plans all of it by beam search over
the nine actions, with the world itself as its model, then carries the plan out. What it finds is a
real drive, so the best possible one is at least as good; how much better is not known.
"""

from dataclasses import dataclass, replace
from typing import Any, Self

import jax
import jax.numpy as jnp
from jax import Array

from lanewise.controllers.controller import WithoutGoals
from lanewise.controllers.settings import SearchSettings
from lanewise.driving import actions, episode, observation
from lanewise.driving.episode import Episode
from lanewise.driving.percept import Percept
from lanewise.driving.settings import DrivingSettings
from lanewise.scenario import trap
from lanewise.world import road
from lanewise.world.state import World

SPEEDS = (6.0, 8.0, 10.0, 12.0, 14.0)
"""Bounds of the speed classes, m/s."""
LEADS = (-14.0, -9.0, -5.0, 5.0)
"""Bounds of the classes of how far the ego is ahead of the last trap car, centre to centre, m."""
ASIDE = 0.7
"""Farther than this from its lane's centre, a state counts as left or right of it, m."""
CELL = (1.0, 0.2, 0.02, 0.5)
"""States this near in x (m), y (m), heading (rad) and speed (m/s) count as the same."""
_CELLS = (1024, 128, 128, 64)
"""Cells along each of them; together they fit in 31 bits."""


@dataclass(frozen=True)
class RuleBased(WithoutGoals):
    """Nothing to decide: the world itself drives the ego (`TrapSettings.ego_driver`)."""

    name: str = "rule-based"
    levels: tuple[()] = ()

    @classmethod
    def from_settings(cls, settings: Any, *, name: str, renewal: str, observed: int) -> Self:
        """See `registry.make`."""
        return cls()

    def start(self, percept: Percept) -> tuple[()]:
        """Nothing to remember."""
        return ()

    def act(self, memory: tuple[()], percept: Percept) -> tuple[Array, tuple[()]]:
        """No command; a rule-based vehicle would ignore one."""
        return jnp.int32(actions.IDLE), memory


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Plan:
    """A plan being carried out."""

    actions: Array
    """int32 [T] low-level actions."""
    next: Array
    """int32 [] decisions taken."""


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Beam:
    """The B drives under consideration."""

    episodes: Episode
    """[B] where each has come to."""
    reward: Array
    """[B] sum of the external rewards so far; minus infinity for an empty place."""
    actions: Array
    """int32 [B, T] how."""


@dataclass(frozen=True)
class Search(WithoutGoals):
    """Plans by beam search, the best of each class of states kept."""

    driving: DrivingSettings
    search: SearchSettings
    duration: int
    """Decisions planned."""
    name: str = "search"
    levels: tuple[()] = ()

    @classmethod
    def from_settings(cls, settings: Any, *, name: str, renewal: str, observed: int) -> Self:
        """See `registry.make`."""
        duration = settings.driving.decisions_in(settings.evaluation.duration)
        return cls(settings.driving, settings.search, duration)

    def start(self, percept: Percept) -> Plan:
        """The whole plan; a `ValueError` if the percept shows no traffic."""
        if percept.world is None:
            raise ValueError("the search needs a privileged percept")
        return Plan(actions=plan(self, percept.world), next=jnp.int32(0))

    def act(self, memory: Plan, percept: Percept) -> tuple[Array, Plan]:
        """The next action of the plan."""
        return memory.actions[memory.next], replace(memory, next=memory.next + 1)


def plan(settings: Search, world: World) -> Array:
    """The best action sequence that the beam search finds, int32 [T].

    Every drive in the beam is prolonged by each of the nine actions in the real world model. Drives
    that end in an accident are dropped; of those that are nearly in the same state (`CELL`) the one
    with the larger reward so far stays; and of every class of states (lane, side of its centre,
    speed, place beside the trap) the ``per_class`` largest rewards, so that a drive that must first
    lose reward is not crowded out.
    """
    classes = world.road.centre.shape[0] * 3 * (len(SPEEDS) + 1) * (len(LEADS) + 1)
    places = classes * settings.search.per_class
    first = episode.begin(world)
    beam = Beam(
        episodes=jax.tree.map(lambda leaf: jnp.broadcast_to(leaf, (places, *leaf.shape)), first),
        reward=jnp.where(jnp.arange(places) == 0, 0.0, -jnp.inf),
        actions=jnp.zeros((places, settings.duration), jnp.int32),
    )

    def prolong(decision: Array, beam: Beam) -> Beam:
        return _select(settings, _expand(settings, beam, decision), places)

    beam = jax.lax.fori_loop(0, settings.duration, prolong, beam)
    best: Array = beam.actions[jnp.argmax(beam.reward)]
    return best


def _expand(settings: Search, beam: Beam, decision: Array) -> Beam:
    """Every drive prolonged by every action, [9 B]; accidents get minus infinity."""

    def one(state: Episode, reward: Array, taken: Array, action: Array) -> Beam:
        # One decision more than planned: the search never meets a time-out.
        after = episode.step(settings.driving, state, action, settings.duration + 1)
        outcome = after.outcome
        total = jnp.where(outcome.terminated, -jnp.inf, reward + outcome.reward)
        return Beam(after, total, taken.at[decision].set(action))

    every = jax.vmap(jax.vmap(one, (None, None, None, 0)), (0, 0, 0, None))
    grown: Beam = every(
        beam.episodes, beam.reward, beam.actions, jnp.arange(actions.COUNT, dtype=jnp.int32)
    )
    flat: Beam = jax.tree.map(lambda leaf: leaf.reshape(-1, *leaf.shape[2:]), grown)
    return flat


def _select(settings: Search, beam: Beam, places: int) -> Beam:
    """The drives that stay: the best of each cell, then the best few of each class."""
    cell, kind = jax.vmap(_place)(beam.episodes)
    first_of_cell = _rank(cell, beam.reward) == 0
    reward = jnp.where(first_of_cell, beam.reward, -jnp.inf)
    rank = _rank(kind, reward)
    kept = (rank < settings.search.per_class) & jnp.isfinite(reward)
    place = jnp.where(kept, kind * settings.search.per_class + rank, places)
    source = jnp.zeros(places, jnp.int32).at[place].set(jnp.arange(len(place)), mode="drop")
    filled = jnp.zeros(places, bool).at[place].set(True, mode="drop")
    chosen: Beam = jax.tree.map(lambda leaf: leaf[source], replace(beam, reward=reward))
    return replace(chosen, reward=jnp.where(filled, chosen.reward, -jnp.inf))


def _rank(group: Array, value: Array) -> Array:
    """Place of each element among those of its group, the largest value first; int32 [n]."""
    order = jnp.lexsort((-value, group))
    sorted_group = group[order]
    index = jnp.arange(len(group), dtype=jnp.int32)
    begins = jnp.concatenate([jnp.ones(1, bool), sorted_group[1:] != sorted_group[:-1]])
    begin = jax.lax.cummax(jnp.where(begins, index, 0))
    return jnp.zeros_like(index).at[order].set(index - begin)


def _place(state: Episode) -> tuple[Array, Array]:
    """(cell, class) of a state, int32 []."""
    vehicles = state.world.vehicles
    x, y, heading, speed = (getattr(vehicles, name)[0] for name in ("x", "y", "heading", "speed"))
    cell = jnp.int32(0)
    for value, size, count in zip((x, y, heading, speed), CELL, _CELLS, strict=True):
        index = jnp.floor(value / size).astype(jnp.int32)
        # Positions grow from 0; the rest is counted from the middle.
        index = index if count == _CELLS[0] else index + count // 4
        cell = cell * count + jnp.clip(index, 0, count - 1)
    offset = observation.lane_offset(state.world)
    side = (offset > ASIDE).astype(jnp.int32) - (offset < -ASIDE).astype(jnp.int32) + 1
    fast = jnp.sum(speed > jnp.asarray(SPEEDS)).astype(jnp.int32)
    lane = road.closest_lane(state.world.road, x, y)
    last = jnp.min(jnp.stack([vehicles.x[car] for car in trap.TRAP_CARS]))
    ahead = jnp.sum(x - last > jnp.asarray(LEADS)).astype(jnp.int32)
    kind = (lane * 3 + side) * (len(SPEEDS) + 1) + fast
    return cell, kind * (len(LEADS) + 1) + ahead
