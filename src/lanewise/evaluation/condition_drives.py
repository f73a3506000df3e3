"""A controller driven under the conditions of a grid, in as few compiled programs as there can be.

Episode e of every condition is start e of the seed, so that a cell's episodes are those of
``lanewise evaluate`` with the condition's settings. All worlds are made as wide and as full as the
largest: only noise and latency, which are static, and linear drivers need programs of their own.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

import jax
import numpy as np
from numpy.typing import NDArray

from lanewise.controllers.controller import Parameters
from lanewise.evaluation import sweep
from lanewise.evaluation.conditions import (
    DENSITIES,
    HORIZONS,
    Condition,
    ConditionGrid,
    ConditionOutcome,
    outcome,
)
from lanewise.evaluation.evaluator import EvaluationConfig
from lanewise.evaluation.grid import Point, Reach
from lanewise.scenario import drivers
from lanewise.scenario.settings import TrafficSettings
from lanewise.scenario.trap import Start
from lanewise.world.state import Waves, World

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


def reach(
    test: EvaluationConfig,
    clearance: float,
    places: Sequence[tuple[float, float, int]],
    known: Sequence[str] = (),
) -> Iterator[Reach]:
    """Which starts, by speeds (ego, trap) in m/s and lanes, can be won by the first horizon.

    Arguments as `sweep.reach`; the test has room for all lanes.
    """
    scenario = test.scenario
    rest = (
        scenario.test_front_distance,
        scenario.test_side_distance,
        scenario.traffic.spacing,
        scenario.traffic.vehicles_behind,
    )
    points = [Point(ego, trap, lanes, *rest) for ego, trap, lanes in places]
    by_then = replace(test, duration=test.driving.decisions_in(HORIZONS[0]))
    return sweep.reach(by_then, clearance, points, known)


def run(
    test_of: TestOf,
    parameters: Parameters,
    seed: int,
    episodes: int,
    grid: ConditionGrid,
    done: int = 0,
) -> Iterator[list[ConditionOutcome]]:
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
) -> list[ConditionOutcome]:
    numbers = sweep.stacked(
        [
            Start.of(test.scenario, lanes=c.lanes, ego_speed=c.ego_speed, trap_speed=c.trap_speed)
            for c in group
        ]
    )
    # What a start has as a number is the same for all groups, so that placing compiles once for
    # all densities of as many vehicles.
    traffic = replace(test.scenario.traffic, spacing=TrafficSettings.spacing)
    scenario = replace(test.scenario, lanes=room.lanes, traffic=traffic)

    def worlds(rows: NDArray[np.int64]) -> World:
        starts = jax.tree.map(lambda values: values[rows // episodes], numbers)
        placed = sweep.place(scenario, seed, rows % episodes, starts)
        return _widened(jax.device_get(placed), room)

    found = sweep.drive(test, parameters, len(group) * episodes, worlds)
    driving = test.driving
    limits = [driving.decisions_in(second) * driving.decision_duration for second in HORIZONS]
    cells = [slice(first, first + episodes) for first in range(0, len(found), episodes)]
    return [outcome(found.some(cell), limits) for cell in cells]


def _widened(worlds: World, room: Room) -> World:
    """The same worlds [B] with absent vehicles, and with waves of those whose speed stays."""
    missing = room.vehicles - worlds.vehicles.x.shape[1]
    driven = worlds.drivers
    if room.waves and driven.waves is None:
        mean = np.asarray(driven.target_speed)
        still: Any = (mean, np.zeros_like(mean), np.ones_like(mean), np.zeros_like(mean))
        driven = replace(driven, waves=Waves(*still))

    def fill(values: NDArray[np.generic]) -> NDArray[np.generic]:
        return np.pad(values, ((0, 0), (0, missing)), mode="edge")

    vehicles = jax.tree.map(fill, worlds.vehicles)
    there = np.pad(worlds.vehicles.present, ((0, 0), (0, missing)))
    return replace(
        worlds,
        drivers=jax.tree.map(fill, driven),
        vehicles=replace(vehicles, present=there),
    )
