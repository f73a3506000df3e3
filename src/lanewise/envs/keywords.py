"""The settings of an environment, given by keyword as to ``gymnasium.make``. Imports no JAX."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from lanewise import config
from lanewise.config.settings import Settings
from lanewise.errors import SettingsError, brief
from lanewise.fields.suggestions import nearest

SECTIONS = ("scenario", "driving", "goals", "planner")
"""Sections of the settings that an environment uses."""
NEEDED = (
    *("traffic.driver", "traffic.speed", "traffic.first_gap", "actions"),
    *("observation.variant", "observation.speed_range"),
    *("goals", "planner", "search", "single_level"),
)
"""Without these words a setting's name would be read as the ego's, the episode's or another's."""


def compose(
    preset: str, trap: str, given: Mapping[str, Any], sections: Sequence[str] = SECTIONS
) -> Settings:
    """The settings with what was given replaced, of those ``sections`` that may be given.

    ``preset`` says over which starts episodes vary, ``trap`` is a scenario preset. A setting may be
    named in full (``"scenario.trap_speed"``), by its last word where only one ends so and it cannot
    be misread (``trap_speed``), or within a mapping named like its section
    (``scenario={"trap_speed": 10.9}``). NumPy's numbers are taken too.

    Raises:
        SettingsError: a name is unknown, means several settings, would be read as another's, or is
            given twice; or a value has the wrong type, is out of range or contradicts another.
    """
    return config.compose(preset, trap, flags=in_full(given, sections))


def in_full(given: Mapping[str, Any], sections: Sequence[str] = SECTIONS) -> dict[str, object]:
    """What was given by dotted name, as `compose` reads it; values are not checked."""
    known = [name for name in config.field_types() if name.partition(".")[0] in sections]
    flags: dict[str, object] = {}
    for name, value in _flat(given, known):
        setting = _resolve(name, known)
        if setting in flags:
            raise SettingsError(f"{setting} is given twice")
        flags[setting] = plain(value)
    return flags


def plain(value: Any) -> Any:
    """NumPy's numbers and arrays as Python's, those of a list too; anything else as it is."""
    if isinstance(value, np.generic | np.ndarray):
        return value.tolist()
    if isinstance(value, list | tuple):
        return [plain(member) for member in value]
    return value


def _flat(
    given: Mapping[str, Any], known: Sequence[str], prefix: str = ""
) -> list[tuple[str, object]]:
    """Mappings as dotted names; one given for a setting is its value, and will be refused."""
    found: list[tuple[str, object]] = []
    for key, value in given.items():
        name = f"{prefix}{key}"
        is_setting = any(f".{option}".endswith(f".{name}") for option in known)
        nested = isinstance(value, Mapping) and not is_setting
        found += _flat(value, known, f"{name}.") if nested else [(name, value)]
    return found


def _resolve(name: str, known: list[str]) -> str:
    """The full name of a setting."""
    if name in known:
        return name
    ending = [option for option in known if option.endswith(f".{name}")]
    if len(ending) == 1:
        _refuse_misread(name, ending[0])
        return ending[0]
    if ending:
        several = ", ".join(ending[:3]) + (", ..." if len(ending) > 3 else "")
        raise SettingsError(f'"{name}" may be {several}; give it in full')
    if any(option.startswith(f"{name}.") for option in known):
        raise SettingsError(f"{name} is a section, not a setting; give it a mapping")
    hint = nearest(name, known) or "docs/settings.md lists all"
    raise SettingsError(f'unknown setting "{brief(name)}"; {hint}')


def _refuse_misread(name: str, full: str) -> None:
    for words in NEEDED:
        if f".{words}." in f".{full}." and f".{words}." not in f".{name}.":
            raise SettingsError(
                f'"{name}" alone may be misread, it stands for {full}: give it in full'
            )
