"""Greedy test episodes in our world, in compiled blocks of one fixed size.

Episode i of a seed is the same however many are driven with it: blocks are padded, never cut.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from jax.typing import ArrayLike

from lanewise.controllers import controller as controllers
from lanewise.controllers.controller import Controller, Parameters
from lanewise.controllers.goal_critic import GoalMemory
from lanewise.driving import episode, percept
from lanewise.driving.episode import Episode, Outcome
from lanewise.driving.parts import OURS, Parts
from lanewise.driving.percept import Percept
from lanewise.driving.settings import DrivingSettings
from lanewise.errors import NumbersError
from lanewise.evaluation import concurrent
from lanewise.evaluation.episodes import Episodes, Recording
from lanewise.scenario import trap
from lanewise.scenario.settings import TrapSettings
from lanewise.system import pinned
from lanewise.world.state import Vehicles, World

BLOCK = 100
"""Episodes driven at once."""


@dataclass(frozen=True)
class TestCourse:
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
    parts: Parts = OURS
    """How episodes start, and what is seen, paid and counted as success."""


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Sums:
    """What is gathered along an episode; frozen once it is over."""

    start: Array
    """[] the ego's place at the start, m."""
    over: Array
    """bool []."""
    accident: Array
    """int32 []."""
    reward: Array
    """[] one reward a second, an accident's penalty once."""
    speed: Array
    """[] sum of the speed after each decision, m/s."""
    distance: Array
    """[] from the start, m."""
    decisions: Array
    """int32 []."""
    escape: Array
    """int32 [] decisions until the escape; 0 before it."""
    goals: Array
    """int32 [] goals that ended."""
    timed_out: Array
    """int32 [] goals given up."""
    sound: Array
    """bool [] whether all that a user's own function observed is finite."""


def start(course: TestCourse, seed: int, index: int) -> World:
    """The world at the start of episode ``index``.

    Taken from its block: compiled any other way, its numbers could be rounded differently from
    those that `test` drives.
    """
    block = start_block(course, seed, index - index % BLOCK)
    world: World = jax.tree.map(lambda leaf: leaf[index % BLOCK], block)
    return world


def test(
    course: TestCourse,
    parameters: Parameters,
    seed: int,
    count: int,
    done: Callable[[int], None] = lambda count: None,
) -> Episodes:
    """Drive episodes 0 to ``count - 1`` of ``seed`` greedily.

    Args:
        course: scenario, rules, controller, duration and split.
        parameters: of all the controller's levels.
        seed: of the starts.
        count: number of episodes.
        done: told now and then how many are done.

    Returns:
        Their outcomes, in order.
    """

    def block(first: int) -> Sums:
        sums = drive_block(course, parameters, start_block(course, seed, first))
        fetched: Sums = jax.device_get(sums)
        return fetched

    blocks = concurrent.in_order(
        block, range(0, count, BLOCK), lambda number: done(min(count, number * BLOCK))
    )
    sums = jax.tree.map(lambda *parts: np.concatenate(parts)[:count], *blocks)
    return as_episodes(course.driving, sums)


def as_episodes(driving: DrivingSettings, sums: Sums) -> Episodes:
    """Outcomes from gathered sums with a leading axis over the episodes.

    Raises:
        NumbersError: in one of them something was not finite; no figure would count.
    """
    _check_numbers(sums)
    decisions = np.asarray(sums.decisions, np.float64)
    escape = np.asarray(sums.escape, np.float64)
    accident = np.asarray(sums.accident, np.int8)
    return Episodes(
        success=(escape > 0) & (accident == 0),
        accident=accident,
        accumulated_reward=np.asarray(sums.reward, np.float64),
        average_speed=np.asarray(sums.speed, np.float64) / decisions,
        travel_distance=np.asarray(sums.distance, np.float64),
        duration=decisions * driving.decision_duration,
        escape_time=np.where(escape > 0, escape * driving.decision_duration, np.nan),
        goals=np.asarray(sums.goals, np.int64),
        goals_timed_out=np.asarray(sums.timed_out, np.int64),
    )


