"""Checks settings against one another; each by itself is checked by its range. Imports no JAX."""

from dataclasses import replace
from itertools import pairwise

from lanewise.errors import SettingsError
from lanewise.learning.settings import LearnerSettings
from lanewise.ranges import Between, Kind, show
from lanewise.scenario.settings import TrafficSettings, TrapSettings
from lanewise.settings import STAGES, Settings
from lanewise.training.settings import BudgetSettings, LevelSettings
from lanewise.world.settings import CAR_LENGTH, FARTHEST, TOP_SPEED

MOST_LAYERS = 16
"""Hidden layers of a network; compiling one takes time with each."""
_TRAINING_RANGES = (
    "training_ego_speed",
    "training_trap_speed",
    "training_lanes",
    "training_front_distance",
    "training_side_distance",
)

TRAINED = {
    "hierarchical": ("high_level", "low_level"),
    "planned": ("high_level",),
    "single-level": ("single_level",),
    "h-dqn": ("h_dqn",),
}
"""Sections of the stages that each controller is trained in."""
_TOO_COARSE = "farther on, 32-bit places are coarser than 1 cm"
_PAY = ("external_weight", "tracking_weight", "approach_weight", "goal_reward")
FEATURES = 26
"""Numbers that the paper's controllers observe."""
_GIB = 1 << 30


def check(settings: Settings) -> None:
    """Checks what no range can.

    Raises:
        SettingsError: Names two settings that contradict one another.
    """
    _check_scenario(settings)
    _check_driving(settings)
    _check_reach(settings)
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


def check_memory(
    settings: Settings, controller: str, available: int | None, observed: int = FEATURES
) -> None:
    """Refuses a training that no checkpoint of could be held in memory.

    A lower bound: networks, their targets, both moments of Adam, the weights kept so far, and the
    replays; all of them are gathered in the machine's own memory for every checkpoint.

    Args:
        settings: of the training.
        controller: what is trained.
        available: bytes; None where they are not known, and nothing is refused.
        observed: numbers in an observation.

    Raises:
        SettingsError: names the learner that needs the most, what it needs and what there is.
    """
    for stage in TRAINED[controller]:
        needs = {
            name: _least_bytes(learner, observed) for name, learner in _learners(settings, stage)
        }
        if available is not None and sum(needs.values()) > available:
            largest = max(needs, key=lambda name: needs[name])
            raise SettingsError(
                f"{largest}.hidden and replay_capacity need at least "
                f"{sum(needs.values()) / _GIB:.1f} GiB of memory, the machine has "
                f"{available / _GIB:.1f} GiB; {observed:,} numbers are observed"
            )


def _learners(settings: Settings, stage: str) -> list[tuple[str, LearnerSettings]]:
    """The learners of a stage by their section."""
    if stage != "h_dqn":
        return [(f"{stage}.learner", getattr(settings, stage).learner)]
    levels = ("high_level", "low_level")
    return [(f"h_dqn.{name}.learner", getattr(settings.h_dqn, name).learner) for name in levels]


def _least_bytes(learner: LearnerSettings, observed: int) -> int:
    weights = sum(above * below for below, above in pairwise((observed, *learner.hidden)))
    rows = learner.replay_capacity * 2 * observed
    return 4 * (5 * weights + rows)


def _check_reach(settings: Settings) -> None:
    """No drive leads beyond the end of the road."""
    reach = _extent(settings.scenario)
    if reach > FARTHEST:
        raise SettingsError(
            f"scenario.traffic: the farthest vehicle could stand {reach:,.0f} m from the ego, "
            f"beyond the end of the road ({FARTHEST:,.0f} m): {_TOO_COARSE}"
        )
    check_duration("evaluation.duration", settings.evaluation.duration, settings.scenario)
    for stage in (*STAGES, "h_dqn"):
        seconds = getattr(settings, stage).duration * settings.driving.decision_duration
        check_duration(f"{stage}.duration", seconds, settings.scenario)


def check_duration(name: str, seconds: float, trap: TrapSettings) -> None:
    """Checks that no vehicle can get beyond the end of the road within an episode.

    Args:
        name: of the setting, for the message.
        seconds: simulated length of the episode.
        trap: where everybody may start.

    Raises:
        SettingsError: says how far, and how long an episode may last.
    """
    start, fastest = _extent(trap), max(TOP_SPEED, trap.traffic.speed)
    reach = start + fastest * seconds
    if reach > FARTHEST:
        raise SettingsError(
            f"{name}: in {seconds:g} s a vehicle could get {reach:,.0f} m from the start, beyond "
            f"the end of the road ({FARTHEST:,.0f} m): {_TOO_COARSE}; "
            f"at most {int((FARTHEST - start) / fastest)} s"
        )


