"""Test episodes decision by decision: to record them, for anyone's policy, in another simulator.

A *policy* chooses for a batch of drives, a *simulator* moves their worlds on; what is counted is
what `lanewise.evaluation.evaluator` counts.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any, Protocol

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from numpy.typing import NDArray

from lanewise.controllers.controller import Memory, Parameters
from lanewise.controllers.goal_critic import GoalMemory
from lanewise.driving.episode import Episode
from lanewise.driving.settings import DrivingSettings
from lanewise.evaluation import evaluator
from lanewise.evaluation.episodes import Episodes, Recording
from lanewise.evaluation.evaluator import Drive, EvaluationConfig, Result
from lanewise.evaluation.external_policy import Decide
from lanewise.scenario import trap
from lanewise.system import pinned
from lanewise.world.state import World

Booleans = NDArray[np.bool_]


StepPolicy = Callable[[EvaluationConfig, Drive, Booleans, bool], tuple[Array, Memory]]
"""Who chooses, for a batch of B drives: (test, [B] drives, [B] whose actions count, whether this is
the first decision) to ([B] low-level actions or [B, 2] continuous ones, [B] later memories)."""


class Simulator(Protocol):
    """Who moves the worlds on, for a batch of B drives."""

    @property
    def size(self) -> int:
        """B."""

    def begin(self, config: EvaluationConfig, seed: int, first: int) -> Drive:
        """Episodes ``first`` to ``first + B - 1`` of a seed at their start."""

    def step(self, config: EvaluationConfig, drive: Drive, memory: Memory, action: Array) -> Drive:
        """The drives after a decision."""


@dataclass(frozen=True)
class Lanewise:
    """Our world: blocks, or one episode at a time."""

    size: int = field(default_factory=lambda: evaluator.BLOCK)

    def begin(self, config: EvaluationConfig, seed: int, first: int) -> Drive:
        """As of `Simulator`."""
        place = first % evaluator.BLOCK
        worlds = evaluator.start_block(config, seed, first - place)
        some = jax.tree.map(lambda leaf: leaf[place : place + self.size], worlds)
        return _begin(evaluator.of_any_start(config), some)

    def step(self, config: EvaluationConfig, drive: Drive, memory: Memory, action: Array) -> Drive:
        """As of `Simulator`."""
        return _step(config, drive, memory, action)


def greedy(parameters: Parameters) -> StepPolicy:
    """A controller's own networks choose."""
    return lambda config, drive, wanted, first: _act(config, parameters, drive)


def external(decide: Decide) -> StepPolicy:
    """Anyone's policy takes the place of the one network of a controller, or of the controller."""

    def choose(
        config: EvaluationConfig, drive: Drive, wanted: Booleans, first: bool
    ) -> tuple[Array, Memory]:
        choices = jnp.asarray(decide(np.asarray(drive.percept.features), wanted, first))
        if jnp.issubdtype(choices.dtype, jnp.floating):
            return choices, drive.memory
        return _choose(config, drive, choices)

    return choose


def evaluate(
    config: EvaluationConfig,
    policy: StepPolicy,
    simulator: Simulator,
    seed: int,
    count: int,
    done: Callable[[int], None] = lambda count: None,
) -> Episodes:
    """Drive episodes 0 to ``count - 1`` of ``seed``, as `evaluator.evaluate` does.

    Raises:
        LanewiseError: the policy chose something that does not exist.
    """
    blocks = []
    for first in range(0, count, simulator.size):
        wanted = first + np.arange(simulator.size) < count
        *_, last = _drive(config, policy, simulator, seed, first, wanted)
        blocks.append(jax.device_get(_results(evaluator.of_any_start(config), last)))
        done(min(count, first + simulator.size))
    return evaluator.as_episodes(config.driving, blocks, count)


def record(
    config: EvaluationConfig, policy: StepPolicy, simulator: Simulator, seed: int, index: int
) -> Recording:
    """Drive episode ``index`` of ``seed`` and keep every frame.

    It is driven with the others of its batch, so that it is the episode that `evaluate` drives.
    """
    place = index % simulator.size
    wanted = np.arange(simulator.size) == place
    frames = [
        jax.tree.map(lambda leaf: np.asarray(leaf[place]), drive)
        for drive in _drive(config, policy, simulator, seed, index - place, wanted)
    ]
    stacked: Any = jax.tree.map(lambda *leaf: np.stack(leaf), *frames)
    goals = config.controller.goal(stacked.memory)
    found = recording(config.controller.name, config.driving, stacked.episode, goals)
    last = jax.tree.map(lambda leaf: leaf[None], frames[-1])
    (kind,) = _results(evaluator.of_any_start(config), last).accident_kind
    return replace(found, accident_kind=int(kind))


