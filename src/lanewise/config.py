"""Composes the settings of all parts: presets, TOML files, cross-checks. Imports no JAX."""

import dataclasses
import hashlib
import json
import tomllib
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import Any, get_type_hints

from lanewise.controllers.settings import GoalSettings, PlannerSettings
from lanewise.driving.settings import DrivingSettings
from lanewise.errors import SettingsError
from lanewise.evaluation.settings import EvaluationSettings
from lanewise.learning.settings import LearnerSettings
from lanewise.names import look_up, nearest
from lanewise.ranges import Between, Kind, show
from lanewise.scenario.settings import TrapSettings
from lanewise.training.settings import StageSettings

CAR_LENGTH = 5.0
"""Length of every car, m; nobody may start closer than this, centre to centre."""

_LARGEST_FILE = 1_000_000

_CAME_LATER: dict[str, object] = {
    "scenario.training_ego_speed": [],
    "scenario.training_trap_speed": [],
    "scenario.training_lanes": [],
}
"""Settings that the first run folders do not know, and the value under which nothing changes.

With that value they are left out of the digest, so that older runs are still read."""


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
    evaluation: EvaluationSettings = field(default_factory=EvaluationSettings)
    """How controllers are tested, and how weights are chosen."""
    single_level: StageSettings = field(
        default_factory=lambda: StageSettings(
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


STAGES = ("single_level", "high_level", "low_level")

_PAPER_STAGE: dict[str, object] = {
    "decisions": 0,
    "duration": 250,
    "exploration.start": 0.5,
    "exploration.end": 0.02,
    "exploration.steps": 1000,
    "learner.learning_rate_decay": 0,
}

PRESETS: dict[str, dict[str, object]] = {
    "quick": {},
    "paper": {f"{stage}.{name}": value for stage in STAGES for name, value in _PAPER_STAGE.items()}
    | {
        "single_level.episodes": 2000,
        "single_level.keep": "last",
        "high_level.episodes": 1000,
        "high_level.keep": "best-training",
        "low_level.episodes": 2000,
        "low_level.keep": "last",
    },
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
        _check_stage(stage, getattr(settings, stage))


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


def _check_stage(stage: str, settings: StageSettings) -> None:
    if settings.episodes == 0 and settings.decisions == 0:
        raise SettingsError(
            f"{stage}.episodes and {stage}.decisions are both 0: training would never end"
        )
    learner = f"{stage}.learner"
    capacity = (f"{learner}.replay_capacity", settings.learner.replay_capacity)
    _at_most((f"{learner}.batch_size", settings.learner.batch_size), capacity)
    _at_most((f"{learner}.warm_up", settings.learner.warm_up), capacity)
    _at_most((f"{stage}.worlds", settings.worlds), capacity)
    for width in settings.learner.hidden:
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
    """SHA-256 over the settings, the name under which stored files belong to them.

    A setting that came later is left out while it changes nothing.
    """
    table = to_dict(settings)
    for name, unchanged in _CAME_LATER.items():
        *sections, leaf = name.split(".")
        section = table
        for below in sections:
            section = section[below]
        if section[leaf] == unchanged:
            del section[leaf]
    canonical = json.dumps(table, sort_keys=True, separators=(",", ":"))
    return hashlib.sha256(canonical.encode()).hexdigest()


def first_difference(ours: Settings, theirs: Settings) -> str:
    """Says which setting differs first and both its values, or nothing where none does."""
    other = flatten(theirs)
    for name, value in flatten(ours).items():
        if value != other[name]:
            return f"{name} is {show(value)}, not {show(other[name])}"
    return ""
