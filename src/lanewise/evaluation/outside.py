"""Anyone's policy through the paper's protocol: the same starts, decisions, metrics and frames.

The policy takes the place of a network: it chooses, and our controllers do the rest.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from numpy.typing import NDArray

from lanewise.driving import actions, episode
from lanewise.driving.episode import Episode, Outcome
from lanewise.evaluation import drive
from lanewise.evaluation.drive import BLOCK, Sums, TestCourse
from lanewise.evaluation.episodes import Episodes, Recording
from lanewise.evaluation.policies import Decide
from lanewise.system import pinned
from lanewise.world.state import World

Under = tuple[Episode, Any, Sums]
"""An episode under way: its state, the controller's memory, what was gathered."""


@dataclass(frozen=True)
class OutsideCourse:
    """A test whose choices come from outside. Static."""

    test: TestCourse
    """Its controller takes the choices: single-level for actions, planned for goals."""
    actions: str
    """What a choice is: ``low-level``, ``goal`` or ``continuous``."""

    @property
    def choices(self) -> int:
        """Number of choices; 0 for continuous ones."""
        if self.actions == "continuous":
            return 0
        (level,) = self.test.controller.levels
        return level.choice_count


def test(
    course: OutsideCourse,
    decide: Decide,
    seed: int,
    count: int,
    done: Callable[[int], None] = lambda count: None,
) -> Episodes:
    """Drive episodes 0 to ``count - 1`` of ``seed``, as `drive.test` does.

    Args:
        course: scenario, rules, duration, split and kind of action.
        decide: the policy; asked for all episodes of a block at once.
        seed: of the starts.
        count: number of episodes.
        done: told after each block how many are done.

    Returns:
        Their outcomes, in order.

    Raises:
        LanewiseError: the policy chose something that does not exist.
    """
    blocks = []
    for first in range(0, count, BLOCK):
        asked_for = first + np.arange(BLOCK) < count
        *_, ((_, _, sums), _) = _block(course, decide, seed, first, asked_for)
        blocks.append(jax.device_get(sums))
        done(min(count, first + BLOCK))
    whole = jax.tree.map(lambda *parts: np.concatenate(parts)[:count], *blocks)
    return drive.as_episodes(course.test.driving, whole)


def record(course: OutsideCourse, decide: Decide, seed: int, index: int) -> Recording:
    """Drive episode ``index`` of ``seed`` and keep every frame."""
    place = index % BLOCK
    # With its whole block, so that it is the episode that `test` drives.
    frames = [
        jax.tree.map(lambda leaf: np.asarray(leaf[place]), (state.world.vehicles, *rest, reward))
        for (state, *rest), reward in _block(
            course, decide, seed, index - place, np.arange(BLOCK) == place
        )
    ]
    stacked = jax.tree.map(lambda *leaf: np.stack(leaf), *frames)
    world = jax.device_get(drive.start(course.test, seed, index))
    return drive.recording(course.test, world, *stacked)


def _block(
    course: OutsideCourse,
    decide: Decide,
    seed: int,
    first: int,
    asked_for: NDArray[np.bool_],
) -> Iterator[tuple[Under, Array]]:
    """The episodes of a block, decision by decision, until those asked for are over.

    Yields:
        They, and what the decision paid.
    """
    under, seen = _begin(course, drive.start_block(course.test, seed, first))
    going = asked_for
    for number in range(course.test.duration):
        choices = decide(np.asarray(seen), going, number == 0)
        under, seen, reward = _advance(course, under, choices)
        yield under, reward
        going = asked_for & ~np.asarray(under[2].over)
        if not going.any():
            return


@pinned.jit(static_argnums=0)
def _begin(course: OutsideCourse, worlds: World) -> tuple[Under, Array]:
    """([B] episodes, [B, n] what there is to see)."""

    def one(world: World) -> tuple[Under, Array]:
        return begin(course, world)

    found: tuple[Under, Array] = jax.vmap(one)(worlds)
    return found


@pinned.jit(static_argnums=0)
def _advance(course: OutsideCourse, under: Under, choices: Array) -> tuple[Under, Array, Array]:
    """([B] episodes one decision later, [B, n] what there is to see, [B] reward)."""

    def one(under: Under, choice: Array) -> tuple[Under, Array, Array]:
        state, memory, sums = under
        rules = course.test
        action, memory = act(course, state, memory, choice)
        acceleration, steering = commands(course, action)
        state, outcome = episode.drive(
            rules.driving, state, acceleration, steering, rules.duration, rules.parts
        )
        return gathered(course, state, memory, sums, outcome)

    found: tuple[Under, Array, Array] = jax.vmap(one)(under, choices)
    return found


def begin(course: OutsideCourse, world: World) -> tuple[Under, Array]:
    """(the episode that starts in ``world``, what there is to see)."""
    state, memory = drive.begin(course.test, world)
    rules = course.test
    sums = replace(
        drive.nothing_yet(world.vehicles.x[0]),
        sound=drive.sound(rules.driving, state, rules.parts),
    )
    return (state, memory, sums), drive.look(rules, state).features


def act(course: OutsideCourse, state: Episode, memory: Any, choice: Array) -> tuple[Array, Any]:
    """(the action that a choice leads to, the controller's memory)."""
    if not course.choices:
        return choice, memory
    seen, controller = drive.look(course.test, state), course.test.controller
    memory = controller.perceive(memory, seen)
    (level,) = controller.levels
    memory = level.choose(memory, seen, choice)
    return controller.act(memory, seen)


def commands(course: OutsideCourse, action: Array) -> tuple[Array, Array]:
    """(acceleration in m/s^2, steering in rad) of an action, float32."""
    sizes = course.test.driving.actions
    if not course.choices:
        return actions.shared(sizes, action)
    return actions.commands(sizes, action, jnp.dtype(jnp.float32))


def gathered(
    course: OutsideCourse, state: Episode, memory: Any, sums: Sums, outcome: Outcome
) -> tuple[Under, Array, Array]:
    """(the episode, what there is to see, reward) after a decision, whoever simulated it."""
    goal = course.test.controller.goal(memory)
    rules = course.test
    sums = drive.gather(rules.driving, sums, state, outcome, goal, rules.parts)
    return (state, memory, sums), drive.look(course.test, state).features, outcome.reward