def _drive(
    config: EvaluationConfig,
    policy: StepPolicy,
    simulator: Simulator,
    seed: int,
    first: int,
    wanted: Booleans,
) -> Iterator[Drive]:
    """A batch of drives, from the start on after each decision, until those wanted are over."""
    drive = simulator.begin(config, seed, first)
    yield drive
    going, rules = wanted, evaluator.of_any_start(config)
    for number in range(config.duration):
        action, memory = policy(rules, drive, going, number == 0)
        drive = simulator.step(rules, drive, memory, action)
        yield drive
        going = wanted & ~np.asarray(drive.episode.outcome.over)
        if not going.any():
            return


@pinned.jit(static_argnums=0)
def _begin(config: EvaluationConfig, worlds: World) -> Drive:
    return jax.vmap(partial(evaluator.begin, config))(worlds)


@pinned.jit(static_argnums=0)
def _act(config: EvaluationConfig, parameters: Parameters, drive: Drive) -> tuple[Array, Memory]:
    return jax.vmap(partial(evaluator.act, config, parameters))(drive)[:2]


@pinned.jit(static_argnums=0)
def _choose(config: EvaluationConfig, drive: Drive, choices: Array) -> tuple[Array, Memory]:
    """The action that a choice leads to: ``choices`` take the place of the network's."""
    controller = config.controller
    (level,) = controller.levels

    def one(drive: Drive, choice: Array) -> tuple[Array, Memory]:
        memory = controller.perceive(drive.memory, drive.percept)
        memory = level.choose(memory, drive.percept, choice)
        return controller.act(memory, drive.percept)

    return jax.vmap(one)(drive, choices)


@pinned.jit(static_argnums=0)
def _step(config: EvaluationConfig, drive: Drive, memory: Memory, action: Array) -> Drive:
    return jax.vmap(partial(evaluator.step, config))(drive, memory, action)


@pinned.jit(static_argnums=0)
def _results(config: EvaluationConfig, drives: Drive) -> Result:
    return jax.vmap(partial(evaluator.result, config))(drives)


def recording(
    controller: str, driving: DrivingSettings, states: Episode, goals: GoalMemory | None
) -> Recording:
    """A recording from the states at the start and after each decision, [T], and their goals."""
    world, stats = states.world, states.stats
    vehicles, drivers, road = world.vehicles, world.drivers, world.road
    lanes, nothing = road.present[0], np.zeros(len(states.start_x))
    frames = np.arange(len(nothing))
    # The goal under way in the first frame is the one that its decision sets.
    under_way = np.maximum(frames, min(1, frames[-1]))
    goal_lane = nothing - 1 if goals is None else np.asarray(goals.goal.lane)
    goal_speed = nothing * np.nan if goals is None else np.asarray(goals.goal.speed)
    return Recording(
        controller=controller,
        time=np.asarray(stats.decisions, np.float64) * driving.decision_duration,
        x=np.asarray(vehicles.x, np.float64),
        y=np.asarray(vehicles.y, np.float64),
        heading=np.asarray(vehicles.heading, np.float64),
        speed=np.asarray(vehicles.speed, np.float64),
        crashed=np.asarray(vehicles.crashed, np.bool_),
        present=np.asarray(vehicles.present[0]),
        role=trap.roles(jax.tree.map(lambda leaf: leaf[0], world)),
        length=np.asarray(drivers.length[0], np.float64),
        width=np.asarray(drivers.width[0], np.float64),
        lane_centre=np.asarray(road.centre[0], np.float64)[lanes],
        lane_width=np.asarray(road.width[0], np.float64)[lanes],
        goal_lane=np.asarray(goal_lane, np.int64)[under_way],
        goal_speed=np.asarray(goal_speed, np.float64)[under_way],
        goals_ended=np.asarray(nothing if goals is None else goals.ended, np.int64),
        goals_timed_out=np.asarray(nothing if goals is None else goals.timed_out, np.int64),
        reward=np.asarray(stats.outcome.reward, np.float64),
        accumulated_reward=np.asarray(stats.timestep_reward, np.float64),
        escaped=np.asarray(stats.escaped, np.bool_),
        accident=int(stats.outcome.accident[-1]),
    )
