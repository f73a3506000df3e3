"""An experiment as data: arms, seeds and settings, read from one TOML file; and its folder.

::

    title = "…"                 shown in the report
    preset = "quick"            training preset that every arm starts from
    seeds = 5
    episodes = 300              test episodes a seed in our world
    highway_env_episodes = 100  the first of the same starts in highway-env; 0 for none

    [arms.hierarchical]
    title = "hierarchical"      in tables and figures
    controller = "hierarchical" what is trained, or a reference driver
    high_level = "planned"      optional: take over step 1 of this arm's run of the same seed
    seeds = 1                   optional, as are both numbers of episodes: instead of those above
    [arms.hierarchical.settings]
    "low_level.tracking_weight" = 0.5

Imports no JAX.
"""

import json
import os
from collections.abc import Mapping
from dataclasses import dataclass, replace
from importlib import resources
from pathlib import Path
from typing import Any

from lanewise import config
from lanewise.config import validation
from lanewise.config.settings import PRESETS, Settings
from lanewise.controllers.registry import CONTROLLERS, WITH_STEP_1
from lanewise.errors import RunError, SettingsError, brief
from lanewise.fields.ranges import EPISODES, Between, FieldType
from lanewise.fields.suggestions import look_up, nearest
from lanewise.runs.run_folder import require_empty
from lanewise.system import safe_io
from lanewise.system.folder_io import OpenFolder, write_atomically

BUILT_IN = ("quick", "standard", "paper")
"""Experiments that come with the package, each a file beside this one."""
FILE = "experiment.json"
"""Names the experiment in its folder, written before anything else."""
RUNS = "runs"
"""Holds a folder for each arm, and in it one for each seed."""
_FORMAT = "lanewise-experiment"
_LARGEST_FILE = 100_000
_COUNTS = {
    "seeds": FieldType(int, None, Between(1, 1000)),
    "episodes": FieldType(int, None, EPISODES),
    "highway_env_episodes": FieldType(int, None, Between(0, EPISODES.high)),
}


@dataclass(frozen=True)
class ExperimentArm:
    """One controller under one set of settings."""

    name: str
    """Of its folder, and for ``--only``."""
    title: str
    """In tables and figures."""
    controller: str
    """What is trained, or a reference driver."""
    changes: Mapping[str, object]
    """Settings that differ from the experiment's preset, by dotted name."""
    high_level: str
    """Arm whose step 1 is taken over; empty to train its own."""
    seeds: int
    episodes: int
    """Test episodes a seed in our world."""
    highway_env_episodes: int
    """The first of the same starts in highway-env; 0 for none."""

    @property
    def trained(self) -> bool:
        """Whether there is anything to train."""
        return bool(CONTROLLERS[self.controller].stages)


@dataclass(frozen=True)
class Experiment:
    """Arms and seeds."""

    name: str
    title: str
    preset: str
    arms: tuple[ExperimentArm, ...]

    def settings(self, arm: ExperimentArm, trap: str, overrides: Mapping[str, object]) -> Settings:
        """Every setting of an arm: preset < trap < the arm's own < ``overrides``."""
        try:
            changes = dict(arm.changes) | dict(overrides)
            return config.compose(preset=self.preset, trap=trap, flags=changes)
        except SettingsError as error:
            raise SettingsError(f"arm {arm.name}: {error}") from error

    def only(self, names: tuple[str, ...]) -> "Experiment":
        """The experiment with these arms alone, and those whose step 1 they take over."""
        known = {arm.name: arm for arm in self.arms}
        wanted = {look_up("arm", name, known).name for name in names}
        wanted |= {known[name].high_level for name in wanted} - {""}
        return replace(self, arms=tuple(arm for arm in self.arms if arm.name in wanted))


def load(name: str) -> Experiment:
    """A built-in experiment."""
    look_up("experiment", name, dict.fromkeys(BUILT_IN))
    text = resources.files(__package__).joinpath(f"{name}.toml").read_text("utf-8")
    return parse(name, text)


def load_file(path: Path) -> Experiment:
    """An experiment of the user's own.

    Raises:
        UnreadableError: it cannot be read.
        SettingsError: something in it is wrong.
    """
    try:
        return parse(path.stem, safe_io.read_bytes(path, _LARGEST_FILE).decode("utf-8"))
    except UnicodeDecodeError as error:
        raise SettingsError(f"cannot read experiment {path}: not UTF-8 text") from error
    except SettingsError as error:
        raise SettingsError(f"{path}: {error}") from error


