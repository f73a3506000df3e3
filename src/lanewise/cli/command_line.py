"""Reads a command line into a command's dataclass, and writes the command's help, with argparse.

argparse finds the words of each option; `FieldType` reads them and checks their range, as it does
for settings in a file.

A command is a dataclass. A field's metadata may say ``positional`` or give a ``short`` flag; a
positional list takes every word that belongs to no flag. A field ``values`` of type ``Settings``
lets the command take any setting, and needs the fields ``preset``, ``trap`` and ``settings``. A
field ``test`` of type ``Changes`` lets it take those by which a test may differ from a run's own.
"""

import argparse
import dataclasses
import inspect
import re
from collections.abc import Mapping, Sequence
from dataclasses import MISSING, dataclass, replace
from functools import cache
from pathlib import Path
from shutil import get_terminal_size
from typing import Any, Generic, NoReturn, TypeVar, get_type_hints

from lanewise import config
from lanewise.config.settings import PRESETS, Settings, of_test
from lanewise.errors import SettingsError, brief
from lanewise.fields import docstrings
from lanewise.fields.ranges import Between, FieldType, OneOf
from lanewise.fields.suggestions import nearest

C = TypeVar("C")
Changes = dict[str, object]
"""Settings by dotted name, of those that say how a controller is tested."""
_DASHES = "-\N{EN DASH}\N{EM DASH}"
_NEGATIVE = re.compile(r"-(\d|\.\d|inf|nan)", re.IGNORECASE)


@dataclass(frozen=True)
class Parsed(Generic[C]):
    """A command with all its values, and which of them the user wrote."""

    command: C
    given: frozenset[str]
    """Names of the fields and dotted names of the settings found on the command line."""

    @property
    def settings_given(self) -> bool:
        """Whether the user gave settings, by preset, file or flag."""
        return any(name in ("preset", "trap", "settings") or "." in name for name in self.given)


