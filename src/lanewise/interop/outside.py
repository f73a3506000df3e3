"""Anyone's policy through the paper's protocol in the real highway-env."""

from collections.abc import Callable
from typing import Any

import jax
import numpy as np
from jax import Array

from lanewise.driving import episode
from lanewise.errors import LanewiseError
from lanewise.evaluation import drive, outside
from lanewise.evaluation.episodes import Episodes, Recording
from lanewise.evaluation.outside import OutsideCourse, Under
from lanewise.evaluation.policies import Decide
from lanewise.interop import drive as twin
from lanewise.system import pinned
from lanewise.world.state import World


def test(
    course: OutsideCourse,
    decide: Decide,
    seed: int,
    count: int,
    done: Callable[[int], None] = lambda count: None,
) -> Episodes:
    """As `lanewise.evaluation.outside.test`, one episode after the other, in highway-env.

    Raises:
        LanewiseError: the policy's actions are continuous, or one does not exist.
    """
    rows = []
    for index in range(count):
        rows.append(_drive(course, decide, seed, index)[-1][2])
        done(index + 1)
    whole = jax.tree.map(lambda *leaf: np.stack(leaf), *rows)
    return drive.as_episodes(course.test.driving, whole)


def record(course: OutsideCourse, decide: Decide, seed: int, index: int) -> Recording:
    """Drive episode ``index`` of ``seed`` and keep every frame."""
    frames = _drive(course, decide, seed, index)
    stacked = jax.tree.map(lambda *leaf: np.stack(leaf), *frames)
    return drive.recording(course.test, twin.start(course.test, seed, index), *stacked)


def _drive(course: OutsideCourse, decide: Decide, seed: int, index: int) -> list[Any]:
    """One episode: (vehicles, memory, sums, reward) after each decision."""
    if not course.choices:
        raise LanewiseError(
            "continuous actions are not driven in highway-env here; evaluate in lanewise"
        )
    rules = course.test
    world = jax.device_get(drive.start(rules, seed, index))
    env = twin.live(rules.driving, world, rules.duration)
    theirs = env.observation_type.observe()
    under, seen, ours = _begin(course, twin.read(env))
    frames: list[Any] = []
    while not under[2].over:
        twin.check(theirs, ours)
        choice = decide(np.asarray(seen)[None], np.ones(1, np.bool_), not frames)[0]
        action, memory = _act(course, under, choice)
        theirs = env.step(int(action))[0]
        under, seen, reward, ours = _judge(course, under, twin.read(env), memory, action)
        state, memory, sums = under
        frames.append(jax.device_get((state.world.vehicles, memory, sums, reward)))
    env.close()
    return frames


@pinned.jit(static_argnums=0)
def _begin(course: OutsideCourse, world: World) -> tuple[Under, Array, Array]:
    """(the episode, what there is to see, what highway-env should see)."""
    under, seen = outside.begin(course, world)
    return under, seen, twin.highway_env_s(course.test.driving, world)


@pinned.jit(static_argnums=0)
def _act(course: OutsideCourse, under: Under, choice: Array) -> tuple[Array, Any]:
    """(the low-level action that a choice leads to, the controller's memory)."""
    state, memory, _ = under
    return outside.act(course, state, memory, choice)


@pinned.jit(static_argnums=0)
def _judge(
    course: OutsideCourse, under: Under, world: World, memory: Any, action: Array
) -> tuple[Under, Array, Array, Array]:
    """(the episode after a decision, what there is to see, reward, what highway-env should see)."""
    state, _, sums = under
    rules = course.test
    _, steering = outside.commands(course, action)
    state, outcome = episode.judge(
        rules.driving, state, world, steering, rules.duration, rules.parts
    )
    found = outside.gathered(course, state, memory, sums, outcome)
    return (*found, twin.highway_env_s(rules.driving, world))