def parse(name: str, text: str) -> Experiment:
    """The experiment that a TOML text describes.

    Raises:
        SettingsError: says what is wrong with it.
    """
    try:
        table = safe_io.parse_toml(text.encode())
    except ValueError as error:
        raise SettingsError(f"not valid TOML: {error}") from error
    _known(table, ("title", "preset", *_COUNTS, "arms"), "an experiment")
    arms = _table(table, "arms")
    if not arms:
        raise SettingsError("an experiment needs at least one [arms.NAME]")
    preset = _text(table, "preset", "quick")
    look_up("preset", preset, PRESETS)
    counts = {key: kind.check(key, table.get(key)) for key, kind in _COUNTS.items()}
    parsed = tuple(_arm(arm, _table(arms, arm), counts) for arm in arms)
    found = Experiment(name, _text(table, "title", name), preset, parsed)
    for arm in parsed:
        found.settings(arm, "trap-10", {})
        if arm.high_level:
            _check_high_level(found, arm)
    return found


def _arm(name: str, table: Mapping[str, Any], counts: Mapping[str, int]) -> ExperimentArm:
    """An arm; ``counts`` are the experiment's, where it has none of its own."""
    # It becomes a folder's name.
    if not name.replace("-", "").isalnum() or not name.isascii() or len(name) > 80:
        raise SettingsError(
            f'arm "{brief(name)}": a name holds letters, digits and dashes, at most 80'
        )
    _known(table, ("title", "controller", "high_level", "settings", *_COUNTS), f"arm {name}")
    controller = _text(table, "controller", "")
    look_up("controller", controller, CONTROLLERS)
    return ExperimentArm(
        name,
        _text(table, "title", name),
        controller,
        _table(table, "settings"),
        _text(table, "high_level", ""),
        **{key: kind.check(key, table.get(key, counts[key])) for key, kind in _COUNTS.items()},
    )


def _check_high_level(experiment: Experiment, arm: ExperimentArm) -> None:
    """Refuses, before anything is trained, what could not be taken over afterwards."""
    lender = next((other for other in experiment.arms if other.name == arm.high_level), None)
    if lender is None:
        raise SettingsError(f'arm {arm.name}: high_level "{brief(arm.high_level)}" is no arm')
    if {arm.controller, lender.controller} - set(WITH_STEP_1):
        raise SettingsError(f"arm {arm.name}: only {' and '.join(WITH_STEP_1)} have a step 1")
    if lender.high_level:
        raise SettingsError(f"arm {arm.name}: {lender.name} trains no step 1 of its own to lend")
    if arm.seeds > lender.seeds:
        raise SettingsError(f"arm {arm.name}: has more seeds than {lender.name}, its high_level")
    settings = (experiment.settings(each, "trap-10", {}) for each in (lender, arm))
    try:
        validation.check_high_level(*settings)
    except SettingsError as error:
        raise SettingsError(f"arm {arm.name}: {lender.name} {error}") from error


def _known(table: Mapping[str, Any], names: tuple[str, ...], owner: str) -> None:
    for key in table:
        if key not in names:
            hint = nearest(key, names) or "known: " + ", ".join(names)
            raise SettingsError(f'{owner} has no "{brief(key)}"; {hint}')


def _text(table: Mapping[str, Any], key: str, default: str) -> str:
    value: str = FieldType(str).check(key, table.get(key, default))
    return value


def _table(table: Mapping[str, Any], key: str) -> Mapping[str, Any]:
    value = table.get(key, {})
    if not isinstance(value, Mapping):
        raise SettingsError(f"{key}: expected a table")
    return value


def check_folder(out: Path, experiment: Experiment) -> None:
    """Refuse a folder that is neither new, nor empty, nor one of this experiment."""
    if not os.path.lexists(out / FILE):
        require_empty(out)
        return
    other = _name_in(out / FILE)
    if other != experiment.name:
        raise RunError(
            f'{out} holds experiment "{brief(other)}", not "{brief(experiment.name)}"; '
            "choose another folder"
        )


def mark_folder(out: OpenFolder, experiment: Experiment) -> None:
    """Name the experiment in its folder; an existing file stays as it is."""
    if not os.path.lexists(out.path / FILE):
        text = json.dumps({"format": _FORMAT, "experiment": experiment.name}, indent=2) + "\n"
        write_atomically(out, {FILE: text.encode()})


def _name_in(file: Path) -> str:
    """The experiment that a folder's file names."""
    try:
        found = safe_io.parse_json(safe_io.read_bytes(file, _LARGEST_FILE, links=False))
        if other := safe_io.format_mismatch(found, _FORMAT, 1):
            raise RunError(f"{file} {other}")
        if not isinstance(found, dict) or not isinstance(found.get("experiment"), str):
            raise ValueError("it has other fields")
    except ValueError as error:
        raise RunError(
            f"{file} does not name an experiment: {error}\n"
            "  choose another folder, or delete it if the runs are of this experiment"
        ) from error
    name: str = found["experiment"]
    return name
