"""Safe reading of files that may come from a stranger: nothing is followed, awaited or run.

Only regular files of a bounded size are read. A document gets here the digest by which it is
checked when it is read. Imports no JAX.
"""

import hashlib
import json
import stat
import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from lanewise.errors import LanewiseError, brief
from lanewise.system.version import __version__

_MOST_DOTS = 32
"""In a line of TOML."""
_KINDS = {stat.S_IFDIR: "a folder", stat.S_IFLNK: "a link"}


class UnreadableError(LanewiseError):
    """A file cannot be read, or was altered; says which and why."""


def read_bytes(path: Path, largest: int, *, links: bool = True) -> bytes:
    """Read a regular file of at most ``largest`` bytes, or raise an UnreadableError.

    Its name may be a link if a person typed it (``links``), but not if the file lies beside others
    in a folder from elsewhere.
    """
    try:
        status = path.stat() if links else path.lstat()
        if not stat.S_ISREG(status.st_mode):
            kind = _KINDS.get(stat.S_IFMT(status.st_mode), "a pipe or a device")
            raise OSError(f"{kind}, not a regular file")
        if status.st_size > largest:
            raise OSError(f"too large: larger than {largest} bytes")
        with path.open("rb") as file:
            # Some special files report a length of 0 and yet hold something.
            data = file.read(status.st_size + 1)
        if len(data) != status.st_size:
            raise OSError("not a regular file: its length is not what it says")
    except OSError as cause:
        raise UnreadableError(f"cannot read {path}: {cause.strerror or cause}") from cause
    return data


def parse_json(data: bytes) -> Any:
    """Parse JSON; a ValueError too where it is nested too deeply."""
    try:
        return json.loads(data)
    except RecursionError:
        raise ValueError("nested too deeply") from None


def read_document(
    path: Path, name: str, version: int, largest: int, field: str = "digest"
) -> dict[str, Any]:
    """Read a JSON document that Lanewise wrote; one of its fields holds its `digest`.

    Raises:
        UnreadableError: it cannot be read, has another format or version, or was altered.
    """
    try:
        document = parse_json(read_bytes(path, largest, links=False))
    except ValueError as error:
        raise UnreadableError(f"{path} is damaged: not valid JSON") from error
    if not isinstance(document, dict) or "format" not in document:
        raise UnreadableError(f"{path} is not of the format {name}")
    if other := format_mismatch(document, name, version):
        raise UnreadableError(f"{path} {other}")
    if document.get(field) != digest(document, field):
        raise UnreadableError(f"{path} was altered: its digest is not its own")
    return document


def document(name: str, version: int, content: Mapping[str, Any], field: str = "digest") -> bytes:
    """A JSON document with its digest, as `read_document` reads it; a ValueError for NaN."""
    stored = {"format": name, "version": version, **content}
    whole = stored | {field: digest(stored, field)}
    return (json.dumps(whole, indent=1, allow_nan=False) + "\n").encode()


def parse_toml(data: bytes) -> dict[str, Any]:
    """Parse TOML in UTF-8; a ValueError says in one line what is wrong."""
    try:
        # To parse a key takes time with the square of its parts.
        if any(line.count(b".") > _MOST_DOTS for line in data.split(b"\n")):
            raise ValueError(f"a line has more than {_MOST_DOTS} dots")
        return tomllib.loads(data.decode("utf-8"))
    except UnicodeDecodeError as cause:
        raise ValueError("not UTF-8 text") from cause
    except (ValueError, RecursionError) as cause:
        raise ValueError(" ".join(str(cause).split())[:120]) from cause


def format_mismatch(document: Any, name: str, version: int) -> str:
    """How a document's format differs from the one of a name and version; empty if it does not.

    A document without ``format`` or ``version`` counts as of that name, and as version 1.
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


def digest(document: Mapping[str, Any], field: str = "digest") -> str:
    """SHA-256 of a document without the field that holds the digest."""
    rest = {name: value for name, value in document.items() if name != field}
    return hashlib.sha256(json.dumps(rest, sort_keys=True).encode()).hexdigest()
