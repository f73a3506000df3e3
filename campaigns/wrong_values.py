"""Values that a setting cannot have: of another type, or outside its range.

Each is given as Python, as TOML and as words of a command line; None where one cannot say it.
"""

import datetime
import math
from dataclasses import dataclass
from typing import Any

from lanewise.fields.ranges import Between, OneOf

HUGE = 10**400
TYPES = {int: "whole number", float: "number", bool: "true or false", str: "one of"}
"""What a message must call each type."""


@dataclass(frozen=True)
class Wrong:
    """A value that is wrong."""

    how: str
    """In words."""
    python: Any = None
    toml: str | None = None
    words: tuple[str, ...] | None = None
    kind: str = "wrong type"
    hint: tuple[tuple[str, ...], ...] = ()
    """Of each group, one text must stand in the message."""


def show(value):
    """As TOML and as a word."""
    if isinstance(value, bool):
        return "true" if value else "false"
    return f'"{value}"' if isinstance(value, str) else repr(value)


def _plain(bound):
    return repr(bound).removesuffix(".0")


def right(value):
    """A right value, to stand behind a wrong name."""
    words = tuple(value) if isinstance(value, tuple | list) else (value,)
    listed = "[" + ", ".join(map(show, words)) + "]"
    toml = listed if isinstance(value, tuple | list) else show(value)
    spelt = tuple(show(word).strip('"') for word in words) or ("none",)
    return Wrong("right", list(value) if isinstance(value, tuple) else value, toml, spelt)


def wrong_types(kind):
    """Values of another type than a setting's."""
    if kind.length is not None:
        return _wrong_lists(kind)
    plural = kind.bound.names if isinstance(kind.bound, OneOf) else (TYPES[kind.type],)
    hint = tuple((word,) for word in plural)
    return [
        Wrong(how, python, toml, words, hint=hint) for how, python, toml, words in _other(kind.type)
    ]


def _other(kind):
    """(in words, Python, TOML, words) of values that are not of a single value's type."""
    yield "text", "many", '"many"', ("many",)
    yield "empty text", "", '""', None
    yield "a table", {"value": 1}, "{ value = 1 }", ("{value=1}",)
    yield "a date", datetime.date(2026, 11, 25), "2026-11-25", ("2026-11-25",)
    yield "none", None, None, ("null",)
    if kind is not str:
        yield "a list", [1], "[1]", ("[1]",)
    if kind is not bool:
        yield "a truth value", True, "true", ("true",)
    if kind is int:
        yield "a fraction", 2.5, "2.5", ("2.5",)
        yield "a float that is whole", 2.0, "2.0", ("2.0",)
        yield "an exponent", 1e3, "1e3", ("1e3",)
        yield "a comma in thousands", "1,000", '"1,000"', ("1,000",)
    if kind is float:
        yield "a decimal comma", "1,5", '"1,5"', ("1,5",)
        yield "a number with its unit", "10 m/s", '"10 m/s"', ("10m/s",)
    if kind is bool:
        yield "a number", 1, "1", ("1",)
        yield "yes", "yes", '"yes"', ("yes",)
        yield "truth as text", "True!", '"true"', ("on",)
    if kind is str:
        yield "a number", 3, "3", ("3",)
        yield "a list", ["one"], '["one"]', ("['one']",)


def _wrong_lists(kind):
    """Lists that are none, have another length, or hold something else."""
    noun = {int: "whole numbers", float: "numbers"}[kind.type]
    hint, member = ((noun,),), ((noun[:-1],),)
    found = [
        Wrong("one value for a list", 15, "15", None, hint=hint),
        Wrong("text for a list", "15 16", '"15 16"', None, hint=hint),
        Wrong("none for a list", None, None, ("null",), hint=((noun, noun[:-1]),)),
        Wrong("text in a list", ["a", "b"], '["a", "b"]', ("a", "b"), hint=member),
        Wrong("truth values", [True, True], "[true, true]", ("true", "true"), hint=member),
        Wrong("a list in a list", [[5], [6]], "[[5], [6]]", ("[5]", "[6]"), hint=member),
        Wrong("a table for a list", {"low": 5}, "{ low = 5 }", None, hint=hint),
    ]
    if kind.length:
        found.append(Wrong("too short", [15], "[15]", ("15",), hint=hint))
        found.append(Wrong("too long", [15] * 3, "[15, 15, 15]", None, hint=hint))
    if not kind.optional:
        found.append(Wrong("an empty list", [], "[]", None, hint=hint))
    return found


def out_of_range(kind):
    """Values of the right type beyond a setting's bounds, from just outside to absurd."""
    if not isinstance(bound := kind.bound, Between):
        return []
    hint = ((_plain(bound.low),), (_plain(bound.high),))
    return [
        Wrong(how, *_listed(kind, value, toml, word), "out of range", hint)
        for how, value, toml, word in _beyond(kind.type, bound)
    ]


def _beyond(kind, bound):
    """(in words, Python, TOML, word)."""
    below, above = _next(kind, bound.low, -1), _next(kind, bound.high, 1)
    for how, value in (
        ("just below", below),
        ("just above", above),
        ("far below", kind(-(10**12))),
        ("far above", kind(10**12)),
    ):
        yield how, value, repr(value), repr(value)
    yield "a whole number of 400 digits", HUGE, str(HUGE), str(HUGE)
    yield "a whole number of 5000 digits", 10**5000, None, "9" * 5000
    if kind is float:
        yield "1e400", math.inf, "1e400", "1e400"
        for text in ("nan", "inf", "-inf"):
            yield text, float(text), text, text


def _next(kind, bound, step):
    return bound + step if kind is int else math.nextafter(bound, step * math.inf)


def _listed(kind, value, toml, word):
    """The value itself, or as many of it as a list wants."""
    if kind.length is None:
        return value, toml, (word,)
    count = kind.length or 1
    text = None if toml is None else "[" + ", ".join([toml] * count) + "]"
    return [value] * count, text, (word,) * count
