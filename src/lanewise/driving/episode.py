"""One episode: a world, how far the ego has come, and the step from decision to decision."""

from dataclasses import dataclass

import jax
import jax.numpy as jnp
from jax import Array

from lanewise.driving import accidents, actions
from lanewise.driving.parts import OURS, Parts
from lanewise.driving.settings import DrivingSettings
from lanewise.world import bicycle, tick
from lanewise.world.state import RULE_BASED, World
from lanewise.world.steering import of_slip


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Episode:
    """The state of an episode under way."""

    world: World
    """The road and everyone on it."""
    decisions: Array
    """int32 [] decisions taken so far."""
    escaped: Array
    """bool [] success by now: the ego's rear has passed the front of every trap car."""


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Outcome:
    """What one decision led to; ``terminated`` and ``truncated`` stay apart."""

    reward: Array
    """[] external reward, eq. (6)."""
    accident: Array
    """int32 [] accident code, see `accidents`."""
    terminated: Array
    """bool [] an accident ended the episode."""
    truncated: Array
    """bool [] time ran out, without an accident."""


def begin(world: World) -> Episode:
    """The episode that starts in ``world``."""
    return Episode(world=world, decisions=jnp.int32(0), escaped=jnp.bool_(False))


def step(
    settings: DrivingSettings,
    episode: Episode,
    action: Array,
    duration: int,
    parts: Parts = OURS,
) -> tuple[Episode, Outcome]:
    """One decision: act, let the world tick, then look at reward and endings.

    Args:
        settings: the decision process.
        episode: before the decision.
        action: int32 [] low-level action index.
        duration: decisions after which the episode is truncated.
        parts: whose reward and success count.

    Returns:
        The episode after the decision, and its outcome.
    """
    dtype = episode.world.vehicles.x.dtype
    acceleration, steering = actions.commands(settings.actions, action, dtype)
    return drive(settings, episode, acceleration, steering, duration, parts)


def drive(
    settings: DrivingSettings,
    episode: Episode,
    acceleration: Array,
    steering: Array,
    duration: int,
    parts: Parts = OURS,
) -> tuple[Episode, Outcome]:
    """As `step`, with any acceleration, m/s^2, and steering, rad, positive to the right."""
    world = bicycle.command(episode.world, acceleration, steering)
    world = tick.run(world, settings.tick_duration, settings.ticks_per_decision)
    return judge(settings, episode, world, steering, duration, parts)


def ends_timestep(settings: DrivingSettings, after: Episode, outcome: Outcome) -> Array:
    """Whether a decision's reward counts in the paper's sum: one a second, and an accident's.

    bool []; row 3 of the reading. The decision in which a second of simulated time is completed
    counts for it.
    """
    ticks = settings.ticks_per_decision
    full = after.decisions * ticks % settings.simulation_frequency < ticks
    return full | outcome.terminated


def judge(
    settings: DrivingSettings,
    before: Episode,
    world: World,
    steering: Array,
    duration: int,
    parts: Parts = OURS,
) -> tuple[Episode, Outcome]:
    """What a decision led to, given the world after it, whoever simulated it.

    Args:
        settings: the decision process.
        before: the episode before the decision.
        world: the world after it.
        steering: [] angle the decision steered by, rad.
        duration: decisions after which the episode is truncated.
        parts: whose reward and success count.

    Returns:
        The episode after the decision, and its outcome.
    """
    # A rule-based ego heeds no action; what it steered last is in the world.
    by_rules = world.drivers.kind[0] == RULE_BASED
    steering = jnp.where(by_rules, of_slip(world.vehicles.slip_sine[0]), steering)
    decisions = before.decisions + 1
    accident = accidents.of_ego(world, settings.stopped_speed)
    terminated = accident != accidents.NONE
    outcome = Outcome(
        reward=parts.reward(settings.reward, world, steering, terminated),
        accident=accident,
        terminated=terminated,
        truncated=(decisions >= duration) & ~terminated,
    )
    escaped = before.escaped | (parts.success(world) & ~terminated)
    return Episode(world=world, decisions=decisions, escaped=escaped), outcome
