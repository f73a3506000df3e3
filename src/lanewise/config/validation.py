"""Checks settings against one another; their ranges check each by itself. Imports no JAX."""

from dataclasses import fields, replace
from itertools import pairwise
from operator import attrgetter

from lanewise.config.settings import Settings
from lanewise.controllers.registry import CONTROLLERS, STAGES
from lanewise.errors import SettingsError
from lanewise.fields.ranges import show
from lanewise.learning.settings import LearnerSettings
from lanewise.scenario.settings import TrapSettings
from lanewise.training.settings import LevelSettings
from lanewise.world.settings import CAR_LENGTH, FARTHEST, TOP_SPEED

MOST_LAYERS = 16
"""Hidden layers of a network; compiling one takes time with each."""
_TRAINING_RANGES = tuple(
    name
    for name in (field.name for field in fields(TrapSettings))
    if name.startswith("training_") and name not in ("training_populations", "training_braking")
)
_TOO_COARSE = "farther on, 32-bit places are coarser than 1 cm"
_REWARDS = ("external_weight", "tracking_weight", "approach_weight", "goal_reward")
_GIB = 1 << 30


def check(settings: Settings) -> None:
    """Refuses settings that contradict one another, by name."""
    _check_scenario(settings.scenario)
    _check_driving(settings)
    _check_reach(settings)
    for stage in STAGES:
        budget = attrgetter(stage.section)(settings)
        if budget.episodes == 0 and budget.decisions == 0:
            raise SettingsError(
                f"{stage.section}.episodes and {stage.section}.decisions are both 0: training "
                "would never end"
            )
        for section in stage.level_sections:
            _check_level(settings, stage.section, section)


