"""Reads a command line into a command's dataclass, with errors of one line.

tyro writes the help from the same dataclasses (``helptext``), but its errors are long boxes and
it accepts not-a-number, so reading is done here, where every word can be checked.

A command is a dataclass. A field's metadata may say ``positional`` or give a ``short`` flag; the
last positional may be a list, which takes every word that belongs to no flag. A field ``values`` of
type ``Settings`` lets the command take any setting, together with its fields ``preset``, ``trap``
and ``settings`` (a TOML file).
"""

import dataclasses
import types
from collections import deque
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any, Generic, TypeVar, Union, get_args, get_origin, get_type_hints

from lanewise import config
from lanewise.errors import SettingsError, brief
from lanewise.names import nearest
from lanewise.ranges import Kind
from lanewise.settings import PRESETS

C = TypeVar("C")
_DASHES = "-\N{EN DASH}\N{EM DASH}"


@dataclass(frozen=True)
class Parsed(Generic[C]):
    """A command with all its values, and which of them the user wrote."""

    command: C
    """The command, ready to run."""
    given: frozenset[str]
    """Names of the fields and dotted names of the settings found on the command line."""

    @property
    def settings_given(self) -> bool:
        """Whether the user said anything about settings, be it by preset, file or flag."""
        return any(name in ("preset", "trap", "settings") or "." in name for name in self.given)


@dataclass(frozen=True)
class Option:
    """A flag or positional of a command, or a setting."""

    name: str
    kind: Kind
    positional: bool = False
    required: bool = False

    @property
    def label(self) -> str:
        """How people write it."""
        return self.name.upper() if self.positional else flag_of(self.name)

    @property
    def is_list(self) -> bool:
        """Whether it takes any number of values."""
        return self.kind.length == 0

    @property
    def is_switch(self) -> bool:
        """Whether its presence is its value; settings always take true or false."""
        return self.kind.type is bool and "." not in self.name

    def read(self, words: Sequence[str]) -> Any:
        """The value that ``words`` spell."""
        if self.kind.type is not Path:
            return self.kind.parse(self.label, words)
        if not all(words):
            raise SettingsError(f"{self.label}: expected a path, got nothing")
        return tuple(map(Path, words)) if self.is_list else Path(words[0])


def flag_of(name: str) -> str:
    """The long flag of a field or a dotted setting."""
    return "--" + name.replace("_", "-")


def parse(command: type[C], words: Sequence[str]) -> Parsed[C]:
    """Reads ``words`` into ``command``.

    Raises:
        SettingsError: An option is unknown, lacks its value, or has a wrong one; an argument is
            missing or too many; the settings contradict one another.
    """
    found = _collect(command, words)
    values = _own(found)
    if any(item.name == "values" for item in dataclasses.fields(command)):  # type: ignore[arg-type]
        flags = {name: value for name, value in found.items() if "." in name}
        values["values"] = config.compose(
            preset=_training_preset(values.get("preset", "quick")),
            trap=values.get("trap", "trap-10"),
            file=values.get("settings"),
            flags=flags,
        )
    return Parsed(command(**values), frozenset(found))


def without_settings(command: type[C], words: Sequence[str]) -> C:
    """The command that ``words`` spell, but for its settings; no file of them is read.

    Raises:
        SettingsError: An option is unknown, lacks its value, or has a wrong one.
    """
    return command(**_own(_collect(command, words)))


def _own(found: Mapping[str, Any]) -> dict[str, Any]:
    """The command's own options among those found, without those of its settings."""
    return {name: value for name, value in found.items() if "." not in name}


def _training_preset(preset: str) -> str:
    """The preset itself, or the default's name where it is an experiment's, which has its own."""
    return preset if preset in PRESETS else "quick"