def _check_numbers(sums: Sums) -> None:
    """Refuses sums that no metric could be made of."""
    fine = {
        "an observation": np.asarray(sums.sound),
        "a reward": np.isfinite(sums.reward),
        "the ego's speed or place": np.isfinite(sums.speed) & np.isfinite(sums.distance),
    }
    for what, finite in fine.items():
        if not finite.all():
            raise NumbersError(
                f"{what} is not finite in {np.sum(~finite)} of {len(finite)} episodes, first in "
                f"episode {np.argmin(finite)}: mend the function that observes, rewards or "
                "makes the start"
            )


def nothing_yet(x: ArrayLike) -> Sums:
    """Sums at the start of an episode whose ego stands at ``x``, m."""
    zero, none = jnp.float32(0.0), jnp.int32(0)
    return Sums(
        start=jnp.asarray(x, jnp.float32),
        over=jnp.bool_(False),
        accident=none,
        reward=zero,
        speed=zero,
        distance=zero,
        decisions=none,
        escape=none,
        goals=none,
        timed_out=none,
        sound=jnp.bool_(True),
    )


def gather(
    driving: DrivingSettings,
    sums: Sums,
    state: Episode,
    outcome: Outcome,
    goal: GoalMemory | None,
    parts: Parts = OURS,
) -> Sums:
    """Sums after one more decision; unchanged if the episode was over before it."""
    counts = episode.ends_timestep(driving, state, outcome)
    first_escape = state.escaped & (sums.escape == 0)
    after = Sums(
        start=sums.start,
        over=outcome.terminated | outcome.truncated,
        accident=outcome.accident,
        reward=sums.reward + jnp.where(counts, outcome.reward, 0.0),
        speed=sums.speed + state.world.vehicles.speed[0],
        distance=state.world.vehicles.x[0] - sums.start,
        decisions=state.decisions,
        escape=jnp.where(first_escape, state.decisions, sums.escape),
        goals=sums.goals if goal is None else goal.ended,
        timed_out=sums.timed_out if goal is None else goal.timed_out,
        sound=sums.sound & sound(driving, state, parts),
    )
    kept: Sums = jax.tree.map(lambda old, new: jnp.where(sums.over, old, new), sums, after)
    return kept


def sound(driving: DrivingSettings, state: Episode, parts: Parts) -> Array:
    """Whether what a user's own function observes now is finite; ours is where the world is."""
    if parts.observe is OURS.observe:
        return jnp.asarray(True)
    finite: Array = jnp.isfinite(parts.observe(driving.observation, state.world)).all()
    return finite


def start_block(course: TestCourse, seed: int, first: int) -> World:
    """Starts ``first`` to ``first + BLOCK - 1``."""
    # Compiled once for all courses that start alike.
    worlds: World = _start_block(course.parts.start, course.scenario, course.split, seed, first)
    return worlds


@pinned.jit(static_argnums=(0, 1, 2))
def _start_block(sample: Any, scenario: TrapSettings, split: str, seed: int, first: int) -> World:
    def start(index: Array) -> World:
        world: World = sample(scenario, trap.start_key(seed, split, index), split)
        return world

    return jax.vmap(start)(first + jnp.arange(BLOCK))


@pinned.jit(static_argnums=0)
def drive_block(course: TestCourse, parameters: Parameters, worlds: World) -> Sums:
    """The episodes that begin in a block of `BLOCK` starts, wherever those come from."""
    drive_one = partial(_drive_one, course, parameters)
    if course.at_once < BLOCK:
        sums: Sums = jax.lax.map(drive_one, worlds, batch_size=course.at_once)
        return sums
    return jax.vmap(drive_one)(worlds)


def _drive_one(course: TestCourse, parameters: Parameters, world: World) -> Sums:
    """One whole episode."""

    def decide(_: Array, carry: tuple[Episode, Any, Sums]) -> tuple[Episode, Any, Sums]:
        state, memory, sums = carry
        state, memory, outcome, _trace = decision(course, parameters, state, memory)
        goal = course.controller.goal(memory)
        return state, memory, gather(course.driving, sums, state, outcome, goal, course.parts)

    state, memory = begin(course, world)
    first = replace(
        nothing_yet(world.vehicles.x[0]), sound=sound(course.driving, state, course.parts)
    )
    carry = (state, memory, first)
    sums: Sums = jax.lax.fori_loop(0, course.duration, decide, carry)[2]
    return sums


