"""The rule-based planner: it previews short action sequences and takes the best first action.

The nine actions turn the wheel by a fixed angle for a whole decision, so the heading moves in
quanta of v sin(beta) / (L / 2) times the decision's length, and only pairs of opposite turns *at
the same speed* bring it back to zero exactly. Hence the rule: speed changes while driving
straight, turns at constant speed. Within it every steering sequence of the preview is compared.
"""

import itertools
from math import atan, sin, tan

import jax.numpy as jnp
import numpy as np
from jax import Array

from lanewise.controllers.goals import Goal
from lanewise.controllers.settings import PlannerSettings
from lanewise.driving import actions
from lanewise.driving.percept import Percept
from lanewise.driving.settings import DrivingSettings
from lanewise.world.settings import CAR_LENGTH

HALF_LENGTH = CAR_LENGTH / 2
"""Half the ego's length, the lever arm of the bicycle model, m."""
STRAIGHT = 0.004
"""Headings below this count as driving straight, rad: less than any turn's quantum above 1 m/s."""
HEADING_LIMIT = 0.2
"""Headings above this cost the preview, rad."""
LOOK_AHEAD = 1.0
"""The final offset is judged where the car will be this much later, s."""
SPEED_FIRST = 1.5
"""Farther than this from the target lane's centre, the target speed comes before the turn, m."""
REST = 0.28
"""Coming to rest farther from the lane's centre than this costs extra, m: goals want 0.3."""


def act(settings: PlannerSettings, driving: DrivingSettings, goal: Goal, percept: Percept) -> Array:
    """The low-level action that heads for ``goal``; int32 [].

    Minimises, over the steering sequences of the preview and their trims (none, or one decision
    slower or faster, which shifts the lateral quantum where it would straddle the lane's centre),
    the sum of the offset, heading and speed costs.
    """
    turns, trims, trim_steps = candidates(settings.preview)
    trim = jnp.asarray(trims, percept.speed.dtype)
    offset = percept.y - percept.road.centre[goal.lane]
    offset, heading, speed = (
        jnp.broadcast_to(value, (len(turns),)) for value in (offset, percept.heading, percept.speed)
    )
    quantum = driving.actions.acceleration * driving.decision_duration
    cost = 0.2 * jnp.abs(trim)
    for step in range(settings.preview):
        turn = jnp.asarray(turns[:, step], speed.dtype)
        straight = (turn == 0) & (jnp.abs(heading) < STRAIGHT)
        pull = speed_rule(driving, goal.speed, speed)
        pull = jnp.where((trims != 0) & (trim_steps == step), trim, pull)
        # A trimmed speed is held: returning to the target at once would undo it.
        held = (trims != 0) & (trim_steps < step)
        pull = jnp.where(straight & ~held, pull, 0.0)
        if step == 0:
            first = (turn, pull)
        # A trim costs once, not while it is held: so half a swing costs what its rest costs.
        wanted = goal.speed + jnp.where(trim_steps <= step, trim * quantum, 0.0)
        offset, heading, speed = _preview(driving, offset, heading, speed, turn, pull)
        cost += (
            0.3 * offset**2
            + (100.0 * jnp.maximum(jnp.abs(heading) - HEADING_LIMIT, 0.0)) ** 2
            + 0.01 * jnp.abs(turn)
            + 0.1 * jnp.abs(speed - wanted)
        )
    final = offset + LOOK_AHEAD * speed * jnp.sin(heading)
    cost += 10.0 * final**2 + 10.0 * jnp.maximum(jnp.abs(final) - REST, 0.0)
    cost += 0.3 * (30.0 * heading) ** 2
    ruled_out = jnp.asarray((turns[:, 0] != 0) | (trims != 0))
    cost = jnp.where(_waits(driving, goal, percept) & ruled_out, jnp.inf, cost)
    best = jnp.argmin(cost)
    turn, pull = (value[best].astype(jnp.int32) for value in first)
    return actions.index(pull, turn)


def speed_rule(driving: DrivingSettings, target: Array, speed: Array) -> Array:
    """Sign of the acceleration that brings ``speed`` nearest to ``target`` in one decision."""
    quantum = driving.actions.acceleration * driving.decision_duration
    return jnp.clip(jnp.round((target - speed) / quantum), -1.0, 1.0)


def _waits(driving: DrivingSettings, goal: Goal, percept: Percept) -> Array:
    """Whether a change of lane waits for the target speed; bool [].

    Turning at constant speed would otherwise put the lane first every time: a goal's speed would
    never come true while lanes change, and the high level would learn to ask for speeds that a
    low level, which does accelerate while turning, had better not drive.
    """
    pending = speed_rule(driving, goal.speed, percept.speed) != 0
    far = jnp.abs(percept.y - percept.road.centre[goal.lane]) > SPEED_FIRST
    return pending & far & (jnp.abs(percept.heading) < STRAIGHT)


def _preview(
    driving: DrivingSettings, offset: Array, heading: Array, speed: Array, turn: Array, pull: Array
) -> tuple[Array, Array, Array]:
    """One decision of the bicycle model in closed form.

    Exact when turning at constant speed, up to the midpoint rule.
    """
    ticks, tick = driving.ticks_per_decision, driving.tick_duration
    slip = atan(tan(driving.actions.steering) / 2.0)
    rate = speed * sin(slip) / HALF_LENGTH * turn
    acceleration = pull * driving.actions.acceleration
    distance = (speed + acceleration * tick * (ticks - 1) / 2.0) * tick * ticks
    course = heading + slip * turn + rate * tick * (ticks - 1) / 2.0
    return (
        offset + distance * jnp.sin(course),
        heading + rate * tick * ticks,
        speed + acceleration * tick * ticks,
    )


def candidates(preview: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """What the preview compares, one row each.

    All steering sequences, plain or trimmed in their first decision. Besides, where the preview
    is long enough, the swings: to the other side and back at another speed, which moves the car
    by the small difference of two lateral quanta. Without them it could rest half a quantum off
    the centre, which is more than 0.3 m above 13.8 m/s.

    Returns:
        (signs of the steering [S, preview], signs of the trims [S], decisions of the trims [S]).
    """
    turns = np.array(list(itertools.product((0, -1, 1), repeat=preview)), np.float64)
    trims = np.repeat([0.0, -1.0, 1.0], len(turns))
    turns = np.tile(turns, (3, 1))
    trim_steps = np.zeros(len(turns), np.int32)
    if preview >= 5:
        swing = np.pad(np.array([1.0, -1.0, 0.0, -1.0, 1.0]), (0, preview - 5))
        turns = np.concatenate([turns, [swing, swing, -swing, -swing]])
        trims = np.concatenate([trims, [-1.0, 1.0, -1.0, 1.0]])
        trim_steps = np.concatenate([trim_steps, np.full(4, 2, np.int32)])
    return turns, trims, trim_steps
