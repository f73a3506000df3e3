"""Greedy test episodes in our world, in compiled blocks of one fixed size.

Episode i of a seed is the same however many are driven with it: blocks are padded, never cut.
`lanewise.evaluation.stepwise` drives the same episodes decision by decision from the host.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from lanewise.controllers import controller as controllers
from lanewise.controllers.controller import Controller, Memory, Parameters, Trace
from lanewise.driving import accident_kinds, actions, episode, percept
from lanewise.driving.accident_kinds import History
from lanewise.driving.episode import Episode, EpisodeStats
from lanewise.driving.percept import Percept
from lanewise.driving.settings import DrivingSettings
from lanewise.driving.task_functions import PAPER_TASK, TaskFunctions
from lanewise.errors import NumbersError
from lanewise.evaluation import concurrent
from lanewise.evaluation.episodes import Episodes
from lanewise.scenario import trap
from lanewise.scenario.settings import TrapSettings
from lanewise.system import pinned
from lanewise.world.state import World

BLOCK = 100
"""Episodes driven at once."""


@dataclass(frozen=True)
class EvaluationConfig:
    """What stays the same through a test. Static."""

    scenario: TrapSettings
    driving: DrivingSettings
    controller: Controller
    duration: int
    """Decisions."""
    split: str = "test"
    """Which starts: ``test``, or ``validation``, or ``training``."""
    at_once: int = BLOCK
    """Episodes of a block driven at once; fewer for a controller that needs much memory."""
    task: TaskFunctions = PAPER_TASK
    """How episodes start, and what is observed, rewarded and counted as success."""


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Drive:
    """A controller under way in one world."""

    episode: Episode
    percept: Percept
    """What there is to observe now."""
    memory: Memory
    """The controller's."""
    finite: Array
    """bool [] whether every observation so far was finite."""
    history: History
    """What tells the kind of an accident."""


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Result:
    """What is counted of a drive; [E] for a set of them."""

    stats: EpisodeStats
    accident_kind: Array
    """int32, see `lanewise.driving.accident_kinds`."""
    goals: Array
    """int32 goals that ended."""
    goals_timed_out: Array
    """int32 of those, how many were given up."""
    finite: Array
    """bool, see `Drive`."""


def evaluate(
    config: EvaluationConfig,
    parameters: Parameters,
    seed: int,
    count: int,
    done: Callable[[int], None] = lambda count: None,
) -> Episodes:
    """Drive episodes 0 to ``count - 1`` of ``seed`` greedily.

    ``done`` is called now and then with the number of episodes done.
    """
    rules = of_any_start(config)

    def block(first: int) -> Result:
        return drive_block(rules, parameters, start_block(config, seed, first))

    blocks = concurrent.in_order(
        lambda first: jax.device_get(block(first)),
        range(0, count, BLOCK),
        lambda number: done(min(count, number * BLOCK)),
    )
    return as_episodes(config.driving, blocks, count)


def as_episodes(driving: DrivingSettings, blocks: Sequence[Result], count: int) -> Episodes:
    """Outcomes from the first ``count`` results of several blocks.

    Raises:
        NumbersError: something was not finite in one of them; no figure would count.
    """
    result: Result = jax.tree.map(lambda *parts: np.concatenate(parts)[:count], *blocks)
    _check_numbers(result)
    stats = result.stats
    decisions = np.asarray(stats.decisions, np.float64)
    escape = np.asarray(stats.escape_decision, np.float64)
    accident = np.asarray(stats.outcome.accident, np.int8)
    return Episodes(
        success=(escape > 0) & (accident == 0),
        accident=accident,
        accident_kind=np.asarray(result.accident_kind, np.int8),
        accumulated_reward=np.asarray(stats.timestep_reward, np.float64),
        average_speed=np.asarray(stats.speed_sum, np.float64) / decisions,
        travel_distance=np.asarray(stats.distance, np.float64),
        duration=decisions * driving.decision_duration,
        escape_time=np.where(escape > 0, escape * driving.decision_duration, np.nan),
        goals=np.asarray(result.goals, np.int64),
        goals_timed_out=np.asarray(result.goals_timed_out, np.int64),
    )


def _check_numbers(result: Result) -> None:
    """Refuses results that no metric could be made of."""
    stats = result.stats
    fine = {
        "an observation": np.asarray(result.finite),
        "a reward": np.isfinite(stats.timestep_reward),
        "the ego's speed or place": np.isfinite(stats.speed_sum) & np.isfinite(stats.distance),
    }
    for what, finite in fine.items():
        if not finite.all():
            raise NumbersError(
                f"{what} is not finite in {np.sum(~finite)} of {len(finite)} episodes, first in "
                f"episode {np.argmin(finite)}: correct the function that observes, rewards or "
                "makes the start"
            )


