"""The errors Lanewise reports to people: one or two lines, what is wrong and what to do."""

from typing import Any


class LanewiseError(Exception):
    """A mistake the user can mend; the command line prints its message and exits with code 2."""


class SettingsError(LanewiseError):
    """A setting is unknown, of the wrong type, out of range, or contradicts another."""


class RunError(LanewiseError):
    """A run folder is missing, in use, unfinished, or made with other settings."""


class CheckpointError(LanewiseError):
    """A stored file is missing, truncated, altered, or not what its manifest says."""


class NumbersError(LanewiseError):
    """A number that must be finite is not: in what is seen or paid, in a loss or in weights."""

    def __init__(self, message: str, found: tuple[dict[str, Any], ...] = ()) -> None:
        super().__init__(message)
        self.found = found
        """All that was not finite, likely causes first; plain values, as they are stored."""
