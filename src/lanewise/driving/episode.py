"""One episode: a world, what the ego has gathered in it, and the step from decision to decision."""

from dataclasses import dataclass
from functools import partial

import jax
import jax.numpy as jnp
from jax import Array

from lanewise.driving import accidents, actions, chance
from lanewise.driving.settings import DrivingSettings
from lanewise.driving.task_functions import PAPER_TASK, TaskFunctions
from lanewise.world import bicycle, tick, waves
from lanewise.world.state import RULE_BASED, World
from lanewise.world.steering import from_slip_sine


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

    @property
    def over(self) -> Array:
        """Whether the episode ended; bool []."""
        return self.terminated | self.truncated


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class EpisodeStats:
    """Everything that is counted along an episode, once for training, tests and environments."""

    decisions: Array
    """int32 [] decisions taken so far."""
    escape_decision: Array
    """int32 [] the decision after which the ego's rear had first passed the front of every trap
    car; 0 before."""
    reward: Array
    """[] sum of the external rewards, one a decision."""
    timestep_reward: Array
    """[] the paper's sum: one reward a second, an accident's penalty once."""
    speed_sum: Array
    """[] sum of the ego's speed after each decision, m/s."""
    distance: Array
    """[] travelled along the road since the start, m."""
    outcome: Outcome
    """Of the last decision; zeros before the first."""

    @property
    def escaped(self) -> Array:
        """The paper's success by now: past every trap car; a later accident leaves it. bool []."""
        return self.escape_decision > 0

    @property
    def success(self) -> Array:
        """Escaped, and no accident by now; bool []."""
        return self.escaped & ~self.outcome.terminated


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Episode:
    """The state of an episode under way."""

    world: World
    """The road and everyone on it."""
    start_x: Array
    """[] the ego's x at the start, m."""
    stats: EpisodeStats
    """What has been counted so far."""

    @property
    def outcome(self) -> Outcome:
        """Of the last decision."""
        return self.stats.outcome


def begin(world: World) -> Episode:
    """The episode that starts in ``world``."""
    zero, none, no = jnp.zeros_like(world.vehicles.x[0]), jnp.int32(0), jnp.bool_(False)
    stats = EpisodeStats(
        decisions=none,
        escape_decision=none,
        reward=zero,
        timestep_reward=zero,
        speed_sum=zero,
        distance=zero,
        outcome=Outcome(reward=zero, accident=none, terminated=no, truncated=no),
    )
    return Episode(world=world, start_x=world.vehicles.x[0], stats=stats)


def step(
    settings: DrivingSettings,
    episode: Episode,
    action: Array,
    duration: int,
    task: TaskFunctions = PAPER_TASK,
    training: bool = False,
) -> Episode:
    """The episode after one decision: an action of `actions.commands`, ticks, reward and endings.

    It is truncated after ``duration`` decisions. `Episode.outcome` says what the decision led to.
    In ``training`` the latency is as set for it.
    """
    dtype = episode.world.vehicles.x.dtype
    acceleration, steering = actions.commands(settings.actions, action, dtype)
    lasts = settings.decision_duration
    world = waves.follow(episode.world, episode.stats.decisions * lasts, lasts)
    world = _drive(settings, world, acceleration, steering, settings.latency_ticks(training))
    return evaluate_step(settings, episode, world, steering, duration, task)


def _drive(
    settings: DrivingSettings,
    world: World,
    acceleration: Array,
    steering: Array,
    latency: tuple[int, int],
) -> World:
    """The world a decision later; the command takes effect after so many ticks, least and most."""
    low, high = latency
    lasts, count = settings.tick_duration, settings.ticks_per_decision
    late = chance.ticks(world, low, high) if high > low else high
    if low:
        world = tick.run(world, lasts, low)
    for number in range(low, high):
        commanded = bicycle.command(world, acceleration, steering)
        world = jax.tree.map(partial(jnp.where, late == number), commanded, world)
        world = tick.run(world, lasts, 1)
    commanded = bicycle.command(world, acceleration, steering)
    if high > low:
        commanded = jax.tree.map(partial(jnp.where, late == high), commanded, world)
    return tick.run(commanded, lasts, count - high)


def evaluate_step(
    settings: DrivingSettings,
    before: Episode,
    world: World,
    steering: Array,
    duration: int,
    task: TaskFunctions = PAPER_TASK,
) -> Episode:
    """The episode after a decision that steered by an angle, rad, and led to ``world``.

    Whoever simulated that.
    """
    # A rule-based ego ignores actions; how it steered is in the world.
    by_rules = world.drivers.kind[0] == RULE_BASED
    steering = jnp.where(by_rules, from_slip_sine(world.vehicles.slip_sine[0]), steering)
    stats = before.stats
    decisions = stats.decisions + 1
    accident = accidents.ego_accident(world, settings.stopped_speed)
    terminated = accident != accidents.NONE
    reward = task.reward(settings.reward, world, steering, terminated)
    outcome = Outcome(
        reward=jnp.asarray(reward, stats.reward.dtype),
        accident=accident,
        terminated=terminated,
        truncated=(decisions >= duration) & ~terminated,
    )
    escapes = ~stats.escaped & task.success(world) & ~terminated
    counts = _ends_timestep(settings, decisions) | terminated
    after = EpisodeStats(
        decisions=decisions,
        escape_decision=jnp.where(escapes, decisions, stats.escape_decision),
        reward=stats.reward + outcome.reward,
        timestep_reward=stats.timestep_reward + jnp.where(counts, outcome.reward, 0.0),
        speed_sum=stats.speed_sum + world.vehicles.speed[0],
        distance=world.vehicles.x[0] - before.start_x,
        outcome=outcome,
    )
    return Episode(world=world, start_x=before.start_x, stats=after)


def _ends_timestep(settings: DrivingSettings, decisions: Array) -> Array:
    """Whether a second of simulated time is completed by this decision; bool [].

    The paper adds one reward a second (row 3 of the reading).
    """
    ticks = settings.ticks_per_decision
    return decisions * ticks % settings.simulation_frequency < ticks
