"""Names people mistype: look one up, or say which known one comes nearest."""

import difflib
from collections.abc import Iterable, Mapping
from typing import TypeVar

from lanewise.errors import SettingsError, brief

T = TypeVar("T")
_LONGEST = 80
"""Of a name worth a hint: comparing takes time with the square of its length."""


def look_up(what: str, name: str, table: Mapping[str, T]) -> T:
    """Returns ``table[name]``, or says which name comes nearest."""
    if name in table:
        return table[name]
    hint = nearest(name, table)
    raise SettingsError(f'unknown {what} "{brief(name)}"; {hint or "known: " + ", ".join(table)}')


def nearest(name: str, known: Iterable[str]) -> str:
    """A hint with the known name nearest to a wrong one, or nothing.

    Dashes and underscores are equal, and a name may be given without its sections: the last
    word alone finds the setting too.
    """
    if len(name) > _LONGEST:
        return ""
    full = {option.replace("-", "_"): option for option in known}
    wanted = name.replace("-", "_").lower()
    close = difflib.get_close_matches(wanted, full, n=1, cutoff=0.75)
    if close:
        return f"did you mean {full[close[0]]}?"
    leaves: dict[str, list[str]] = {}
    for option, original in full.items():
        leaves.setdefault(option.rpartition(".")[2], []).append(original)
    close = difflib.get_close_matches(wanted.rpartition(".")[2], leaves, n=1, cutoff=0.75)
    if close:
        # The same word may stand in several sections; the most alike comes first, three suffice.
        alike = difflib.SequenceMatcher(a="", b=wanted)
        options = sorted(leaves[close[0]], key=lambda option: -_likeness(alike, option))
        return "did you mean " + " or ".join(options[:3]) + "?"
    close = difflib.get_close_matches(wanted, full, n=1, cutoff=0.5)
    return f"did you mean {full[close[0]]}?" if close else ""


def _likeness(matcher: difflib.SequenceMatcher[str], option: str) -> float:
    matcher.set_seq1(option.replace("-", "_"))
    return matcher.ratio()