def _extent(trap: TrapSettings) -> float:
    """How far from the ego, either way, anybody may stand at the start, m."""
    traffic = trap.traffic

    def row(gap: float, count: int) -> float:
        return gap + (count - 1) * traffic.spacing + count * traffic.spacing_jitter if count else 0

    fronts = (trap.test_front_distance, *trap.training_front_distance)
    sides = (trap.test_side_distance, *trap.training_side_distance)
    ahead = max(*fronts, *sides) + row(traffic.first_gap, traffic.vehicles_ahead)
    return max(ahead, row(traffic.gap_behind, traffic.vehicles_behind), -min(sides))


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
    _check_traffic(traffic)
    if traffic.vehicles_behind:
        _check_not_behind(trap)


def _check_traffic(traffic: TrafficSettings) -> None:
    """Every gap varies by the jitter, the first ones too."""
    gaps = {
        "spacing": traffic.vehicles_ahead + traffic.vehicles_behind > 1,
        "first_gap": traffic.vehicles_ahead > 0,
        "gap_behind": traffic.vehicles_behind > 0,
    }
    for name, used in gaps.items():
        if used:
            least = getattr(traffic, name) - traffic.spacing_jitter
            _apart(f"scenario.traffic.{name} minus scenario.traffic.spacing_jitter", least)


def _check_not_behind(trap: TrapSettings) -> None:
    """Traffic behind the ego is in any lane, also in that of the trap car beside it."""
    traffic = trap.traffic
    limit = CAR_LENGTH - (traffic.gap_behind - traffic.spacing_jitter)
    sides = {
        "test_side_distance": trap.test_side_distance,
        "training_side_distance": trap.training_side_distance[0],
    }
    for name, side in sides.items():
        if side <= limit:
            raise SettingsError(
                f"scenario.{name} must be more than {show(limit)} m, or the trap car stands among "
                "the traffic behind: scenario.traffic.gap_behind less "
                f"scenario.traffic.spacing_jitter and a car length; got {show(side)}"
            )


def _apart(name: str, distance: float) -> None:
    # Distances are centre to centre.
    if distance <= CAR_LENGTH:
        raise SettingsError(
            f"{name} must be more than a car length ({show(CAR_LENGTH)} m), "
            f"got {show(round(distance, 9))}"
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
    _less(
        ("goals.lateral_tolerance", goals.lateral_tolerance),
        ("scenario.lane_width", settings.scenario.lane_width),
        "or goals in the next lane are reached in this one",
    )
    _less(
        ("goals.speed_tolerance", goals.speed_tolerance),
        ("goals.speed_step", goals.speed_step),
        "or a new speed is reached before it is driven",
    )
    reward = driving.reward
    if not (reward.speed_weight or reward.steering_weight or reward.centring_weight):
        names = ", ".join(f"driving.reward.{name}_weight" for name in ("speed", "steering"))
        raise SettingsError(
            f"{names} and driving.reward.centring_weight are all 0: there is nothing to reward"
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
    stopped = ("driving.stopped_speed", driving.stopped_speed)
    _less(stopped, ("goals.lowest_speed", goals.lowest_speed), "or goals ask for an accident")


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
    _check_schedules(name, level)
    decisions = (f"{name.split('.')[0]}.decisions", budget.decisions)
    if budget.decisions:
        warm_up = (f"{learner}.warm_up", level.learner.warm_up)
        _less(warm_up, decisions, "or training ends before the first update")
    # Without goals there is nothing else to pay.
    pay = _PAY[:1] if name == "single_level" else _PAY
    if not any(getattr(level, weight) for weight in pay):
        others = f", {', '.join(pay[1:])} are all 0" if pay[1:] else " is 0"
        raise SettingsError(f"{name}.{pay[0]}{others}: nothing would ever be paid")


def _check_schedules(name: str, level: LevelSettings) -> None:
    """What falls does not end higher than it begins."""
    explores, learner = level.exploration, level.learner
    start = (f"{name}.exploration.start", explores.start)
    _at_most((f"{name}.exploration.end", explores.end), start)
    if learner.learning_rate_decay:
        final = (f"{name}.learner.final_learning_rate", learner.final_learning_rate)
        _at_most(final, (f"{name}.learner.learning_rate", learner.learning_rate))


def _at_most(lower: tuple[str, float], upper: tuple[str, float]) -> None:
    if lower[1] > upper[1]:
        raise SettingsError(
            f"{lower[0]} must be at most {upper[0]} ({show(upper[1])}), got {show(lower[1])}"
        )


def _less(lower: tuple[str, float], upper: tuple[str, float], why: str) -> None:
    if lower[1] >= upper[1]:
        raise SettingsError(
            f"{lower[0]} must be less than {upper[0]} ({show(upper[1])}), {why}; "
            f"got {show(lower[1])}"
        )
