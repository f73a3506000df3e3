"""Reads a command line into a command's dataclass, and writes the command's help, with argparse.

argparse finds the words of each option; `FieldType` reads them and checks their range, as it does
for settings in a file. So not-a-number is refused, and every error is one line.

A command is a dataclass. A field's metadata may say ``positional`` or give a ``short`` flag; the
last positional may be a list, which takes every word that belongs to no flag. A field ``values`` of
type ``Settings`` lets the command take any setting, together with its fields ``preset``, ``trap``
and ``settings`` (a TOML file).
"""

import argparse
import dataclasses
import inspect
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from shutil import get_terminal_size
from typing import Any, Generic, NoReturn, TypeVar, get_type_hints

from lanewise import config
from lanewise.config.settings import PRESETS
from lanewise.errors import SettingsError, brief
from lanewise.fields import docstrings
from lanewise.fields.ranges import Between, FieldType, OneOf
from lanewise.fields.suggestions import nearest

C = TypeVar("C")
_SETTINGS = "values"
"""The field that stands for every setting."""
_DASHES = "-\N{EN DASH}\N{EM DASH}"
_NUMBER = re.compile(r"-(\d|\.\d|inf|nan)", re.IGNORECASE)


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
    type: FieldType
    default: Any = dataclasses.MISSING
    doc: str = ""
    metadata: Mapping[str, Any] = dataclasses.field(default_factory=dict)

    @property
    def positional(self) -> bool:
        """Whether it is given by its place."""
        return bool(self.metadata.get("positional"))

    @property
    def label(self) -> str:
        """How people write it."""
        return self.name.upper() if self.positional else flag_of(self.name)

    @property
    def is_switch(self) -> bool:
        """Whether its presence is its value; settings always take true or false."""
        return self.type.type is bool and "." not in self.name

    def add_to(self, parser: Any, documented: bool) -> None:
        """Lets argparse find its words, and show its help."""
        names = [self.name] if self.positional else [flag_of(self.name)]
        names += [self.metadata["short"]] if "short" in self.metadata else []
        keywords: dict[str, Any] = {"default": argparse.SUPPRESS}
        if not self.positional:
            keywords["dest"] = self.name
        if self.is_switch:
            keywords["action"] = "store_true"
        else:
            keywords["nargs"] = "*" if self.type.length is not None else "?"
        if documented:
            keywords["help"] = self._help().replace("%", "%%")
            # argparse would show in brackets that there may be no word; we refuse that ourselves.
            if not self.is_switch:
                keywords |= {"nargs": None, "metavar": self._metavar()}
        parser.add_argument(*names, **keywords)

    def read(self, found: Any) -> Any:
        """The value that argparse's words spell."""
        if self.is_switch:
            return True
        words = found if isinstance(found, list) else [found] if found is not None else []
        if self.type.length is not None and self.type.type is not Path and len(words) == 1:
            words = words[0].split(",")
        return self.type.parse(self.label, [word.removeprefix(" ") for word in words])

    def _metavar(self) -> str:
        bound = self.type.bound
        choices = "{" + ",".join(bound.names) + "}" if isinstance(bound, OneOf) else None
        one = choices or (self.label if self.positional else self.type.type.__name__.upper())
        return one if self.type.length is None else f"{one} ..."

    def _help(self) -> str:
        parts = [self.doc]
        if isinstance(self.type.bound, Between):
            parts.append(f"[{self.type.bound}]")
        if self.default is dataclasses.MISSING:
            parts.append("(required)")
        elif self.default is not None and self.default != () and not self.is_switch:
            shown = self.default if isinstance(self.default, tuple) else (self.default,)
            parts.append(f"(default: {' '.join(map(str, shown))})")
        return " ".join(parts)


class _Parser(argparse.ArgumentParser):
    def error(self, message: str) -> NoReturn:
        raise SettingsError(message.removeprefix("argument "))


class _Formatter(argparse.RawDescriptionHelpFormatter):
    def __init__(self, prog: str) -> None:
        # The help of an option stands below it, as names of settings are long.
        super().__init__(prog, max_help_position=8, width=min(100, get_terminal_size().columns))


def flag_of(name: str) -> str:
    """The long flag of a field or a dotted setting."""
    return "--" + name.replace("_", "-")


def parse(command: type[C], words: Sequence[str]) -> Parsed[C]:
    """Reads ``words`` into ``command``.

    Raises:
        SettingsError: An option is unknown, lacks its value, or has a wrong one; an argument is
            missing or too many; the settings contradict one another.
    """
    found = _read(command, words)
    values = _without_settings(found)
    if hasattr(command, "settings"):  # It takes settings, as its dataclass has these fields.
        preset = values.get("preset", "quick")
        values[_SETTINGS] = config.compose(
            # An experiment's preset has settings of its own.
            preset=preset if preset in PRESETS else "quick",
            trap=values.get("trap", "trap-10"),
            file=values.get("settings"),
            flags={name: value for name, value in found.items() if "." in name},
        )
    return Parsed(command(**values), frozenset(found))


