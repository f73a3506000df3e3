"""Composes settings: defaults, presets, TOML files and flags, all checked. Imports no JAX."""

import dataclasses
import hashlib
import json
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import cache
from pathlib import Path
from typing import Any, get_type_hints

from lanewise import crosschecks
from lanewise.errors import SettingsError, brief
from lanewise.names import look_up, nearest
from lanewise.ranges import Kind, show
from lanewise.settings import PRESETS, TRAPS, Settings
from lanewise.system import safe_io

_LARGEST_FILE = 100_000


def compose(
    preset: str = "quick",
    trap: str = "trap-10",
    file: Path | str | None = None,
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
        if not isinstance(file, Path | str):
            raise SettingsError(f"settings file: expected a path, got {show(file)}")
        values |= load_toml(Path(file))
    if flags is not None:
        if not isinstance(flags, Mapping):
            raise SettingsError(f"flags: expected a mapping of settings, got {show(flags)}")
        values |= flags
    try:
        return replace(Settings(), values)
    except SettingsError as error:
        # What the file says is in range; here it contradicts something.
        raise error if file is None else SettingsError(f"{error} (settings file {file})") from error


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
            raise SettingsError(unknown_setting(str(name)))
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
    crosschecks.check(settings)


def unknown_setting(name: str) -> str:
    """The message for a name that is no setting, with the nearest right one."""
    hint = nearest(name, kinds()) or "`lanewise train --help` lists all"
    return f'unknown setting "{brief(name)}"; {hint}'


def load_toml(path: Path) -> dict[str, object]:
    """Reads the settings of a TOML file by dotted name; dashes and underscores are equal.

    Raises:
        SettingsError: The file cannot be read or is no TOML, or a name in it is unknown.
    """
    try:
        data = safe_io.read_bytes(path, _LARGEST_FILE)
    except safe_io.UnreadableError as error:
        raise SettingsError(f"cannot read settings file {path}: {error}") from error
    return parse_toml(data, path)


def compose_from(data: bytes, path: Path) -> Settings:
    """Composes the settings of a file from the bytes that ``path`` is known to hold.

    Raises:
        SettingsError: As in ``compose``; names the file.
    """
    values = parse_toml(data, path)
    try:
        return compose(flags=values)
    except SettingsError as error:
        raise SettingsError(f"{path}: {error}") from error


def parse_toml(data: bytes, path: Path) -> dict[str, object]:
    """Reads settings as `load_toml`, from the bytes that ``path`` is known to hold.

    Raises:
        SettingsError: They are no TOML, a name in them is unknown, or a value is out of its range.
    """
    try:
        table = safe_io.parse_toml(data)
    except ValueError as error:
        raise SettingsError(f"{path} is not valid TOML: {error}") from error
    try:
        values = _by_name(table)
        return {name: kinds()[name].check(name, value) for name, value in values.items()}
    except SettingsError as error:
        raise SettingsError(f"{path}: {error}") from error


@cache
def _sections() -> frozenset[str]:
    """Dotted names that are no settings but have some below them."""
    parts = (name.split(".") for name in kinds())
    return frozenset(".".join(words[:n]) for words in parts for n in range(1, len(words)))


def _by_name(table: Mapping[str, Any], prefix: str = "") -> dict[str, object]:
    """Flattens nested tables, refusing names that are neither a setting nor a section."""
    known = kinds()
    found: dict[str, object] = {}
    for key, value in table.items():
        name = prefix + key.replace("-", "_")
        is_section = name in _sections()
        if isinstance(value, Mapping) and is_section:
            below = _by_name(value, f"{name}.")
        elif name in known:
            below = {name: value}
        elif is_section:
            raise SettingsError(f"{name} is a section, not a setting; write [{name}]")
        elif isinstance(value, Mapping):
            sections = dict.fromkeys(option.rpartition(".")[0] for option in known)
            hint = nearest(name, sections) or "known: " + ", ".join(sections)
            raise SettingsError(f'unknown section "{brief(name)}"; {hint}')
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
