"""Checks settings against one another; each by itself is checked by its range. Imports no JAX."""

from dataclasses import replace

from lanewise.errors import SettingsError
from lanewise.ranges import Between, Kind, show
from lanewise.settings import STAGES, Settings
from lanewise.training.settings import BudgetSettings, LevelSettings
from lanewise.world.settings import CAR_LENGTH

MOST_LAYERS = 16
"""Hidden layers of a network; compiling one takes time with each."""
_TRAINING_RANGES = (
    "training_ego_speed",
    "training_trap_speed",
    "training_lanes",
    "training_front_distance",
    "training_side_distance",
)


def check(settings: Settings) -> None:
    """Checks what no range can.

    Raises:
        SettingsError: Names two settings that contradict one another.
    """
    _check_scenario(settings)
    _check_driving(settings)
    for stage in STAGES:
        part = getattr(settings, stage)
        _check_budget(stage, part)
        _check_level(stage, part, part)
    _check_budget("h_dqn", settings.h_dqn)
    for level in ("high_level", "low_level"):
        _check_level(f"h_dqn.{level}", settings.h_dqn, getattr(settings.h_dqn, level))


def check_high_level(lender: Settings, borrower: Settings) -> None:
    """Checks that a high level trained under some settings can be taken over under others.

    When step 2 and tests renew goals is nothing to a high level.

    Raises:
        SettingsError: Says what differs.
    """
    theirs, ours = (
        (replace(each.goals, training_renewal="critic", test_renewal="critic"), each.driving)
        for each in (lender, borrower)
    )
    if theirs != ours:
        raise SettingsError(
            "was made with other goals or driving settings: its high level would not fit; give "
            "the same ones"
        )
    if lender.high_level.learner.hidden != borrower.high_level.learner.hidden:
        raise SettingsError("has another high-level network (high_level.learner.hidden)")


def _check_scenario(settings: Settings) -> None:
    trap, traffic = settings.scenario, settings.scenario.traffic
    for name in _TRAINING_RANGES:
        between = getattr(trap, name)
        if between and between[0] > between[1]:
            raise SettingsError(
                f"scenario.{name}: {show(between[0])} must not exceed {show(between[1])}"
            )
    _apart("scenario.training_front_distance", trap.training_front_distance[0])
    _apart("scenario.test_front_distance", trap.test_front_distance)
    nearest_gap = traffic.spacing - traffic.spacing_jitter
    if traffic.vehicles_ahead + traffic.vehicles_behind > 1:
        _apart("scenario.traffic.spacing minus scenario.traffic.spacing_jitter", nearest_gap)
    if traffic.vehicles_ahead:
        _apart("scenario.traffic.first_gap", traffic.first_gap)
    if traffic.vehicles_behind:
        _apart("scenario.traffic.gap_behind", traffic.gap_behind)


def _apart(name: str, distance: float) -> None:
    # Distances are centre to centre.
    if distance <= CAR_LENGTH:
        raise SettingsError(
            f"{name} must be more than a car length ({show(CAR_LENGTH)} m), got {show(distance)}"
        )


def _check_driving(settings: Settings) -> None:
    driving, goals = settings.driving, settings.goals
    _at_most(
        ("driving.decision_frequency", driving.decision_frequency),
        ("driving.simulation_frequency", driving.simulation_frequency),
    )
    _at_most(
        ("goals.lowest_speed", goals.lowest_speed), ("goals.highest_speed", goals.highest_speed)
    )
    slowest = {"ego_speed": settings.scenario.ego_speed}
    if settings.scenario.training_ego_speed:
        slowest["training_ego_speed"] = settings.scenario.training_ego_speed[0]
    for name, speed in slowest.items():
        if speed <= driving.stopped_speed:
            raise SettingsError(
                f"scenario.{name} must be more than driving.stopped_speed "
                f"({show(driving.stopped_speed)}), got {show(speed)}"
            )


def _check_budget(stage: str, budget: BudgetSettings) -> None:
    if budget.episodes == 0 and budget.decisions == 0:
        raise SettingsError(
            f"{stage}.episodes and {stage}.decisions are both 0: training would never end"
        )


def _check_level(name: str, budget: BudgetSettings, level: LevelSettings) -> None:
    learner = f"{name}.learner"
    capacity = (f"{learner}.replay_capacity", level.learner.replay_capacity)
    _at_most((f"{learner}.batch_size", level.learner.batch_size), capacity)
    _at_most((f"{learner}.warm_up", level.learner.warm_up), capacity)
    _at_most((f"{name.split('.')[0]}.worlds", budget.worlds), capacity)
    if len(level.learner.hidden) > MOST_LAYERS:
        raise SettingsError(
            f"{learner}.hidden: at most {MOST_LAYERS} layers, got {len(level.learner.hidden)}"
        )
    for width in level.learner.hidden:
        Kind(int, None, Between(1, 65_536)).check(f"{learner}.hidden", width)


def _at_most(lower: tuple[str, float], upper: tuple[str, float]) -> None:
    if lower[1] > upper[1]:
        raise SettingsError(
            f"{lower[0]} must be at most {upper[0]} ({show(upper[1])}), got {show(lower[1])}"
        )