def begin(course: TestCourse, world: World) -> tuple[Episode, Any]:
    """(the episode that starts in ``world``, the controller's memory)."""
    state = episode.begin(world)
    return state, course.controller.start(look(course, state))


def look(course: TestCourse, state: Episode) -> Percept:
    """What the controller may look at; reference drivers at everything."""
    return percept.of(course.driving.observation, state.world, course.parts, privileged=True)


def decision(
    course: TestCourse, parameters: Parameters, state: Episode, memory: Any
) -> tuple[Episode, Any, Outcome, dict[str, controllers.Trace]]:
    """One greedy decision."""
    seen = look(course, state)
    action, memory, trace = controllers.act(course.controller, parameters, memory, seen)
    state, outcome = episode.step(course.driving, state, action, course.duration, course.parts)
    return state, memory, outcome, trace


@pinned.jit(static_argnums=0)
def _record(course: TestCourse, parameters: Parameters, world: World) -> Any:
    """An episode's worlds, memories, sums and rewards after each decision."""

    def decide(carry: tuple[Episode, Any, Sums], _: None) -> tuple[Any, Any]:
        state, memory, sums = carry
        state, memory, outcome, _trace = decision(course, parameters, state, memory)
        goal = course.controller.goal(memory)
        sums = gather(course.driving, sums, state, outcome, goal, course.parts)
        return (state, memory, sums), (state.world.vehicles, memory, sums, outcome.reward)

    carry = (*begin(course, world), nothing_yet(world.vehicles.x[0]))
    return jax.lax.scan(decide, carry, length=course.duration)[1]


def record(course: TestCourse, parameters: Parameters, seed: int, index: int) -> Recording:
    """Drive episode ``index`` of ``seed`` and keep every frame."""
    world = start(course, seed, index)
    frames = jax.device_get(_record(course, parameters, world))
    return recording(course, jax.device_get(world), *frames)


def recording(
    course: TestCourse, world: World, vehicles: Vehicles, memory: Any, sums: Sums, reward: Array
) -> Recording:
    """A recording from the start and what was gathered after each decision.

    Args:
        course: the test.
        world: at the start.
        vehicles: [T, N] after each decision; what follows the episode's end is left out.
        memory: [T] the controller's.
        sums: [T].
        reward: [T] of each decision.
    """
    frames = int(sums.decisions[-1])

    def track(name: str, dtype: type = np.float64) -> Any:
        first = np.asarray(getattr(world.vehicles, name))[None]
        return np.concatenate([first, getattr(vehicles, name)[:frames]]).astype(dtype)

    def padded(values: Any, first: Any, dtype: type = np.float64) -> Any:
        return np.concatenate([[first], np.asarray(values)[:frames]]).astype(dtype)

    goal = course.controller.goal(memory)
    lane = np.full(frames, -1) if goal is None else goal.goal.lane
    speed = np.full(frames, np.nan) if goal is None else goal.goal.speed
    ended = np.zeros(frames) if goal is None else goal.ended
    timed_out = np.zeros(frames) if goal is None else goal.timed_out
    return Recording(
        controller=course.controller.name,
        time=np.arange(frames + 1, dtype=np.float64) * course.driving.decision_duration,
        x=track("x"),
        y=track("y"),
        heading=track("heading"),
        speed=track("speed"),
        crashed=track("crashed", np.bool_),
        present=np.asarray(world.vehicles.present),
        role=trap.roles(world),
        length=np.asarray(world.drivers.length, np.float64),
        width=np.asarray(world.drivers.width, np.float64),
        lane_centre=np.asarray(world.road.centre, np.float64)[world.road.present],
        lane_width=np.asarray(world.road.width, np.float64)[world.road.present],
        goal_lane=padded(lane, lane[0], np.int64),
        goal_speed=padded(speed, speed[0]),
        goals_ended=padded(ended, 0, np.int64),
        goals_timed_out=padded(timed_out, 0, np.int64),
        reward=padded(reward, 0.0),
        accumulated_reward=padded(sums.reward, 0.0),
        escaped=padded(sums.escape > 0, False, np.bool_),
        accident=int(sums.accident[-1]),
    )
