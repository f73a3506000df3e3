"""The errors Lanewise reports to people: one or two lines, what is wrong and what to do."""

import shlex
import unicodedata
from collections.abc import Sequence
from typing import Any

_STEERING = ("Cc", "Cf", "Cs", "Zl", "Zp")
_JOINERS = "\u200c\u200d"
"""Format characters without which some scripts cannot be written; they steer nothing."""


class LanewiseError(Exception):
    """A mistake that the user can correct; the command line prints it and exits with code 2.

    A message may quote an untrusted file: its text holds no control characters for a terminal.
    """

    def __str__(self) -> str:
        return printable(super().__str__())


class SettingsError(LanewiseError):
    """A setting is unknown, of the wrong type, out of range, or contradicts another."""


class RunError(LanewiseError):
    """A run folder is missing, in use, unfinished, or made with other settings."""


class CheckpointError(LanewiseError):
    """A stored file is missing, truncated, altered, or not what its manifest says."""


class ActionError(LanewiseError, ValueError):
    """There is no such action. It is also a ValueError, as Gymnasium's environments raise."""


class NumbersError(LanewiseError):
    """A number that must be finite is not: an observation, a reward, a loss or a weight."""

    def __init__(self, message: str, found: Sequence[Any] = ()) -> None:
        super().__init__(message)
        self.found = found
        """All that was not finite (`training.finite_checks.Finding`), likely causes first."""


def printable(text: str) -> str:
    r"""A text with everything spelled out that would steer a terminal or turn writing around.

    Control and format characters, halves of surrogate pairs and line separators become escapes
    such as ``\x1b``; line feeds stay.
    """
    if text.isascii() and text.replace("\n", "").isprintable():
        return text
    return "".join(map(_spelled, text))


def one_line(value: object) -> str:
    """A text as `printable`, line feeds spelled out as well."""
    return printable(str(value)).replace("\n", "\\n")


def brief(value: object) -> str:
    """What a file calls something, on one line and short enough to be quoted in a message."""
    return one_line((value if isinstance(value, str) else repr(value))[:80])


def shell_line(*words: object) -> str:
    """A command to be typed or pasted, on one line."""
    return " ".join(shlex.quote(one_line(word)) for word in words)


def _spelled(char: str) -> str:
    if char in ("\n", *_JOINERS) or unicodedata.category(char) not in _STEERING:
        return char
    return char.encode("unicode_escape").decode()
