"""Writing files so that a kill or a full disk never leaves half of one."""

import os
from collections.abc import Mapping
from pathlib import Path

PARTIAL = ".partial"
"""Ending of files that are not complete yet."""


def write_atomically(directory: Path, contents: Mapping[str, bytes]) -> None:
    """Writes files into a directory, all complete on disk before the first gets its name.

    They get their names one after the other, in the order given, so the last one can vouch for
    the others.

    Raises:
        OSError: A write failed; files that already had these names are unchanged.
    """
    try:
        for name, content in contents.items():
            _write(directory / (name + PARTIAL), content)
    except OSError:
        for name in contents:
            (directory / (name + PARTIAL)).unlink(missing_ok=True)
        raise
    for name in contents:
        os.replace(directory / (name + PARTIAL), directory / name)
    _sync_directory(directory)


def _write(path: Path, content: bytes) -> None:
    # A link left under this name would lead the write elsewhere.
    path.unlink(missing_ok=True)
    descriptor = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o644)
    try:
        rest = memoryview(content)
        while rest:
            rest = rest[os.write(descriptor, rest) :]
        os.fsync(descriptor)
    except OSError as error:
        # os.write does not know the name; whoever reads the message should.
        raise OSError(error.errno, error.strerror, str(path)) from error
    finally:
        os.close(descriptor)


def _sync_directory(directory: Path) -> None:
    """Makes the new names survive a power cut."""
    descriptor = os.open(directory, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)