@dataclass(frozen=True)
class Option:
    """A flag or positional of a command, or a setting."""

    name: str
    type: FieldType
    default: Any
    doc: str
    metadata: Mapping[str, Any]

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

    @property
    def metavar(self) -> str:
        """What stands for its value in help."""
        if isinstance(self.type.bound, OneOf):
            return "{" + ",".join(self.type.bound.names) + "}"
        return self.label if self.positional else self.type.type.__name__.upper()

    @property
    def usage(self) -> str:
        """Its place in the usage line; empty for an option that may be left out."""
        required = self.default is MISSING
        if not self.positional:
            return f"{self.label} PATH" if required else ""
        several = f"{self.label} ..." if self.type.length is not None else self.label
        return several if required else f"[{several}]"

    def add_to(self, parser: Any) -> None:
        """Lets argparse find its words, and show its help."""
        names = [self.name] if self.positional else [flag_of(self.name)]
        names += [self.metadata["short"]] if "short" in self.metadata else []
        keywords: dict[str, Any] = {} if self.positional else {"dest": self.name}
        if self.is_switch:
            keywords["action"] = "store_true"
        else:
            # `parse` finds what is missing, once all unknown words have been refused.
            one = "?" if self.positional else None
            keywords["nargs"] = one if self.type.length is None else "*" if self.positional else "+"
            keywords["metavar"] = self.metavar
        text = self._help().replace("%", "%%")
        parser.add_argument(*names, help=text, default=argparse.SUPPRESS, **keywords)

    def read(self, found: Any) -> Any:
        """The value that argparse's words spell."""
        if self.is_switch:
            return True
        words = found if isinstance(found, list) else [found]
        if self.type.length is not None and self.type.type is not Path and len(words) == 1:
            words = words[0].split(",")
        return self.type.parse(self.label, [word.removeprefix(" ") for word in words])

    def _help(self) -> str:
        parts = [self.doc]
        if isinstance(self.type.bound, Between):
            parts.append(f"[{self.type.bound}]")
        if self.default is MISSING:
            parts.append("(required)")
        elif self.default not in (None, ()) and not self.is_switch:
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
        SettingsError: An option or argument is unknown, missing or wrong, or settings contradict
            one another.
    """
    owner: Any = command
    options = options_of(owner)
    flags = {option.label: name for name, option in options.items() if not option.positional}
    known = {*flags, *(option.metadata.get("short", "") for option in options.values())}
    normal = [_normalise(command, word, known) for word in words]
    namespace, rest = _parser(owner).parse_known_intermixed_args(normal)
    if rest:
        meant = f"; did you mean {flag_of(rest[0])}?" if flag_of(rest[0]) in flags else ""
        raise SettingsError(f'unexpected argument "{brief(rest[0])}"{meant}')
    for name, option in options.items():
        if option.default is MISSING and name not in namespace:
            choices = f": {option.type.bound}" if option.type.bound is not None else ""
            raise SettingsError(f"missing {option.label}{choices}")
    found = {name: options[name].read(value) for name, value in vars(namespace).items()}
    values = {name: value for name, value in found.items() if "." not in name}
    settings = {name: value for name, value in found.items() if "." in name}
    names = {item.name for item in dataclasses.fields(owner)}
    if "test" in names:
        values["test"] = settings
    if "values" in names:
        preset = values.get("preset", "quick")
        values["values"] = config.compose(
            # An experiment's preset has settings of its own.
            preset=preset if preset in PRESETS else "quick",
            trap=values.get("trap", "trap-10"),
            file=values.get("settings"),
            flags=settings,
        )
    return Parsed(command(**values), frozenset(found))


def help_text(command: type) -> str:
    """The help of a command, with every setting it takes."""
    return _parser(command).format_help()


def _normalise(command: type, word: str, known: set[str]) -> str:
    """A word as argparse takes it: flags with dashes, negative numbers as values."""
    if _NEGATIVE.match(word):
        return f" {word}"
    # A single dash, also a word processor's, begins a misspelt long flag.
    if not word.startswith("--") and not (word[:1] in _DASHES and word[1:2].isalpha()):
        return word
    flag, equals, value = word.partition("=")
    if (normal := flag.replace("_", "-")) in known:
        return normal + equals + value
    hint = nearest(flag.lstrip(_DASHES), [each.lstrip("-") for each in known])
    hint = hint.replace("did you mean ", "did you mean --").replace(" or ", " or --")
    hint = hint or f"`lanewise {command.__name__.lower()} --help` lists all"
    raise SettingsError(f'unknown option "{brief(flag)}"; {hint}')


@cache
def _parser(command: type) -> _Parser:
    usage = " ".join(each.usage for each in options_of(command).values() if each.usage)
    parser = _Parser(
        usage=f"lanewise {command.__name__.lower()} [OPTIONS] {usage}".rstrip(),
        description=inspect.getdoc(command),
        formatter_class=_Formatter,
        allow_abbrev=False,
    )
    for title, options in _groups(command):
        group = parser.add_argument_group(title) if title else parser
        for option in options:
            option.add_to(group)
    return parser


@cache
def options_of(command: type) -> dict[str, Option]:
    """Every option of a command by name, settings included."""
    return {option.name: option for _, group in _groups(command) for option in group}


def _groups(part: Any, name: str = "", title: str = "") -> list[tuple[str, list[Option]]]:
    """The options of a command's class or of a section of the settings, then of sections below."""
    owner = part if isinstance(part, type) else type(part)
    docs, hints = docstrings.of_fields(owner), get_type_hints(owner, include_extras=True)
    own: list[Option] = []
    below: list[tuple[str, list[Option]]] = []
    for item in dataclasses.fields(owner):
        full, doc, hint = f"{name}{item.name}", docs.get(item.name, ""), hints[item.name]
        if hint is Settings:
            below += _groups(Settings())
        elif hint == Changes:
            below += _groups_of_test()
        elif dataclasses.is_dataclass(hint):
            below += _groups(getattr(part, item.name), f"{full}.", f"{full}: {doc.rstrip('.')}")
        else:
            default = item.default if isinstance(part, type) else getattr(part, item.name)
            own.append(Option(full, FieldType.of(hint), default, doc, item.metadata))
    return [(title, own), *below]


def _groups_of_test() -> list[tuple[str, list[Option]]]:
    """The settings by which a test may differ, without a default: that is the run's."""
    found = []
    for title, options in _groups(Settings()):
        own = [replace(option, default=None) for option in options if of_test(option.name)]
        found += [(f"{title} (default: as the run has it)", own)] if own else []
    return found