def _collect(command: type, words: Sequence[str]) -> dict[str, Any]:
    """The value of every option in ``words``, by name."""
    flags, positionals = _flags(command), _positionals(command)
    found: dict[str, Any] = {}
    queue = deque(words)
    while queue:
        word = queue.popleft()
        if _is_flag(word):
            flag, equals, value = word.partition("=")
            option = _find(command, flags, flag)
            found[option.name] = _flag_value(option, value if equals else None, queue)
        else:
            place = next((p for p in positionals if p.is_list or p.name not in found), None)
            if place is None:
                meant = f"; did you mean {flag_of(word)}?" if flag_of(word) in flags else ""
                raise SettingsError(f'unexpected argument "{brief(word)}"{meant}')
            value = place.read([word])
            found[place.name] = found.get(place.name, ()) + value if place.is_list else value
    for option in (*positionals, *flags.values()):
        if option.required and option.name not in found:
            raise SettingsError(f"missing {option.label}{_choices(option)}")
    return found


def _flag_value(option: Option, attached: str | None, queue: deque[str]) -> Any:
    """The value of a flag, either attached with ``=`` or taken off the queue."""
    if option.is_switch:
        if attached is not None:
            raise SettingsError(f"{option.label} takes no value")
        return True
    if attached is not None:
        words = attached.split(",") if option.kind.length is not None else [attached]
        return option.read(words)
    # A list of any length takes all that follows up to the next flag.
    wanted = 1 if option.kind.length is None else option.kind.length
    words = []
    while queue and not _is_flag(queue[0]) and (wanted == 0 or len(words) < wanted):
        words.append(queue.popleft())
    if not words:
        raise SettingsError(f"{option.label}: expected {option.kind}, got nothing")
    return option.read(words)


def _is_flag(word: str) -> bool:
    """Whether a word starts an option; ``-5`` and ``-inf`` are values.

    A long option with one dash, or with the dash that word processors make of two, is one too, if
    a misspelt one.
    """
    if word.startswith("--"):
        return True
    number = word.lower() in ("-inf", "-infinity", "-nan")
    return word[:1] in _DASHES and word[1:2].isalpha() and not number


def _find(command: type, flags: Mapping[str, Option], flag: str) -> Option:
    normal = flag if len(flag) == 2 else flag_of(flag.removeprefix("--"))
    if normal in flags:
        return flags[normal]
    hint = nearest(flag.lstrip(_DASHES), [known.removeprefix("--") for known in flags])
    hint = hint.replace("did you mean ", "did you mean --").replace(" or ", " or --")
    hint = hint or f"`lanewise {command.__name__.lower()} --help` lists all"
    raise SettingsError(f'unknown option "{brief(flag)}"; {hint}')


def _choices(option: Option) -> str:
    return f": {option.kind.bound}" if option.kind.bound is not None else ""


def _positionals(command: type) -> tuple[Option, ...]:
    return tuple(option for option in _options(command) if option.positional)


@cache
def _flags(command: type) -> dict[str, Option]:
    """Every flag of a command, settings included, by its spelling with dashes."""
    flags = {flag_of(item.name): item for item in _options(command) if not item.positional}
    for item in dataclasses.fields(command):
        if "short" in item.metadata:
            flags[item.metadata["short"]] = flags[flag_of(item.name)]
        if item.name == "values":
            flags |= {flag_of(name): Option(name, kind) for name, kind in config.kinds().items()}
    return flags


@cache
def _options(command: type) -> tuple[Option, ...]:
    hints = get_type_hints(command, include_extras=True)
    return tuple(
        Option(
            item.name,
            Kind.of(without_none(hints[item.name])),
            item.metadata.get("positional", False),
            item.default is dataclasses.MISSING and item.default_factory is dataclasses.MISSING,
        )
        for item in dataclasses.fields(command)
        if item.name != "values"
    )


def without_none(annotation: Any) -> Any:
    """The type of an option that may be left out."""
    if get_origin(annotation) in (Union, types.UnionType):
        return next(member for member in get_args(annotation) if member is not types.NoneType)
    return annotation
