"""Composes the settings of all parts: presets, TOML files, cross-checks. Imports no JAX."""

import dataclasses
import hashlib
import json
import tomllib
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import Any, get_type_hints

from lanewise.controllers.settings import GoalSettings, PlannerSettings, SearchSettings
from lanewise.driving.settings import DrivingSettings
from lanewise.errors import SettingsError
from lanewise.evaluation.settings import EvaluationSettings
from lanewise.learning.settings import LearnerSettings
from lanewise.names import look_up, nearest
from lanewise.ranges import Between, Kind, show
from lanewise.scenario.settings import TrapSettings
from lanewise.training.settings import (
    BudgetSettings,
    HDQNSettings,
    LevelSettings,
    SingleLevelSettings,
    StageSettings,
)
from lanewise.world.settings import CAR_LENGTH

_LARGEST_FILE = 1_000_000


@dataclass(frozen=True)
class Settings:
    """Every setting of a run."""

    scenario: TrapSettings = field(default_factory=TrapSettings)
    """Who stands where at the start, and who drives how."""
    driving: DrivingSettings = field(default_factory=DrivingSettings)
    """The decision process around the ego."""
    goals: GoalSettings = field(default_factory=GoalSettings)
    """What the high level may ask for."""
    planner: PlannerSettings = field(default_factory=PlannerSettings)
    """The rule-based planner of step 1."""
    search: SearchSettings = field(default_factory=SearchSettings)
    """The search over the nine actions, a reference."""
    evaluation: EvaluationSettings = field(default_factory=EvaluationSettings)
    """How controllers are tested, and how weights are chosen."""
    single_level: SingleLevelSettings = field(
        default_factory=lambda: SingleLevelSettings(
            decisions=360_000, learner=LearnerSettings(learning_rate_decay=45_000)
        )
    )
    """Training of the single-level controller, with the budget of both steps together."""
    high_level: StageSettings = field(
        default_factory=lambda: StageSettings(learner=LearnerSettings(learning_rate_decay=15_000))
    )
    """Step 1: training of the high level above the planner."""
    low_level: StageSettings = field(
        default_factory=lambda: StageSettings(
            decisions=240_000,
            duration=60,
            tracking_weight=1.0,
            learner=LearnerSettings(learning_rate_decay=30_000),
        )
    )
    """Step 2: training of the low level below the frozen high level."""
    h_dqn: HDQNSettings = field(
        default_factory=lambda: HDQNSettings(
            decisions=360_000,
            high_level=LevelSettings(learner=LearnerSettings(learning_rate_decay=45_000)),
            low_level=LevelSettings(
                external_weight=0.0,
                goal_reward=1.0,
                goal_end="terminal",
                learner=LearnerSettings(learning_rate_decay=45_000),
            ),
        )
    )
    """h-DQN: both levels together, with the budget of both steps."""


STAGES = ("single_level", "high_level", "low_level")

_PAPER_BUDGET: dict[str, object] = {"decisions": 0, "duration": 250}
_PAPER_LEVEL: dict[str, object] = {
    "exploration.start": 0.5,
    "exploration.end": 0.02,
    "exploration.steps": 1000,
    "learner.learning_rate_decay": 0,
}


def _under(names: tuple[str, ...], values: Mapping[str, object]) -> dict[str, object]:
    return {f"{name}.{leaf}": value for name in names for leaf, value in values.items()}


PRESETS: dict[str, dict[str, object]] = {
    "quick": {},
    "paper": _under((*STAGES, "h_dqn"), _PAPER_BUDGET)
    | _under((*STAGES, "h_dqn.high_level", "h_dqn.low_level"), _PAPER_LEVEL)
    | _under(("single_level", "low_level", "h_dqn"), {"episodes": 2000, "keep": "last"})
    | _under(("high_level",), {"episodes": 1000, "keep": "best-training"}),
}
"""Training presets: what each changes in the defaults."""

TRAPS: dict[str, dict[str, object]] = {
    "trap-10": {},
    "trap-10.9": {"scenario.trap_speed": 10.9},
}
"""Scenario presets: what each changes in the defaults."""


