"""Goals: a target lane and a target speed, how the high level moves them, and their features."""

from dataclasses import dataclass

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from lanewise.controllers.settings import GoalSettings
from lanewise.driving.percept import Percept

FEATURES = 2
"""Number of goal features the low-level controller observes."""
LATERAL_RANGE = 4.0
"""Lateral distance that reads as 1 in the goal features, m."""
SPEED_RANGE = 2.0
"""Speed difference that reads as 1 in the goal features, m/s."""

ACTION_SETS = {
    "joint-9": tuple((lane, speed) for lane in (-1, 0, 1) for speed in (-1, 0, 1)),
    "single-5": ((-1, 0), (0, -1), (0, 0), (0, 1), (1, 0)),
    "joint-6": tuple((lane, speed) for lane in (-1, 0, 1) for speed in (-1, 1)),
}
"""High-level actions of each set as (lane step, speed step): lane -1 is left, speed +1 faster."""


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Goal:
    """What the high level asks for."""

    lane: Array
    """int32 [] target lane."""
    speed: Array
    """[] target speed, m/s."""


def action_count(settings: GoalSettings) -> int:
    """Number of high-level actions."""
    return len(ACTION_SETS[settings.action_set])


def goal_from_state(settings: GoalSettings, percept: Percept) -> Goal:
    """The goal of going on as now: current lane and speed, within the bounds of goals."""
    return Goal(
        lane=percept.lane,
        speed=jnp.clip(percept.speed, settings.lowest_speed, settings.highest_speed),
    )


def apply_high_level_action(
    settings: GoalSettings, reference: Goal, percept: Percept, action: Array
) -> Goal:
    """The goal a high-level action makes of ``reference``: clipped to the road and the bounds."""
    steps = jnp.asarray(np.array(ACTION_SETS[settings.action_set], np.int32))[action]
    last_lane = jnp.sum(percept.road.present.astype(jnp.int32)) - 1
    return Goal(
        lane=jnp.clip(reference.lane + steps[0], 0, last_lane),
        speed=jnp.clip(
            reference.speed + steps[1] * settings.speed_step,
            settings.lowest_speed,
            settings.highest_speed,
        ),
    )


def errors(goal: Goal, percept: Percept) -> tuple[Array, Array]:
    """(lateral distance to the target lane's centre in m, speed difference in m/s), signed.

    delta_d = y_target_lane - y and delta_v = v_target - v_long, where v_long is the speed along
    the road (the paper's equations for the goal, its X read as lateral; row 19 of the reading).
    """
    along = percept.speed * jnp.cos(percept.heading)
    return percept.road.centre[goal.lane] - percept.y, goal.speed - along


def features(goal: Goal, percept: Percept) -> Array:
    """The two goal features of the low-level controller, scaled and clipped to [-2, 2]; [2]."""
    lateral, speed = errors(goal, percept)
    scaled = jnp.stack([lateral / LATERAL_RANGE, speed / SPEED_RANGE])
    return jnp.clip(scaled, -2.0, 2.0)


def tracking(goal: Goal, percept: Percept) -> Array:
    """How far from its goal the ego is: |delta_d| / 4 m + |delta_v| / 2 m/s (row 21); []."""
    lateral, speed = errors(goal, percept)
    return jnp.abs(lateral) / LATERAL_RANGE + jnp.abs(speed) / SPEED_RANGE