def parse_without_settings(command: type[C], words: Sequence[str]) -> C:
    """Reads ``words`` into ``command``, but leaves all settings at their defaults.

    No file of settings is read.

    Raises:
        SettingsError: An option is unknown, lacks its value, or has a wrong one.
    """
    return command(**_without_settings(_read(command, words)))


def _without_settings(found: Mapping[str, Any]) -> dict[str, Any]:
    return {name: value for name, value in found.items() if "." not in name}


def help_text(command: type) -> str:
    """The help of a command, with every setting it takes."""
    return _parser(command, documented=True).format_help()


def options_of(command: type) -> dict[str, Option]:
    """Every option of a command by name, settings included."""
    return {option.name: option for _, group in _groups(command) for option in group}


def _read(command: type, words: Sequence[str]) -> dict[str, Any]:
    """The value of every option in ``words``, by name."""
    options = options_of(command)
    flags = {flag_of(name): name for name, option in options.items() if not option.positional}
    shorts = {option.metadata.get("short") for option in options.values()}
    known = [_normalise(command, word, {*flags, *shorts}) for word in words]
    namespace, rest = _parser(command).parse_known_intermixed_args(known)
    if rest:
        meant = f"; did you mean {flag_of(rest[0])}?" if flag_of(rest[0]) in flags else ""
        raise SettingsError(f'unexpected argument "{brief(rest[0])}"{meant}')
    for name, option in options.items():
        if option.default is dataclasses.MISSING and name not in namespace:
            choices = f": {option.type.bound}" if option.type.bound is not None else ""
            raise SettingsError(f"missing {option.label}{choices}")
    return {name: options[name].read(value) for name, value in vars(namespace).items()}


def _normalise(command: type, word: str, flags: set[str | None]) -> str:
    """A word as argparse takes it: flags with dashes, negative numbers as values.

    Raises:
        SettingsError: It is an unknown flag.
    """
    if _NUMBER.match(word):
        return f" {word}"
    # One dash, or the dash that word processors make of two, begins a misspelt long flag.
    if not word.startswith("--") and not (word[:1] in _DASHES and word[1:2].isalpha()):
        return word
    flag, equals, value = word.partition("=")
    spelt = flag.replace("_", "-")
    if spelt in flags:
        return spelt + equals + value
    hint = nearest(flag.lstrip(_DASHES), [each.lstrip("-") for each in flags if each])
    hint = hint.replace("did you mean ", "did you mean --").replace(" or ", " or --")
    hint = hint or f"`lanewise {command.__name__.lower()} --help` lists all"
    raise SettingsError(f'unknown option "{brief(flag)}"; {hint}')


@cache
def _parser(command: type, documented: bool = False) -> _Parser:
    groups = list(_groups(command, documented))
    required = [option for option in groups[0][1] if option.default is dataclasses.MISSING]
    usage = (each.label if each.positional else f"{each.label} PATH" for each in required)
    name = command.__name__.lower()
    parser = _Parser(
        usage=f"lanewise {name} [OPTIONS] {' '.join(usage)}",
        description=inspect.getdoc(command),
        formatter_class=_Formatter,
        allow_abbrev=False,
        add_help=documented,
    )
    for title, options in groups:
        group = parser.add_argument_group(title) if title else parser
        for option in options:
            option.add_to(group, documented)
    return parser


def _groups(
    part: Any, documented: bool = False, name: str = ""
) -> Iterator[tuple[str, list[Option]]]:
    """The options of a command or of a section of the settings, then those of the sections below.

    Args:
        part: a command's class, or a section.
        documented: whether the options carry their docstrings; reading these takes time.
        name: of the section, for its options.
    """
    owner = part if isinstance(part, type) else type(part)
    docs = docstrings.of_fields(owner) if documented else {}
    hints = get_type_hints(owner, include_extras=True)
    own: list[Option] = []
    below: list[tuple[str, list[Option]]] = []
    for item in dataclasses.fields(owner):
        default = item.default if isinstance(part, type) else getattr(part, item.name)
        if default is dataclasses.MISSING and item.default_factory is not dataclasses.MISSING:
            default = item.default_factory()
        full, doc = f"{name}{item.name}", docs.get(item.name, "")
        if dataclasses.is_dataclass(default):
            prefix = "" if item.name == _SETTINGS else f"{full}."
            (_, first), *others = _groups(default, documented, prefix)
            below += [(f"{full}: {doc}".removesuffix("."), first)] if first else []
            below += others
        else:
            own.append(Option(full, FieldType.of(hints[item.name]), default, doc, item.metadata))
    yield "", own
    yield from below