def compose(
    preset: str = "quick",
    trap: str = "trap-10",
    file: Path | None = None,
    flags: Mapping[str, object] | None = None,
) -> Settings:
    """Composes settings: defaults < training preset < scenario preset < file < flags.

    Args:
        preset: A name in ``PRESETS``.
        trap: A name in ``TRAPS``.
        file: A TOML file with any of the settings.
        flags: Values by dotted name.

    Raises:
        SettingsError: A name is unknown, or a value has the wrong type, is out of range or
            contradicts another.
    """
    values = dict(look_up("preset", preset, PRESETS))
    values |= look_up("trap", trap, TRAPS)
    if file is not None:
        values |= load_toml(file)
    if flags is not None:
        values |= flags
    return replace(Settings(), values)


@cache
def kinds(owner: type = Settings) -> dict[str, Kind]:
    """Every setting below a dataclass by its dotted name, in the order of the fields."""
    found: dict[str, Kind] = {}
    for name, annotation in get_type_hints(owner, include_extras=True).items():
        if dataclasses.is_dataclass(annotation):
            below = kinds(annotation)  # type: ignore[arg-type]
            found |= {f"{name}.{rest}": kind for rest, kind in below.items()}
        else:
            found[name] = Kind.of(annotation)
    return found


def flatten(settings: Any) -> dict[str, Any]:
    """Every value by its dotted name, in the order of the fields."""
    flat: dict[str, Any] = {}
    for item in dataclasses.fields(settings):
        value = getattr(settings, item.name)
        if dataclasses.is_dataclass(value):
            flat |= {f"{item.name}.{rest}": below for rest, below in flatten(value).items()}
        else:
            flat[item.name] = value
    return flat


def replace(settings: Settings, values: Mapping[str, object]) -> Settings:
    """Returns ``settings`` with some values, given by dotted name, replaced and all checked.

    Raises:
        SettingsError: As in ``compose``.
    """
    known = kinds()
    for name in values:
        if name not in known:
            raise SettingsError(unknown_setting(name))
    everything = flatten(settings) | dict(values)
    checked = {name: known[name].check(name, value) for name, value in everything.items()}
    changed: Settings = _rebuild(settings, checked)
    validate(changed)
    return changed


def _rebuild(owner: Any, values: Mapping[str, object]) -> Any:
    parts: dict[str, object] = {}
    for item in dataclasses.fields(owner):
        old = getattr(owner, item.name)
        if dataclasses.is_dataclass(old):
            prefix = f"{item.name}."
            below = {k.removeprefix(prefix): v for k, v in values.items() if k.startswith(prefix)}
            parts[item.name] = _rebuild(old, below)
        else:
            parts[item.name] = values.get(item.name, old)
    return dataclasses.replace(owner, **parts)


def validate(settings: Settings) -> None:
    """Checks every value against its type and range, then the values against one another.

    Raises:
        SettingsError: Names the first setting that is wrong, its value, and what it may be.
    """
    known = kinds()
    for name, value in flatten(settings).items():
        known[name].check(name, value)
    _check_scenario(settings)
    _check_driving(settings)
    for stage in STAGES:
        part = getattr(settings, stage)
        _check_budget(stage, part)
        _check_level(stage, part, part)
    _check_budget("h_dqn", settings.h_dqn)
    for level in ("high_level", "low_level"):
        _check_level(f"h_dqn.{level}", settings.h_dqn, getattr(settings.h_dqn, level))


_TRAINING_RANGES = (
    "training_ego_speed",
    "training_trap_speed",
    "training_lanes",
    "training_front_distance",
    "training_side_distance",
)


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
    for width in level.learner.hidden:
        Kind(int, None, Between(1, 65_536)).check(f"{learner}.hidden", width)


def _at_most(lower: tuple[str, float], upper: tuple[str, float]) -> None:
    if lower[1] > upper[1]:
        raise SettingsError(
            f"{lower[0]} must be at most {upper[0]} ({show(upper[1])}), got {show(lower[1])}"
        )


def unknown_setting(name: str) -> str:
    """The message for a name that is no setting, with the nearest right one."""
    hint = nearest(name, kinds()) or "`lanewise train --help` lists all"
    return f'unknown setting "{name[:80]}"; {hint}'


