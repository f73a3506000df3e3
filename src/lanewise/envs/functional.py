"""The trap as pure functions, for compiled loops of one's own.

``reset`` and ``step`` are written for one world; ``jax.vmap`` makes many of it, ``jax.lax.scan`` a
loop. Nothing is restarted by itself: see `restarted`.
"""

from dataclasses import dataclass
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
from jax import Array

from lanewise.config.validation import check_duration
from lanewise.driving import episode, headway, percept, restarting
from lanewise.driving.actions import are_numbers
from lanewise.driving.episode import Episode
from lanewise.driving.percept import Percept
from lanewise.driving.task_functions import PAPER_TASK, TaskFunctions, checked
from lanewise.envs import keywords
from lanewise.envs.control import Control, DirectControl, EnvConfig, GoalControl
from lanewise.errors import ActionError
from lanewise.fields.ranges import Between, FieldType
from lanewise.fields.suggestions import look_up
from lanewise.scenario.trap import SPLITS
from lanewise.system import pinned, process
from lanewise.world.state import World

ACTIONS = ("low-level", "goal", "continuous")
"""What an action may be, see `lanewise.envs.control`."""


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class State:
    """An episode under way."""

    episode: Episode
    """The world and what has been counted in it."""
    memory: Any
    """The control's: the goal under way."""
    reward: Array
    """[] of the last step, which may be several decisions."""


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Step:
    """What a step, or a reset, shows."""

    observation: Array
    """float32 [26]; of the state after the step, also where that was the episode's last."""
    reward: Array
    """float32 [] of the step; 0 after a reset."""
    terminated: Array
    """bool [] an accident ended the episode: no future to be valued."""
    truncated: Array
    """bool [] time ran out: the observation's value still counts."""
    escaped: Array
    """bool [] the ego has escaped by now: the paper's success, which a later accident leaves."""
    success: Array
    """bool [] the ego has escaped, and no accident has happened, by now."""
    accident: Array
    """int32 [] 0 none, 1 collision, 2 off the road, 3 come to a stop."""
    speed: Array
    """float32 [] the ego's, m/s."""
    timestep_reward: Array
    """float32 [] the paper's sum of rewards so far: one a second, an accident's once."""
    lane: Array
    """int32 [] the ego's nearest lane, from 0 at the left."""
    gap_ahead: Array
    """float32 [] m, bumper to bumper, to the nearest vehicle ahead in that lane (`headway`)."""
    time_to_collision: Array
    """float32 [] s until that gap is gone at the speeds of the moment; infinite if it does not
    shrink."""


def make(
    actions: str = "low-level",
    *,
    preset: str = "quick",
    trap: str = "trap-10",
    split: str = "training",
    duration: float = 25.0,
    task: TaskFunctions = PAPER_TASK,
    **settings: Any,
) -> EnvConfig:
    """The trap with these settings.

    Args:
        actions: what an action is: ``low-level``, one of nine; ``goal``, one of the high level's,
            with planner and goal critic beneath; or ``continuous``, acceleration and steering.
        preset: a training preset, which says over which starts training episodes vary.
        trap: a scenario preset, ``trap-10`` or ``trap-10.9``.
        split: from which starts: ``training``, ``validation`` or ``test``.
        duration: after which an episode is truncated, simulated s, rounded up to decisions.
        task: functions of the user's own for start, observation, reward and success.
        settings: any of scenario, driving, goals and planner (docs/settings.md), named in full,
            by the last word, or in a mapping named like the section.

    Raises:
        SettingsError: a name or a value is wrong; the message says what it may be.
    """
    composed = keywords.compose(preset, trap, settings)
    look_up("split", split, dict.fromkeys(SPLITS))
    if checked(task).names():
        process.refuse_forked()
    # Refuses what does not work.
    task.validate(composed.scenario, composed.driving, split)
    seconds = Between(composed.driving.decision_duration, 100_000.0, "s")
    duration = FieldType(float, None, seconds).check("duration", keywords.plain(duration))
    check_duration("duration", duration, composed.scenario)
    controls: dict[str, Control] = {
        "low-level": DirectControl(),
        "goal": GoalControl(composed.goals, composed.planner),
        "continuous": DirectControl(count=0),
    }
    return EnvConfig(
        scenario=composed.scenario,
        driving=composed.driving,
        task=task,
        control=look_up("kind of action", actions, controls),
        duration=composed.driving.decisions_in(duration),
        split=split,
    )


