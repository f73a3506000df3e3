"""A controller driven under the conditions of a grid, in as few compiled programs as there can be.

Episode e of every condition is start e of the seed, so that a cell's episodes are those of
``lanewise evaluate`` with the condition's settings. All worlds are made as wide and as full as the
largest: only noise and latency, which are static, and linear drivers need programs of their own.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace

import jax
import numpy as np
from numpy.typing import NDArray

from lanewise.controllers.controller import Parameters
from lanewise.evaluation import sweep
from lanewise.evaluation.cells import CellOutcome
from lanewise.evaluation.conditions import DENSITIES, HORIZONS, Condition, ConditionGrid
from lanewise.evaluation.evaluator import EvaluationConfig
from lanewise.scenario import drivers
from lanewise.scenario.settings import TrafficSettings
from lanewise.scenario.trap import Start
from lanewise.system import pinned
from lanewise.world import build
from lanewise.world.state import World

TestOf = Callable[[Condition], EvaluationConfig]
"""The test of a controller under a condition, as long as the last horizon."""


@dataclass(frozen=True)
class Room:
    """How large every world of a grid is made."""

    lanes: int
    vehicles: int
    waves: bool
    """Whether anybody's speed swings in any of them."""


def room_of(test_of: TestOf, grid: ConditionGrid) -> Room:
    """Room for every condition of a grid."""
    firsts = [group[0] for group in grid.groups()]
    crowds = [DENSITIES[density] for density in grid.density]
    return Room(
        lanes=max(grid.lanes),
        vehicles=3 + max(crowd.vehicles_ahead + crowd.vehicles_behind for crowd in crowds),
        waves=any(drivers.has_waves(test_of(condition).scenario) for condition in firsts),
    )


def run(
    test_of: TestOf,
    parameters: Parameters,
    seed: int,
    episodes: int,
    grid: ConditionGrid,
    done: int = 0,
) -> Iterator[list[CellOutcome]]:
    """Drive every condition's episodes greedily.

    Args:
        test_of: see `TestOf`.
        parameters: of all the controller's levels.
        seed: of the starts.
        episodes: of each condition.
        grid: of the conditions.
        done: how many of them, in the order of the groups, are to be left out.

    Yields:
        The outcomes of a group, in its order.
    """
    room = room_of(test_of, grid)
    for group in grid.groups():
        left = group[done:]
        done = max(0, done - len(group))
        if left:
            yield _drive(test_of(left[0]), parameters, seed, episodes, left, room)


def _drive(
    test: EvaluationConfig,
    parameters: Parameters,
    seed: int,
    episodes: int,
    group: Sequence[Condition],
    room: Room,
) -> list[CellOutcome]:
    numbers = sweep.stacked([Start.of(test.scenario, **c.start_numbers) for c in group])
    # What a start has as a number is the same for all groups, so that placing compiles once for
    # all densities of as many vehicles.
    traffic = replace(test.scenario.traffic, spacing=TrafficSettings.spacing)
    scenario = replace(test.scenario, lanes=room.lanes, traffic=traffic)

    def worlds(rows: NDArray[np.int64]) -> World:
        starts = jax.tree.map(lambda values: values[rows // episodes], numbers)
        placed = sweep.place(scenario, seed, rows % episodes, starts)
        return _widened(placed, room)

    found = sweep.drive(test, parameters, len(group) * episodes, worlds)
    limits = [test.driving.decisions_in(second) for second in HORIZONS]
    return sweep.outcomes(test, found, episodes, limits)


@pinned.jit(static_argnums=1)
def _widened(worlds: World, room: Room) -> World:
    """The same worlds [B] with absent vehicles, and with waves of those whose speed stays."""

    def one(world: World) -> World:
        driven = world.drivers
        if room.waves and driven.waves is None:
            driven = replace(driven, waves=drivers.calm(driven.target_speed))
        return build.padded(replace(world, drivers=driven), room.vehicles)

    widened: World = jax.vmap(one)(worlds)
    return widened
