"""Settings of goals, the goal critic and the planner. Imports no JAX."""

from dataclasses import dataclass
from typing import Annotated

from lanewise.fields.ranges import Between, OneOf

RENEWALS = ("critic", "timestep", "decision")


@dataclass(frozen=True)
class GoalSettings:
    """Which goals the high level may set, and when it may set a new one."""

    speed_step: Annotated[float, Between(0.05, 10.0, "m/s")] = 1.0
    """delta: how much one high-level action moves the target speed."""
    lowest_speed: Annotated[float, Between(0.0, 40.0, "m/s")] = 5.0
    """Lowest target speed of a goal."""
    highest_speed: Annotated[float, Between(0.0, 40.0, "m/s")] = 16.0
    """Highest target speed of a goal."""
    lateral_tolerance: Annotated[float, Between(0.01, 4.0, "m")] = 0.3
    """D_delta of the goal critic."""
    speed_tolerance: Annotated[float, Between(0.01, 10.0, "m/s")] = 0.3
    """V_delta of the goal critic."""
    time_limit: Annotated[float, Between(0.5, 1000.0, "s")] = 3.0
    """A goal not reached by then is given up (row 13)."""
    reference: Annotated[str, OneOf(("previous-goal", "current-state"))] = "previous-goal"
    """What a new goal moves: the previous goal, or the current lane and speed (row 22c)."""
    action_set: Annotated[str, OneOf(("joint-9", "single-5", "joint-6"))] = "joint-9"
    """High-level actions: 3x3 joint, one at a time, or 3 lateral x {slower, faster} (row 12)."""
    training_renewal: Annotated[str, OneOf(RENEWALS)] = "timestep"
    """When the goal is renewed in step 2 (row 22a); where a high level learns, the critic holds
    it."""
    test_renewal: Annotated[str, OneOf(RENEWALS)] = "timestep"
    """When the hierarchical controller's goal is renewed in tests (row 22b). The critic holds the
    goals of other controllers."""


@dataclass(frozen=True)
class SearchSettings:
    """The search over the nine actions, a reference that knows the future."""

    per_class: Annotated[int, Between(1, 1000)] = 3
    """Drives kept of each class of states: lane, side of its centre, speed, place beside the
    trap."""


@dataclass(frozen=True)
class PlannerSettings:
    """The rule-based planner: it previews the next decisions and takes the best first action."""

    preview: Annotated[int, Between(1, 6)] = 5
    """Decisions looked ahead; all steering sequences of this length are compared."""
