"""Settings, composed from defaults, presets, TOML files and flags, all checked. Imports no JAX."""

import dataclasses
import hashlib
import json
from collections.abc import Mapping, Sequence
from functools import cache
from pathlib import Path
from typing import Any, get_type_hints

from lanewise.config import validation
from lanewise.config.settings import PRESETS, TRAPS, Settings
from lanewise.errors import SettingsError, brief
from lanewise.fields.ranges import FieldType, show
from lanewise.fields.suggestions import look_up, nearest
from lanewise.system import safe_io

_LARGEST_FILE = 100_000


def compose(
    preset: str = "quick",
    trap: str = "trap-10",
    file: Path | str | None = None,
    flags: Mapping[str, object] | None = None,
    data: bytes | None = None,
) -> Settings:
    """Composes settings: defaults < training preset < scenario preset < TOML file < flags.

    Args:
        preset: A name in ``PRESETS``.
        trap: A name in ``TRAPS``.
        file: With any of the settings.
        flags: Values by dotted name.
        data: The content of ``file``, if it has been read already.

    Raises:
        UnreadableError: The file cannot be read.
        SettingsError: A name is unknown, or a value has the wrong type, is out of range or
            contradicts another.
    """
    values = dict(look_up("preset", preset, PRESETS))
    values |= look_up("trap", trap, TRAPS)
    if file is not None:
        values |= load_toml(Path(file), data)
    try:
        return replace(Settings(), values | dict(flags or {}))
    except SettingsError as error:
        # Each value of the file is in range; one of them contradicts another.
        raise error if file is None else SettingsError(f"{file}: {error}") from error


@cache
def field_types(owner: type = Settings) -> dict[str, FieldType]:
    """Every setting below a dataclass by its dotted name, in the order of the fields."""
    found: dict[str, FieldType] = {}
    for name, annotation in get_type_hints(owner, include_extras=True).items():
        if dataclasses.is_dataclass(annotation):
            below = field_types(annotation)  # type: ignore[arg-type]
            found |= {f"{name}.{rest}": field_type for rest, field_type in below.items()}
        else:
            found[name] = FieldType.of(annotation)
    return found


def flatten(settings: Any, prefix: str = "") -> dict[str, Any]:
    """Every value by its dotted name, in the order of the fields."""
    flat: dict[str, Any] = {}
    for item in dataclasses.fields(settings):
        value, name = getattr(settings, item.name), prefix + item.name
        flat |= flatten(value, f"{name}.") if dataclasses.is_dataclass(value) else {name: value}
    return flat


def replace(settings: Settings, values: Mapping[str, object]) -> Settings:
    """Returns ``settings`` with some values, given by dotted name, replaced and all checked.

    Raises:
        SettingsError: As in ``compose``.
    """
    known = field_types()
    for name in values:
        if name not in known:
            raise SettingsError(_unknown_setting(str(name)))
    everything = flatten(settings) | dict(values)
    checked = {name: known[name].check(name, value) for name, value in everything.items()}
    changed: Settings = _rebuild(settings, checked)
    validation.check(changed)
    return changed


def _rebuild(part: Any, values: Mapping[str, object], prefix: str = "") -> Any:
    fields: dict[str, object] = {}
    for item in dataclasses.fields(part):
        old, name = getattr(part, item.name), prefix + item.name
        nested = dataclasses.is_dataclass(old)
        fields[item.name] = _rebuild(old, values, f"{name}.") if nested else values[name]
    return dataclasses.replace(part, **fields)


def _unknown_setting(name: str) -> str:
    hint = nearest(name, field_types()) or "`lanewise train --help` lists all"
    return f'unknown setting "{brief(name)}"; {hint}'


def load_toml(path: Path, data: bytes | None = None) -> dict[str, object]:
    """Reads the settings of a TOML file by dotted name; dashes and underscores are equal.

    ``data`` is the file's content, if it has been read already.

    Raises:
        UnreadableError: The file cannot be read.
        SettingsError: Something in it is wrong.
    """
    try:
        table = safe_io.parse_toml(
            safe_io.read_bytes(path, _LARGEST_FILE) if data is None else data
        )
    except ValueError as error:
        raise SettingsError(f"{path} is not valid TOML: {error}") from error
    try:
        values = _by_name(table)
        return {name: field_types()[name].check(name, value) for name, value in values.items()}
    except SettingsError as error:
        raise SettingsError(f"{path}: {error}") from error


def _by_name(table: Mapping[str, Any], prefix: str = "") -> dict[str, object]:
    """Flattens nested tables, refusing names that are neither a setting nor a section."""
    known = field_types()
    sections = dict.fromkeys(n[:i] for n in known for i, letter in enumerate(n) if letter == ".")
    found: dict[str, object] = {}
    for key, value in table.items():
        name = prefix + key.replace("-", "_")
        if isinstance(value, Mapping) and name in sections:
            below = _by_name(value, f"{name}.")
        elif name in known:
            below = {name: value}
        elif name in sections:
            raise SettingsError(f"{name} is a section, not a setting; write [{name}]")
        elif isinstance(value, Mapping):
            hint = nearest(name, sections) or "known: " + ", ".join(sections)
            raise SettingsError(f'unknown section "{brief(name)}"; {hint}')
        else:
            raise SettingsError(_unknown_setting(name))
        if found.keys() & below.keys():
            raise SettingsError(f"{name} is given twice")
        found |= below
    return found


def dump_toml(settings: Settings) -> str:
    """Writes every setting as TOML, in the order of the fields; ``load_toml`` reads it back."""
    tables: dict[str, list[str]] = {}
    for name, value in flatten(settings).items():
        section, _, leaf = name.rpartition(".")
        # For finite numbers, truth values, text and lists of these, JSON is TOML.
        line = f"{leaf} = {json.dumps(value, allow_nan=False)}"
        tables.setdefault(section, [f"[{section}]"]).append(line)
    return "\n\n".join("\n".join(lines) for lines in tables.values()) + "\n"


def digest(settings: Settings) -> str:
    """SHA-256 of the settings as TOML, by which stored files are matched to them."""
    return hashlib.sha256(dump_toml(settings).encode()).hexdigest()


def first_difference(ours: Settings, theirs: Settings) -> str:
    """Says which setting differs first and both its values; empty if none does."""
    for name, (value, other) in differences([ours, theirs]).items():
        return f"{name} is {show(value)}, not {show(other)}"
    return ""


def differences(settings: Sequence[Settings]) -> dict[str, tuple[Any, ...]]:
    """The settings that are not the same in all, by dotted name: one value each, in order."""
    flat = [flatten(each) for each in settings]
    values = {name: tuple(each[name] for each in flat) for name in field_types()}
    return {name: found for name, found in values.items() if len(set(found)) > 1}
