"""Types and ranges of settings, written beside the field they bound and checked in one place."""

import math
import types
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Union, get_args, get_origin

from lanewise.errors import SettingsError, brief


@dataclass(frozen=True)
class Between:
    """The closed interval a number must lie in, with its unit.

    Used as ``Annotated[float, Between(0.0, 60.0, "m/s")]``; in a tuple it holds for every member.
    Every setting that is a number has one, so no setting is infinite or not-a-number.
    """

    low: float
    high: float
    unit: str = ""

    def holds(self, value: float) -> bool:
        """Whether ``value`` is inside the interval."""
        return self.low <= value <= self.high

    def __str__(self) -> str:
        # The shortest text of a number, without a trailing ``.0``.
        low, high = (repr(bound).removesuffix(".0") for bound in (self.low, self.high))
        return f"between {low} and {high} {self.unit}".rstrip()


SEEDS = Between(0, 2**31 - 1)
"""Of everything random."""
EPISODES = Between(1, 10_000_000)
"""Of one test."""


@dataclass(frozen=True)
class OneOf:
    """The names a text setting may take."""

    names: tuple[str, ...]

    def holds(self, value: str) -> bool:
        """Whether ``value`` is one of the names."""
        return value in self.names

    def __str__(self) -> str:
        return "one of " + ", ".join(self.names)


@dataclass(frozen=True)
class OrNone:
    """Marks a list that holds ``length`` values or none at all.

    Used as ``Annotated[tuple[float, ...], Between(0.0, 60.0), OrNone(2)]``. None at all is ``[]``
    in a file and the word ``none`` on a command line.
    """

    length: int


@dataclass(frozen=True)
class FieldType:
    """What a field may hold: the type, how many values, and the range of each.

    ``length`` is None for a single value, 0 for a list of any length, otherwise the exact length;
    ``optional`` allows an empty list besides.
    """

    type: type
    length: int | None = None
    bound: Between | OneOf | None = None
    optional: bool = False

    @classmethod
    def of(cls, annotation: Any) -> "FieldType":
        """Reads it off a field's annotation; ``| None`` marks an option that may be left out."""
        if get_origin(annotation) in (Union, types.UnionType):
            annotation = next(m for m in get_args(annotation) if m is not types.NoneType)
        metadata: list[Any] = []
        if get_origin(annotation) is Annotated:
            annotation, *metadata = get_args(annotation)
        bound = next((item for item in metadata if isinstance(item, Between | OneOf)), None)
        if get_origin(annotation) is not tuple:
            return cls(annotation, None, bound)
        members = get_args(annotation)
        for item in metadata:
            if isinstance(item, OrNone):
                return cls(members[0], item.length, bound, optional=True)
        return cls(members[0], 0 if members[-1] is Ellipsis else len(members), bound)

    def check(self, name: str, value: object) -> Any:
        """Returns ``value`` in the field's own type, or raises a SettingsError.

        Whole numbers pass as floats and text as a path; nothing else is converted.
        """
        if self.length is None:
            return self._check_one(name, value)
        is_list = isinstance(value, Sequence) and not isinstance(value, str)
        if is_list and not value and self.optional:
            return ()
        if not is_list or not value or self.length not in (0, len(value)):  # type: ignore[arg-type]
            raise SettingsError(f"{name}: expected {self}, got {show(value)}")
        return tuple(self._check_one(name, member) for member in value)  # type: ignore[attr-defined]

    def parse(self, name: str, words: Sequence[str]) -> Any:
        """Reads a value from the words of a command line, and checks it."""
        if self.optional and [word.lower() for word in words] == ["none"]:
            return ()
        values = [self._parse_one(name, word) for word in words]
        return self.check(name, values if self.length is not None else values[0])

    def _parse_one(self, name: str, word: str) -> object:
        if self.type is Path and not word:
            raise SettingsError(f"{name}: expected a path, got nothing")
        try:
            if self.type is bool:
                return {"true": True, "false": False}[word.lower()]
            return self.type(word)
        except (KeyError, ValueError):
            raise SettingsError(f'{name}: expected {self._noun}, got "{brief(word)}"') from None

    def _check_one(self, name: str, value: Any) -> Any:
        if self.type is float and type(value) is int:
            value = float(value) if abs(value) < 1 << 1000 else math.inf
        if self.type is Path and isinstance(value, str | Path) and value != "":
            return Path(value)
        # `isinstance` would take True for the whole number 1.
        if type(value) is not self.type:
            raise SettingsError(f"{name}: expected {self._noun}, got {show(value)}")
        bound: Any = self.bound
        if bound is not None and not bound.holds(value):
            raise SettingsError(f"{name} must be {bound}, got {show(value)}")
        return value

    @property
    def _noun(self) -> str:
        if isinstance(self.bound, OneOf):
            return str(self.bound)
        names = {bool: "true or false", int: "a whole number", float: "a number", Path: "a path"}
        return names.get(self.type, "text")

    def __str__(self) -> str:
        if self.length is None:
            return self._noun
        plural = {int: "whole numbers", float: "numbers", Path: "paths"}.get(self.type, "values")
        if isinstance(self.bound, OneOf):
            plural = f"of {', '.join(self.bound.names)}"
        several = f"{self.length} {plural}" if self.length else f"one or more {plural}"
        return f"{several} or none" if self.optional else several


def show(value: object) -> str:
    """A value as people write it, in double quotes if it is text, and never longer than a line."""
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, str):
        return f'"{brief(value)}"'
    if isinstance(value, tuple | list):
        return "[" + ", ".join(show(member) for member in value[:8]) + "]"
    return str(value)[:80]
