"""A controller over a grid of starts: which can be won at all, and which it wins.

All starts of a grid are numbers to one compiled test, in worlds as wide and as full as the widest
and fullest start needs.
"""

from collections.abc import Iterator, Sequence
from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from lanewise.controllers.controller import Parameters
from lanewise.evaluation import concurrent, evaluator, reachability
from lanewise.evaluation.episodes import Episodes
from lanewise.evaluation.evaluator import EvaluationConfig, Result
from lanewise.evaluation.grid import CAUSES, Grid, Point, PointResult, Reach
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


def start_of(scenario: TrapSettings, point: Point) -> Start:
    """A point's numbers; the traffic ahead is the scenario's."""
    return Start.of(scenario, **point._asdict())


def reach(
    test: EvaluationConfig, clearance: float, points: Sequence[Point], known: Sequence[str] = ()
) -> Iterator[Reach]:
    """Which points can be won at all, and which with some clearance, m, from the trap cars.

    Args:
        test: of the grid, as `config` made it.
        clearance: m.
        points: in an order in which neighbours are alike: escapes of the last ones are tried first.
        known: escapes found before.
    """
    strict = ReachabilityConfig(test.scenario, test.driving, test.duration)
    wide = replace(strict, clearance=clearance)
    pool = dict.fromkeys(tuple(map(int, escape)) for escape in known if escape)
    for point in points:
        start = start_of(test.scenario, point)
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
) -> Iterator[list[PointResult]]:
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
        numbers = [start_of(test.scenario, point) for point in some for _ in range(episodes)]
        found = _drive(test, parameters, seed, begin * episodes, numbers)
        yield [
            _outcome(found, slice(place * episodes, (place + 1) * episodes))
            for place in range(len(some))
        ]


def _drive(
    test: EvaluationConfig, parameters: Parameters, seed: int, first: int, numbers: Sequence[Start]
) -> Episodes:
    """Episodes from given starts, in blocks; the last is filled up with copies."""
    count = len(numbers)
    filled = [*numbers, *[numbers[-1]] * (-count % evaluator.BLOCK)]

    def driven(begin: int) -> Result:
        some = filled[begin : begin + evaluator.BLOCK]
        block: Start = jax.tree.map(lambda *values: np.array(values), *some)
        worlds = _place(test, seed, first + begin, block)
        rules = evaluator.of_any_start(test)
        found: Result = jax.device_get(evaluator.drive_block(rules, parameters, worlds))
        return found

    blocks = concurrent.in_order(driven, range(0, len(filled), evaluator.BLOCK))
    return evaluator.as_episodes(test.driving, blocks, count)


@pinned.jit(static_argnums=0)
def _place(test: EvaluationConfig, seed: Array, first: Array, starts: Start) -> World:
    """The worlds of a block of starts."""

    def one(index: Array, start: Start) -> World:
        key = trap.start_key(seed, "test", index)
        return trap.place(test.scenario, start, key)

    return jax.vmap(one)(first + jnp.arange(evaluator.BLOCK), starts)


def _outcome(found: Episodes, which: slice) -> PointResult:
    accident = found.accident[which]
    causes = {cause: int((accident == code).sum()) for code, cause in enumerate(CAUSES, 1)}
    return PointResult(
        episodes=len(accident),
        escapes=int(found.escaped[which].sum()),
        successes=int(found.success[which].sum()),
        speed=float(found.average_speed[which].mean()),
        reward=float(found.accumulated_reward[which].mean()),
        **causes,
    )