def load_toml(path: Path) -> dict[str, object]:
    """Reads the settings of a TOML file by dotted name; dashes and underscores are equal.

    Raises:
        SettingsError: The file cannot be read or is no TOML, or a name in it is unknown.
    """
    try:
        if path.stat().st_size > _LARGEST_FILE:
            raise SettingsError(f"{path}: larger than a settings file can be")
        table = tomllib.loads(path.read_bytes().decode("utf-8"))
    except OSError as error:
        raise SettingsError(f"cannot read settings file {path}: {error.strerror}") from error
    except (tomllib.TOMLDecodeError, UnicodeDecodeError, RecursionError, ValueError) as error:
        reason = " ".join(str(error).split())[:120]
        raise SettingsError(f"{path} is not valid TOML: {reason}") from error
    try:
        return _by_name(table)
    except SettingsError as error:
        raise SettingsError(f"{path}: {error}") from error


def _by_name(table: Mapping[str, Any], prefix: str = "") -> dict[str, object]:
    """Flattens nested tables, refusing names that are neither a setting nor a section."""
    known = kinds()
    found: dict[str, object] = {}
    for key, value in table.items():
        name = prefix + key.replace("-", "_")
        is_section = any(option.startswith(f"{name}.") for option in known)
        if isinstance(value, Mapping) and is_section:
            below = _by_name(value, f"{name}.")
        elif name in known:
            below = {name: value}
        elif is_section:
            raise SettingsError(f"{name} is a section, not a setting; write [{name}]")
        elif isinstance(value, Mapping):
            sections = dict.fromkeys(option.rpartition(".")[0] for option in known)
            hint = nearest(name, sections) or "known: " + ", ".join(sections)
            raise SettingsError(f'unknown section "{name[:80]}"; {hint}')
        else:
            raise SettingsError(unknown_setting(name))
        if found.keys() & below.keys():
            raise SettingsError(f"{name} is given twice")
        found |= below
    return found


def dump_toml(settings: Settings) -> str:
    """Writes every setting as TOML, in the order of the fields; ``load_toml`` reads it back."""
    lines: list[str] = []
    section = ""
    for name, value in sorted(flatten(settings).items(), key=_section_order(settings)):
        owner, _, leaf = name.rpartition(".")
        if owner != section:
            lines += ["", f"[{owner}]"] if lines else [f"[{owner}]"]
            section = owner
        lines.append(f"{leaf} = {_toml(value)}")
    return "\n".join(lines) + "\n"


def _section_order(settings: Settings) -> Callable[[tuple[str, Any]], int]:
    """Keeps a table's own values together, before the tables below it, as TOML demands."""
    owners = list(dict.fromkeys(_owners(settings)))
    return lambda item: owners.index(item[0].rpartition(".")[0])


def _owners(part: Any, prefix: str = "") -> Iterator[str]:
    yield prefix
    for item in dataclasses.fields(part):
        value = getattr(part, item.name)
        if dataclasses.is_dataclass(value):
            yield from _owners(value, f"{prefix}.{item.name}" if prefix else item.name)


def _toml(value: object) -> str:
    if isinstance(value, tuple):
        return "[" + ", ".join(_toml(member) for member in value) + "]"
    # For finite numbers, truth values and text, JSON's spelling is TOML's.
    return json.dumps(value, allow_nan=False)


def to_dict(settings: Settings) -> dict[str, Any]:
    """Every setting as nested tables of plain values."""
    plain: dict[str, Any] = json.loads(json.dumps(dataclasses.asdict(settings), allow_nan=False))
    return plain


def from_dict(table: Mapping[str, Any]) -> Settings:
    """Builds settings from nested tables; what is not given keeps its default.

    Raises:
        SettingsError: As in ``compose``.
    """
    return replace(Settings(), _by_name(table))


def digest(settings: Settings) -> str:
    """SHA-256 over the settings file, by which stored files belong to them."""
    return hashlib.sha256(dump_toml(settings).encode()).hexdigest()


def first_difference(ours: Settings, theirs: Settings) -> str:
    """Says which setting differs first and both its values, or nothing where none does."""
    other = flatten(theirs)
    for name, value in flatten(ours).items():
        if value != other[name]:
            return f"{name} is {show(value)}, not {show(other[name])}"
    return ""


def differences(settings: Sequence[Settings]) -> dict[str, tuple[Any, ...]]:
    """The settings that are not the same in all, by dotted name: one value each, in order."""
    flat = [flatten(each) for each in settings]
    values = {name: tuple(each[name] for each in flat) for name in kinds()}
    return {name: found for name, found in values.items() if len(set(found)) > 1}