@pinned.jit(static_argnums=0)
def reset(config: EnvConfig, key: Array) -> tuple[State, Step]:
    """A fresh episode, whose start is drawn by a random key, and what it shows."""
    return start(config, config.task.start(config.scenario, pinned.own(key), config.split))


@pinned.jit(static_argnums=0)
def step(config: EnvConfig, state: State, action: Array) -> tuple[State, Step]:
    """The state after one step, and what it led to; after an episode's end without meaning.

    Args:
        config: from `make`.
        state: before the step.
        action: int32 [] index of a low-level action or a goal; for continuous ones float32 [2]:
            acceleration and steering (positive to the right) from -1 to 1.

    Raises:
        ActionError: the action has another type or shape. Its value is not looked at.
    """
    given = jnp.asarray(action)
    _check_kind(config.control, given)
    # In 32 bits, also from a caller whose JAX has 64.
    chosen = given.astype(jnp.float32 if jnp.issubdtype(given.dtype, jnp.floating) else jnp.int32)
    return after_step(config, *config.control.drive(config, state.episode, state.memory, chosen))


def _check_kind(control: Control, action: Array) -> None:
    """Refuses an action of another type or shape; traced, it has no value yet."""
    shape = () if control.count else (2,)
    wanted = "one whole number" if control.count else "two numbers, acceleration and steering"
    if action.shape != shape or not are_numbers(action.dtype, control.count):
        raise ActionError(f"an action must be {wanted}, got {action.dtype} of shape {action.shape}")


def observed(config: EnvConfig, world: World) -> Percept:
    """What there is to see; in other splits than tests with the noise of training."""
    training = config.split != "test"
    return percept.perceive(config.driving.observation, world, config.task, training)


def after_step(config: EnvConfig, after: Episode, memory: Any, reward: Array) -> tuple[State, Step]:
    """The state after a step, and what it shows, whoever simulated it."""
    state = State(after, memory, reward)
    outcome = after.outcome
    near = headway.of_ego(after.world)
    return state, Step(
        observation=observed(config, after.world).features,
        reward=reward,
        terminated=outcome.terminated,
        truncated=outcome.truncated,
        escaped=after.stats.escaped,
        success=after.stats.success,
        accident=outcome.accident,
        speed=after.world.vehicles.speed[0],
        timestep_reward=after.stats.timestep_reward,
        lane=near.lane,
        gap_ahead=near.gap,
        time_to_collision=near.time_to_collision,
    )


def restarted(config: EnvConfig, states: State, steps: Step, keys: Array) -> tuple[State, Array]:
    """([W] states, [W, 26] observations to act on next), fresh where an episode has ended.

    Args:
        config: from `make`.
        states: [W] after a step.
        steps: [W] what the step showed; its observations are those of the episodes that ended.
        keys: [W] random keys, used where an episode ended.
    """

    def begin(over: Array) -> tuple[State, Array]:
        fresh, shown = jax.vmap(partial(reset, config))(keys[over])
        return fresh, shown.observation

    done = steps.terminated | steps.truncated
    found: tuple[State, Array] = restarting.restart_finished(
        done, (states, steps.observation), begin
    )
    return found


def start(config: EnvConfig, world: Any) -> tuple[State, Step]:
    """A fresh episode from a world of one's own (`lanewise.scenario.trap.place` makes them)."""
    begun = episode.begin(world)
    memory = config.control.begin(config, begun)
    return after_step(config, begun, memory, jnp.zeros_like(world.vehicles.x[0]))
