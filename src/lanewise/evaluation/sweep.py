"""A controller over a grid of starts: which can be won at all, and which it wins.

All starts of a grid are numbers to one compiled test, in worlds as wide and as full as the widest
and fullest start needs.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from jax.typing import ArrayLike
from numpy.typing import NDArray

from lanewise.controllers.controller import Parameters
from lanewise.evaluation import concurrent, evaluator, reachability
from lanewise.evaluation.cells import CellOutcome, Place, Reach, outcome
from lanewise.evaluation.episodes import Episodes
from lanewise.evaluation.evaluator import EvaluationConfig, Result
from lanewise.evaluation.grid import Grid, Point
from lanewise.evaluation.reachability import ReachabilityConfig
from lanewise.scenario import trap
from lanewise.scenario.settings import TrapSettings
from lanewise.scenario.trap import Start
from lanewise.system import pinned
from lanewise.world.state import World


def config(test: EvaluationConfig, grid: Grid) -> EvaluationConfig:
    """The test of a grid's starts: the controller's own, with room for every start."""
    traffic = replace(test.scenario.traffic, vehicles_behind=max(grid.vehicles_behind))
    return replace(test, scenario=replace(test.scenario, lanes=max(grid.lanes), traffic=traffic))


def reach(
    test: EvaluationConfig, clearance: float, places: Sequence[Place], known: Sequence[str] = ()
) -> Iterator[Reach]:
    """Which places can be won at all, and which with some clearance, m, from the trap cars.

    Args:
        test: with room for every start.
        clearance: m.
        places: in an order in which neighbours are alike: escapes of the last ones are tried first.
        known: escapes found before.
    """
    # The search knows no latency.
    driving = replace(test.driving, latency=0.0)
    strict = ReachabilityConfig(test.scenario, driving, test.duration)
    wide = replace(strict, clearance=clearance)
    pool = dict.fromkeys(tuple(map(int, escape)) for escape in known if escape)
    for place in places:
        start = Start.of(test.scenario, **place.start_numbers)
        latest = list(reversed(pool))
        clear = reachability.judge(wide, start, latest)
        verdict = clear
        if not (clear.actions and reachability.replay(strict, start, [clear.actions])[0]):
            verdict = reachability.judge(strict, start, latest)
        for found in (verdict.actions, clear.actions):
            if found:
                pool.pop(found, None)
                pool[found] = None
        yield Reach(
            winnable=verdict.winnable,
            decided=verdict.decided and clear.decided,
            clear=clear.winnable,
            escape="".join(map(str, clear.actions or verdict.actions)),
            states=verdict.states,
        )


def run(
    test: EvaluationConfig,
    parameters: Parameters,
    seed: int,
    episodes: int,
    points: Sequence[Point],
    first: int = 0,
) -> Iterator[list[CellOutcome]]:
    """Drive every point's episodes greedily, under the test that `config` made.

    Args:
        test: of the grid.
        parameters: of all the controller's levels.
        seed: of the traffic; episode e of point i is start i * ``episodes`` + e of the seed.
        episodes: of each point.
        points: all of the grid.
        first: the point to begin with.

    Yields:
        The outcomes of the next few points: as many as fill a block for each core, at least one.
    """
    together = max(1, concurrent.threads() * evaluator.BLOCK // episodes)
    for begin in range(first, len(points), together):
        some = points[begin : begin + together]
        numbers = stacked([Start.of(test.scenario, **point.start_numbers) for point in some])
        before = begin * episodes

        def worlds(
            rows: NDArray[np.int64], numbers: Start = numbers, before: int = before
        ) -> World:
            starts = jax.tree.map(lambda values: values[rows // episodes], numbers)
            return place(test.scenario, seed, before + rows, starts)

        found = drive(test, parameters, len(some) * episodes, worlds)
        yield outcomes(test, found, episodes, [test.duration])


def outcomes(
    test: EvaluationConfig, found: Episodes, episodes: int, horizons: Sequence[int]
) -> list[CellOutcome]:
    """Outcomes of cells with so many episodes each; the horizons are decisions."""
    limits = [horizon * test.driving.decision_duration for horizon in horizons]
    cells = [slice(first, first + episodes) for first in range(0, len(found), episodes)]
    return [outcome(found.some(cell), limits) for cell in cells]


def stacked(starts: Sequence[Start]) -> Start:
    """The numbers of several starts as arrays, each [S]."""
    found: Start = jax.tree.map(lambda *values: np.array(values), *starts)
    return found


def drive(
    test: EvaluationConfig,
    parameters: Parameters,
    count: int,
    worlds: Callable[[NDArray[np.int64]], World],
) -> Episodes:
    """Greedy episodes from given worlds, in blocks; the last is filled up with copies.

    Args:
        test: of the episodes; its scenario does not matter.
        parameters: of all the controller's levels.
        count: of the episodes.
        worlds: makes those at the start of `evaluator.BLOCK` episodes, given their numbers.
    """
    rules = evaluator.of_any_start(test)

    def driven(begin: int) -> Result:
        rows = np.minimum(begin + np.arange(evaluator.BLOCK), count - 1)
        found: Result = jax.device_get(evaluator.drive_block(rules, parameters, worlds(rows)))
        return found

    blocks = concurrent.in_order(driven, range(0, count, evaluator.BLOCK))
    return evaluator.as_episodes(test.driving, blocks, count)


@pinned.jit(static_argnums=0)
def place(scenario: TrapSettings, seed: int, indices: ArrayLike, starts: Start) -> World:
    """The worlds of test starts with these numbers, [E] each.

    Args:
        scenario: with at least as many lanes and vehicles as any of the starts.
        seed: of the traffic.
        indices: of the starts, int [E].
        starts: their numbers.
    """

    def one(index: Array, start: Start) -> World:
        return trap.place(scenario, start, trap.start_key(seed, "test", index))

    worlds: World = jax.vmap(one)(jnp.asarray(indices), starts)
    return worlds
