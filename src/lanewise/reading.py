"""Reading files that may come from a stranger: nothing is followed, waited for or run.

A file is read only if it is a regular one of a size that makes sense; JSON and TOML only if they
say one thing and say it plainly. Imports no JAX.
"""

import hashlib
import json
import math
import os
import re
import stat
import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from lanewise.errors import LanewiseError, brief
from lanewise.version import __version__

_DEEPEST = 32
"""Lists and objects inside one another; ours need 4."""
_DIGITS, _ENDLESS = re.compile(rb"[0-9_]+"), 4000
"""A number, and how many digits are out of every range."""
_MOST_DOTS = 32
"""In a line of TOML. Reading a dotted key takes time with the square of its parts."""


class UnreadableError(LanewiseError):
    """A file cannot be read, and its message is why; whoever asked for it says which it is."""


def contents(path: Path, largest: int, *, links: bool = True) -> bytes:
    """The bytes of a regular file.

    Args:
        path: of the file.
        largest: bytes; a larger file is not read at all.
        links: whether the file's name may be a link. What a person names may be; a file that a
            stranger has put beside others may not, as it would lead elsewhere.

    Raises:
        UnreadableError: it is missing, no regular file, too large, or cannot be read.
    """
    # Without O_NONBLOCK a pipe would be waited for.
    flags = os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC | (0 if links else os.O_NOFOLLOW)
    try:
        _check_regular(path.stat() if links else path.lstat())
        with os.fdopen(os.open(path, flags), "rb") as file:
            status = os.fstat(file.fileno())
            _check_regular(status)
            if status.st_size > largest:
                raise UnreadableError(f"too large: larger than {largest} bytes")
            # Some files say that they are empty and are not.
            data = file.read(status.st_size + 1)
    except OSError as cause:
        raise UnreadableError(cause.strerror or str(cause)) from cause
    if len(data) != status.st_size:
        raise UnreadableError("not a regular file: its length is not what it says")
    return data


def _check_regular(status: os.stat_result) -> None:
    if stat.S_ISDIR(status.st_mode):
        raise UnreadableError("Is a directory, not a regular file")
    if not stat.S_ISREG(status.st_mode):
        kind = "a link" if stat.S_ISLNK(status.st_mode) else "a pipe or a device"
        raise UnreadableError(f"{kind}, not a regular file")


def require_plain(path: Path, *, folder: bool = False) -> None:
    """Refuse what is there under a name unless it is a regular file, or a folder; or nothing.

    Raises:
        UnreadableError: it is a link, a pipe, a device, or the other of the two.
    """
    try:
        status = path.lstat()
    except FileNotFoundError:
        return
    except OSError as cause:
        raise UnreadableError(cause.strerror or str(cause)) from cause
    if not folder:
        _check_regular(status)
    elif not stat.S_ISDIR(status.st_mode):
        raise UnreadableError("not a folder")


def json_value(data: bytes) -> Any:
    """What a JSON text says, in UTF-8 and plainly: no name twice, no number that is none.

    Raises:
        ValueError: it is no JSON, says something twice, holds NaN or an infinity, or is nested
            deeper than anything of ours.
    """
    try:
        found = json.loads(
            data.decode("utf-8"),
            object_pairs_hook=_once,
            parse_constant=_finite,
            parse_float=_finite,
        )
    except RecursionError:
        raise ValueError("nested too deeply") from None
    _check_depth(found)
    return found


def toml_table(data: bytes) -> dict[str, Any]:
    """What a TOML text says.

    Raises:
        ValueError: it is no TOML, or such as would take long to read.
    """
    try:
        text = data.decode("utf-8")
        # A line of TOML ends with a line feed alone, and so a key may run on over any other end.
        if any(line.count(".") > _MOST_DOTS for line in text.split("\n")):
            raise ValueError(f"a line has more than {_MOST_DOTS} dots")
        return tomllib.loads(text)
    except UnicodeDecodeError as cause:
        raise ValueError("not UTF-8 text") from cause
    except (ValueError, RecursionError) as cause:
        if name := _endless(data):
            raise ValueError(
                f"{name}: a whole number of so many digits is out of every range"
            ) from cause
        raise ValueError(" ".join(str(cause).split())[:120]) from cause


def other_format(document: Any, name: str, version: int) -> str:
    """Says which format a document is of, if it is not the one that is wanted; otherwise nothing.

    Args:
        document: what was read; where it names no format or version, it is of ``name`` or of the
            first version.
        name: the wanted format.
        version: the wanted version of it.
    """
    if not isinstance(document, dict):
        return ""
    found, number = document.get("format", name), document.get("version", 1)
    if found == name and type(number) is int and number == version:
        return ""
    called = "format version" if found == name else f"format {brief(found)} version"
    by = f", written by lanewise {brief(document['lanewise'])}" if "lanewise" in document else ""
    wanted = version if found == name else f"{name} version {version}"
    return (
        f"has {called} {brief(number)}{by}; this lanewise ({__version__}) reads {wanted}: "
        "use the one that wrote it, or a newer one"
    )


def _endless(data: bytes) -> str:
    """What a line of TOML sets to a number of thousands of digits; empty where none does."""
    for number in _DIGITS.finditer(data):
        if number.end() - number.start() >= _ENDLESS:
            line = data[data.rfind(b"\n", 0, number.start()) + 1 : number.start()]
            name, equals, _ = line.partition(b"=")
            return name.decode("utf-8", "replace").strip()[:80] if equals else ""
    return ""


def digest(document: Mapping[str, Any], field: str = "digest") -> str:
    """SHA-256 over everything in a document but the field that is to hold it."""
    rest = {name: value for name, value in document.items() if name != field}
    return hashlib.sha256(json.dumps(rest, sort_keys=True).encode()).hexdigest()


def _once(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    found = dict(pairs)
    if len(found) != len(pairs):
        raise ValueError("a name is given twice")
    return found


def _finite(word: str) -> float:
    value = float(word)
    if not math.isfinite(value):
        raise ValueError("a number is not finite")
    return value


def _check_depth(value: Any) -> None:
    level = [value]
    for _ in range(_DEEPEST):
        level = [inner for outer in level for inner in _members(outer)]
        if not level:
            return
    raise ValueError("nested too deeply")


def _members(value: Any) -> Any:
    if isinstance(value, dict):
        return value.values()
    return value if isinstance(value, list) else ()
