"""The goal critic: has the goal been reached, and may the high level set a new one?"""

from dataclasses import dataclass, replace

import jax
import jax.numpy as jnp
from jax import Array

from lanewise.controllers import goals
from lanewise.controllers.goals import Goal
from lanewise.controllers.settings import GoalSettings
from lanewise.driving.percept import Percept
from lanewise.driving.settings import DrivingSettings


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class GoalMemory:
    """A goal under way."""

    goal: Goal
    """The goal."""
    age: Array
    """int32 [] decisions since it was set."""
    due: Array
    """bool [] the high level is to set a new goal now."""
    ended: Array
    """int32 [] goals of this episode that were reached or given up."""
    timed_out: Array
    """int32 [] of those, how many were given up."""


def start(settings: GoalSettings, percept: Percept) -> GoalMemory:
    """The memory at an episode's start: no goal yet, the first one relative to the moment."""
    zero = jnp.int32(0)
    return GoalMemory(
        goal=goals.goal_from_state(settings, percept),
        age=zero,
        due=jnp.bool_(True),
        ended=zero,
        timed_out=zero,
    )


def reached(settings: GoalSettings, goal: Goal, percept: Percept) -> Array:
    """Whether |delta_d| < D_delta and |delta_v| < V_delta; bool []."""
    lateral, speed = goals.errors(goal, percept)
    return (jnp.abs(lateral) < settings.lateral_tolerance) & (
        jnp.abs(speed) < settings.speed_tolerance
    )


def update_goal_status(
    settings: GoalSettings,
    driving: DrivingSettings,
    renewal: str,
    memory: GoalMemory,
    percept: Percept,
) -> GoalMemory:
    """Look at the goal after a decision: it ends when reached, or at the time limit.

    By the renewal ``critic`` it is replaced only then, by ``timestep`` also every second, by
    ``decision`` always. A goal that is due already stays due.
    """
    limit = driving.decisions_in(settings.time_limit)
    under_way = ~memory.due
    done = under_way & reached(settings, memory.goal, percept)
    given_up = under_way & ~done & (memory.age >= limit)
    due = memory.due | done | (memory.age >= lifetime(settings, driving, renewal))
    ended, timed_out = memory.ended + (done | given_up), memory.timed_out + given_up
    return replace(memory, due=due, ended=ended, timed_out=timed_out)


def lifetime(settings: GoalSettings, driving: DrivingSettings, renewal: str) -> int:
    """Decisions after which a goal is replaced unreached; see `update_goal_status`."""
    limit = driving.decisions_in(settings.time_limit)
    return {"critic": limit, "timestep": driving.decisions_per_timestep, "decision": 1}[renewal]


def maybe_renew_goal(
    settings: GoalSettings, memory: GoalMemory, percept: Percept, action: Array
) -> GoalMemory:
    """Set a new goal by a high-level action where one is due; otherwise keep the goal."""
    reference = memory.goal
    if settings.reference == "current-state":
        reference = goals.goal_from_state(settings, percept)
    new = goals.apply_high_level_action(settings, reference, percept, action)
    return replace(
        memory,
        goal=jax.tree.map(lambda n, o: jnp.where(memory.due, n, o), new, memory.goal),
        age=jnp.where(memory.due, 0, memory.age),
        due=jnp.bool_(False),
    )