def start(config: EvaluationConfig, seed: int, index: int) -> World:
    """The world at the start of episode ``index``.

    Taken from its block: compiled any other way, its numbers could be rounded differently from
    those that `evaluate` drives.
    """
    block = start_block(config, seed, index - index % BLOCK)
    world: World = jax.tree.map(lambda leaf: leaf[index % BLOCK], block)
    return world


def start_block(config: EvaluationConfig, seed: int, first: int) -> World:
    """Starts ``first`` to ``first + BLOCK - 1``."""
    # Compiled once for all tests that start alike.
    return _start_block(config.task.start, config.scenario, config.split, seed, first)


@pinned.jit(static_argnums=(0, 1, 2))
def _start_block(sample: Any, scenario: TrapSettings, split: str, seed: int, first: int) -> World:
    indices = first + jnp.arange(BLOCK)
    worlds: World = jax.vmap(
        lambda index: sample(scenario, trap.start_key(seed, split, index), split)
    )(indices)
    return worlds


def of_any_start(config: EvaluationConfig) -> EvaluationConfig:
    """The same test whatever its starts are, so that tests which differ in them compile once."""
    split = config.split if config.driving.varies_in_training else "test"
    return replace(config, scenario=TrapSettings(), split=split)


@pinned.jit(static_argnums=0)
def drive_block(config: EvaluationConfig, parameters: Parameters, worlds: World) -> Result:
    """The episodes that begin in a block of `BLOCK` starts, wherever those come from."""
    drive_one = partial(_drive_one, config, parameters)
    if config.at_once < BLOCK:
        found: Result = jax.lax.map(drive_one, worlds, batch_size=config.at_once)
        return found
    return jax.vmap(drive_one)(worlds)


def _drive_one(config: EvaluationConfig, parameters: Parameters, world: World) -> Result:
    """One whole episode."""

    def decide(_: Array, drive: Drive) -> Drive:
        action, memory, _traces = act(config, parameters, drive)
        return step(config, drive, memory, action)

    return result(config, jax.lax.fori_loop(0, config.duration, decide, begin(config, world)))


def result(config: EvaluationConfig, drive: Drive) -> Result:
    """What counts of a drive."""
    goal = config.controller.goal(drive.memory)
    none = jnp.zeros_like(drive.episode.stats.decisions)
    return Result(
        stats=drive.episode.stats,
        accident_kind=accident_kinds.kind(
            drive.episode.outcome.accident,
            drive.episode.world,
            drive.history,
            config.driving.decision_duration,
        ),
        goals=none if goal is None else goal.ended,
        goals_timed_out=none if goal is None else goal.timed_out,
        finite=drive.finite,
    )


def begin(config: EvaluationConfig, world: World) -> Drive:
    """The controller at the start of the episode that begins in ``world``."""
    begun = episode.begin(world)
    seen = _observe(config, begun)
    memory = config.controller.start(_privileged(seen, begun))
    finite = jnp.isfinite(seen.features).all()
    return Drive(begun, seen, memory, finite, accident_kinds.begin(world))


def act(
    config: EvaluationConfig, parameters: Parameters, drive: Drive
) -> tuple[Array, Memory, dict[str, Trace]]:
    """The greedy decision: (low-level action, the memory afterwards, a trace by level)."""
    seen = _privileged(drive.percept, drive.episode)
    return controllers.act(config.controller, parameters, drive.memory, seen)


def step(config: EvaluationConfig, drive: Drive, memory: Memory, action: Array) -> Drive:
    """The drive after a decision of `act` that our world simulates.

    ``memory`` is the controller's after the decision, ``action`` an int32 [] low-level action, or
    for continuous ones float [2] from -1 to 1.
    """
    after = episode.step(
        *(config.driving, drive.episode, action, config.duration, config.task),
        training=config.split != "test",
    )
    return _next(config, drive, memory, after)


def conclude(
    config: EvaluationConfig, drive: Drive, memory: Memory, action: Array, world: World
) -> Drive:
    """As `step`, given the world after the decision, which another simulator has made."""
    _, steering = actions.commands(config.driving.actions, action, drive.percept.x.dtype)
    after = episode.evaluate_step(
        config.driving, drive.episode, world, steering, config.duration, config.task
    )
    return _next(config, drive, memory, after)


def _next(config: EvaluationConfig, drive: Drive, memory: Memory, after: Episode) -> Drive:
    """The drive after a decision; one that was over stays as it is."""
    seen = _observe(config, after)
    finite = drive.finite & jnp.isfinite(seen.features).all()
    history = accident_kinds.follow(drive.history, drive.episode.world, after.world)
    new, over = Drive(after, seen, memory, finite, history), drive.episode.outcome.over
    kept: Drive = jax.tree.map(lambda old, new: jnp.where(over, old, new), drive, new)
    return kept


def _observe(config: EvaluationConfig, state: Episode) -> Percept:
    training = config.split != "test"
    return percept.perceive(config.driving.observation, state.world, config.task, training)


def _privileged(seen: Percept, state: Episode) -> Percept:
    """With the whole world, which reference drivers read."""
    return replace(seen, world=state.world)
