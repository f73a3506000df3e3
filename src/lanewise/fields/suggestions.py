"""Names people mistype: look one up, or say which known one comes nearest."""

import difflib
import re
from collections.abc import Iterable, Mapping
from typing import TypeVar

from lanewise.errors import SettingsError, brief

T = TypeVar("T")
_SEPARATORS = re.compile(r"[^a-z0-9]+")
_LONGEST = 80
"""Of a name worth a hint: comparing takes time with the square of its length."""


def look_up(what: str, name: object, table: Mapping[str, T]) -> T:
    """Returns ``table[name]``, or says which name comes nearest."""
    if not isinstance(name, str):
        known = ", ".join(table)
        raise SettingsError(f"{what}: expected text, one of {known}, got {str(name)[:80]}")
    if name in table:
        return table[name]
    hint = nearest(name, table)
    raise SettingsError(f'unknown {what} "{brief(name)}"; {hint or "known: " + ", ".join(table)}')


def nearest(name: str, known: Iterable[str]) -> str:
    """A hint with the known name nearest to a wrong one, or nothing.

    In this order: the same letters, whatever stands between them; the same last word in whatever
    section; the same words of the last name in another order; a name spelt alike; a last name spelt
    alike.
    """
    if len(name) > _LONGEST:
        return ""
    options = list(known)
    for same in (_letters, _last, _words):
        wanted = same(name)
        found = [option for option in options if same(option) == wanted]
        if found:
            return _did_you_mean(name, found)
    full = {option.replace("-", "_").lower(): option for option in options}
    wanted = name.replace("-", "_").lower()
    close = difflib.get_close_matches(wanted, full, n=1, cutoff=0.75)
    if close:
        return _did_you_mean(name, [full[close[0]]])
    leaves: dict[str, list[str]] = {}
    for option, original in full.items():
        leaves.setdefault(option.rpartition(".")[2], []).append(original)
    close = difflib.get_close_matches(wanted.rpartition(".")[2], leaves, n=1, cutoff=0.75)
    if close:
        return _did_you_mean(name, leaves[close[0]])
    close = difflib.get_close_matches(wanted, full, n=1, cutoff=0.5)
    return _did_you_mean(name, [full[close[0]]]) if close else ""


def _did_you_mean(name: str, options: list[str]) -> str:
    """The options most like a name first; three suffice."""
    matcher = difflib.SequenceMatcher(a="", b=name.replace("-", "_").lower())
    alike = sorted(options, key=lambda option: -_likeness(matcher, option))
    return "did you mean " + " or ".join(alike[:3]) + "?"


def _likeness(matcher: "difflib.SequenceMatcher[str]", option: str) -> float:
    matcher.set_seq1(option.replace("-", "_"))
    return matcher.ratio()


def _letters(name: str) -> str:
    return _SEPARATORS.sub("", name.lower())


def _last(name: str) -> str:
    return _letters(name.rpartition(".")[2])


def _words(name: str) -> list[str]:
    return sorted(_SEPARATORS.split(name.rpartition(".")[2].lower()))
