"""Greedy test episodes in the real highway-env, from the same starts as in our world.

The percept comes from the live environment's state through *our* observation, and at every
decision it is checked against highway-env's own ``Kinematics`` observation.
"""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from lanewise.controllers import controller as controllers
from lanewise.controllers.controller import Parameters
from lanewise.driving import actions, episode, observation
from lanewise.driving.episode import Episode
from lanewise.driving.settings import DrivingSettings
from lanewise.errors import LanewiseError, SettingsError
from lanewise.evaluation import drive
from lanewise.evaluation.drive import Sums, TestCourse
from lanewise.evaluation.episodes import Episodes, Recording
from lanewise.interop import highway_env
from lanewise.system import pinned
from lanewise.world.state import World

OBSERVATION_TOLERANCE = 1e-4
"""Largest difference allowed between highway-env's observation and ours, both scaled its way."""


def test(
    course: TestCourse,
    parameters: Parameters,
    seed: int,
    count: int,
    done: Callable[[int], None] = lambda count: None,
) -> Episodes:
    """Drive episodes 0 to ``count - 1`` of ``seed`` greedily in highway-env.

    Args:
        course: scenario, rules, controller, duration and split.
        parameters: of all the controller's levels.
        seed: of the starts.
        count: number of episodes.
        done: told after each episode how many are done.

    Returns:
        Their outcomes, in order.
    """
    rows = []
    for index in range(count):
        rows.append(_drive(course, parameters, seed, index)[-1][2])
        done(index + 1)
    return drive.as_episodes(course.driving, jax.tree.map(lambda *leaf: np.stack(leaf), *rows))


def record(course: TestCourse, parameters: Parameters, seed: int, index: int) -> Recording:
    """Drive episode ``index`` of ``seed`` in highway-env and keep every frame."""
    frames = _drive(course, parameters, seed, index)
    stacked = jax.tree.map(lambda *leaf: np.stack(leaf), *frames)
    return drive.recording(course, start(course, seed, index), *stacked)


def start(course: TestCourse, seed: int, index: int) -> World:
    """The world at the start of episode ``index`` as highway-env holds it: nobody is absent."""
    world: World = jax.device_get(drive.start(course, seed, index))
    there = world.vehicles.present

    def of(part: Any) -> Any:
        return jax.tree.map(lambda leaf: leaf[there], part)

    return replace(world, drivers=of(world.drivers), vehicles=of(world.vehicles))


def _drive(course: TestCourse, parameters: Parameters, seed: int, index: int) -> list[Any]:
    """One episode: (vehicles, memory, sums, reward) after each decision."""
    world = jax.device_get(drive.start(course, seed, index))
    env = live(course.driving, world, course.duration)
    state = episode.begin(read(env))
    memory = _start(course, state.world)
    sums = drive.nothing_yet(state.world.vehicles.x[0])
    theirs = env.observation_type.observe()
    frames = []
    while not sums.over:
        action, memory, ours = _decide(course, parameters, state, memory)
        check(theirs, ours)
        theirs = env.step(int(action))[0]
        after = read(env)
        state, sums, reward = _judge(course, state, after, action, memory, sums)
        frames.append(jax.device_get((state.world.vehicles, memory, sums, reward)))
    env.close()
    return frames


def live(driving: DrivingSettings, world: World, duration: int) -> Any:
    """highway-env at the start of an episode of so many decisions.

    Raises:
        SettingsError: others than vehicle 0 are driven from outside too.
    """
    env = highway_env.build_env(
        world,
        simulation_frequency=driving.simulation_frequency,
        decision_frequency=driving.decision_frequency,
        acceleration=driving.actions.acceleration,
        steering=driving.actions.steering,
        duration=duration * driving.decision_duration,
    )
    if env.controlled_vehicles != [env.road.vehicles[0]]:
        raise SettingsError("only vehicle 0 can be driven here; make the others CONSTANT")
    return env


@pinned.switches()
def read(env: Any) -> World:
    """The world of a live environment in the precision of training: what controllers learnt on."""

    def narrow(leaf: Any) -> Array:
        array = np.asarray(leaf)
        return jnp.asarray(array.astype(np.float32) if array.dtype == np.float64 else array)

    narrowed: World = jax.tree.map(narrow, highway_env.read_world(env))
    return narrowed


@pinned.jit(static_argnums=0)
def _start(course: TestCourse, world: World) -> Any:
    """The controller's memory at the start."""
    return drive.begin(course, world)[1]


@pinned.jit(static_argnums=0)
def _decide(
    course: TestCourse, parameters: Parameters, state: Episode, memory: Any
) -> tuple[Array, Any, Array]:
    """(action, memory, the observation highway-env should have made, [5, 5])."""
    seen = drive.look(course, state)
    action, memory, _ = controllers.act(course.controller, parameters, memory, seen)
    return action, memory, highway_env_s(course.driving, state.world)


def highway_env_s(driving: DrivingSettings, world: World) -> Array:
    """The observation highway-env should make of a world, [5, 5]."""
    theirs = replace(driving.observation, scaling="highway-env", perception_distance=200.0)
    features = observation.features(theirs, world)
    return jnp.delete(features, observation.LANE_OFFSET).reshape(5, 5)


@pinned.jit(static_argnums=0)
def _judge(
    course: TestCourse, state: Episode, world: World, action: Array, memory: Any, sums: Sums
) -> tuple[Episode, Sums, Array]:
    """(episode, sums, reward) after a decision that highway-env simulated."""
    goal = course.controller.goal(memory)
    _, steering = actions.commands(course.driving.actions, action, world.vehicles.x.dtype)
    state, outcome = episode.judge(
        course.driving, state, world, steering, course.duration, course.parts
    )
    sums = drive.gather(course.driving, sums, state, outcome, goal, course.parts)
    return state, sums, outcome.reward


def check(theirs: Any, ours: Array) -> None:
    """Stop when the two observations differ: one of them is wrong, and no result would count.

    The order of vehicles that are equally near is the list's in both.
    """
    difference = float(np.max(np.abs(theirs - np.asarray(ours))))
    if not difference < OBSERVATION_TOLERANCE:
        raise LanewiseError(
            f"highway-env observes something else than we do, off by {difference:.2g}: "
            "no result would count; please report the settings and the seed"
        )