def check_high_level(lender: Settings, borrower: Settings) -> None:
    """Refuses to take over a high level that was trained under settings it would not fit.

    The settings of goal renewal in step 2 and in tests do not affect a high level.
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
    settings: Settings, controller: str, available: int | None, observed: int | None = None
) -> None:
    """Refuses a training whose checkpoints do not fit into memory.

    The estimate is a lower bound: networks, their targets, both moments of Adam, the weights kept
    so far, and the replays; all of them are gathered in host memory for every checkpoint. Nothing
    is refused where it is unknown how many bytes are ``available``. ``observed`` is how many
    numbers a user's own function observes.
    """
    observed = settings.driving.observation.size if observed is None else observed
    for stage in CONTROLLERS[controller].stages:
        needs = {
            f"{section}.learner": _least_bytes(attrgetter(section)(settings).learner, observed)
            for section in stage.level_sections
        }
        if available is not None and sum(needs.values()) > available:
            largest = max(needs, key=lambda name: needs[name])
            raise SettingsError(
                f"{largest}.hidden and replay_capacity need at least "
                f"{sum(needs.values()) / _GIB:.1f} GiB of memory, the machine has "
                f"{available / _GIB:.1f} GiB; {observed:,} numbers are observed"
            )


def _least_bytes(learner: LearnerSettings, observed: int) -> int:
    weights = sum(above * below for below, above in pairwise((observed, *learner.hidden)))
    rows = learner.replay_capacity * 2 * observed
    return 4 * (5 * weights + rows)


def _check_reach(settings: Settings) -> None:
    reach = _extent(settings.scenario)
    if reach > FARTHEST:
        raise SettingsError(
            f"scenario.traffic: the farthest vehicle could stand {reach:,.0f} m from the ego, "
            f"beyond the end of the road ({FARTHEST:,.0f} m): {_TOO_COARSE}"
        )
    check_duration("evaluation.duration", settings.evaluation.duration, settings.scenario)
    for stage in STAGES:
        duration = attrgetter(stage.section)(settings).duration
        seconds = duration * settings.driving.decision_duration
        check_duration(f"{stage.section}.duration", seconds, settings.scenario)


def check_duration(name: str, seconds: float, trap: TrapSettings) -> None:
    """Refuses an episode, by the name of its setting, that could lead beyond the end of the road.

    ``trap`` says where everybody may start.
    """
    start = _extent(trap)
    fastest = max(TOP_SPEED, trap.traffic.speed, *trap.training_traffic_speed)
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
    spacing = max((traffic.spacing, *trap.training_spacing))
    gap_behind = max((traffic.gap_behind, *trap.training_gap_behind))

    def row(gap: float, *counts: int) -> float:
        most = max(counts)
        return gap + (most - 1) * spacing + most * traffic.spacing_jitter if most else 0

    fronts = (trap.test_front_distance, *trap.training_front_distance)
    sides = (trap.test_side_distance, *trap.training_side_distance)
    ahead = row(traffic.first_gap, traffic.vehicles_ahead, *trap.training_vehicles_ahead)
    behind = row(gap_behind, traffic.vehicles_behind, *trap.training_vehicles_behind)
    return max(max(*fronts, *sides) + ahead, behind, -min(sides))


def _check_scenario(trap: TrapSettings) -> None:
    for name in _TRAINING_RANGES:
        between = getattr(trap, name)
        if between and between[0] > between[1]:
            raise SettingsError(
                f"scenario.{name}: {show(between[0])} must not exceed {show(between[1])}"
            )
    _apart("scenario.training_front_distance", trap.training_front_distance[0])
    _apart("scenario.test_front_distance", trap.test_front_distance)
    wave, lowest = trap.trap_speed_wave, trap.trap_speed
    for prefix in ("", "training_"):
        _check_traffic(trap, prefix)
        if prefix:
            wave = max(trap.training_trap_speed_wave, default=wave)
            lowest = min(trap.training_trap_speed, default=lowest)
        if wave >= lowest:
            raise SettingsError(
                f"scenario.{prefix}trap_speed_wave must be less than the lowest speed of the trap "
                f"({show(lowest)} m/s), or trap cars drive backwards; got {show(wave)}"
            )


def _check_traffic(trap: TrapSettings, prefix: str) -> None:
    """Refuses vehicles that overlap in a test, or by their ranges in training, by their names.

    Every gap varies by the jitter, the first ones too.
    """
    traffic = trap.traffic

    def of(name: str) -> tuple[str, tuple[float, ...]]:
        """(the setting that counts, its values)."""
        between = getattr(trap, f"{prefix}{name}") if prefix and name != "first_gap" else ()
        if between:
            return f"scenario.{prefix}{name}", between
        return f"scenario.traffic.{name}", (getattr(traffic, name),)

    ahead, behind = (max(of(name)[1]) for name in ("vehicles_ahead", "vehicles_behind"))
    used = {"spacing": ahead + behind > 1, "first_gap": ahead > 0, "gap_behind": behind > 0}
    for name in (name for name in used if used[name]):
        setting, values = of(name)
        least = min(values) - traffic.spacing_jitter
        _apart(f"{setting} minus scenario.traffic.spacing_jitter", least)
    if not behind:
        return
    # Traffic behind the ego is in any lane, also in that of the trap car beside it.
    setting, values = of("gap_behind")
    limit = CAR_LENGTH - (min(values) - traffic.spacing_jitter)
    side = trap.training_side_distance[0] if prefix else trap.test_side_distance
    if side <= limit:
        raise SettingsError(
            f"scenario.{prefix or 'test_'}side_distance must be more than {show(limit)} m, or the "
            f"trap car stands among the traffic behind: {setting} less "
            f"scenario.traffic.spacing_jitter and a car length; got {show(side)}"
        )


def _apart(name: str, distance: float) -> None:
    """Refuses vehicles that overlap; distances are centre to centre."""
    if distance <= CAR_LENGTH:
        raise SettingsError(
            f"{name} must be more than a car length ({show(CAR_LENGTH)} m), "
            f"got {show(round(distance, 9))}"
        )


def _check_driving(settings: Settings) -> None:
    _below(settings, "driving.decision_frequency", "driving.simulation_frequency")
    driving = settings.driving
    for name in ("latency", "training_latency"):
        longest = driving.latency_ticks(name != "latency")[1]
        if longest >= driving.ticks_per_decision:
            raise SettingsError(
                f"driving.{name} in whole ticks must be less than a decision "
                f"({show(driving.decision_duration)} s), got {show(getattr(driving, name))}"
            )
    noise = driving.observation.training_noise
    ranges = {"training_latency": driving.training_latency, "observation.training_noise": noise}
    for name, between in ranges.items():
        if between and between[0] > between[1]:
            raise SettingsError(
                f"driving.{name}: {show(between[0])} must not exceed {show(between[1])}"
            )
    _below(settings, "goals.lowest_speed", "goals.highest_speed")
    why = "or goals in the next lane are reached in this one"
    _below(settings, "goals.lateral_tolerance", "scenario.lane_width", why)
    why = "or a new speed is reached before it is driven"
    _below(settings, "goals.speed_tolerance", "goals.speed_step", why)
    why = "or goals ask for an accident"
    _below(settings, "driving.stopped_speed", "goals.lowest_speed", why)
    reward = settings.driving.reward
    if not (reward.speed_weight or reward.steering_weight or reward.centring_weight):
        raise SettingsError(
            "driving.reward.speed_weight, driving.reward.steering_weight and "
            "driving.reward.centring_weight are all 0: there is nothing to reward"
        )
    stopped = settings.driving.stopped_speed
    slowest = {"ego_speed": settings.scenario.ego_speed}
    if settings.scenario.training_ego_speed:
        slowest["training_ego_speed"] = settings.scenario.training_ego_speed[0]
    for name, speed in slowest.items():
        if speed <= stopped:
            raise SettingsError(
                f"scenario.{name} must be more than driving.stopped_speed ({show(stopped)}), "
                f"got {show(speed)}"
            )


def _check_level(settings: Settings, stage: str, section: str) -> None:
    level: LevelSettings = attrgetter(section)(settings)
    learner = f"{section}.learner"
    for name in (f"{learner}.batch_size", f"{learner}.warm_up", f"{stage}.worlds"):
        _below(settings, name, f"{learner}.replay_capacity")
    _below(settings, f"{section}.exploration.end", f"{section}.exploration.start")
    if level.learner.learning_rate_decay:
        _below(settings, f"{learner}.final_learning_rate", f"{learner}.learning_rate")
    if attrgetter(stage)(settings).decisions:
        why = "or training ends before the first update"
        _below(settings, f"{learner}.warm_up", f"{stage}.decisions", why)
    if len(level.learner.hidden) > MOST_LAYERS:
        raise SettingsError(
            f"{learner}.hidden: at most {MOST_LAYERS} layers, got {len(level.learner.hidden)}"
        )
    # Without goals there is only the external reward.
    rewards = _REWARDS[:1] if section == "single_level" else _REWARDS
    if not any(getattr(level, weight) for weight in rewards):
        are = "is 0" if len(rewards) == 1 else "are all 0"
        raise SettingsError(f"{section}.{', '.join(rewards)} {are}: there would never be a reward")


def _below(settings: Settings, lower: str, upper: str, why: str = "") -> None:
    """Refuses a setting that exceeds another or, where there is a reason, equals it."""
    low, high = attrgetter(lower, upper)(settings)
    if low > high or (why and low == high):
        most, why = ("less than", f"{why}; ") if why else ("at most", "")
        raise SettingsError(f"{lower} must be {most} {upper} ({show(high)}), {why}got {show(low)}")
