"""One process at a time writes into a folder. Imports no JAX."""

import fcntl
import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import IO

from lanewise.errors import RunError

NAME = "lock"
"""Of the file that is locked; it stays, empty, when the lock is given back."""


def acquire(path: Path, doing: str) -> IO[bytes]:
    """Locks a folder; closing the file, or the end of the process, gives the lock back.

    Args:
        path: the folder.
        doing: what the other process would be doing there, for the message.

    Raises:
        RunError: another process holds it.
    """
    # Neither a link nor a pipe of this name may be followed or waited for.
    flags = os.O_WRONLY | os.O_CREAT | os.O_APPEND | os.O_NOFOLLOW | os.O_NONBLOCK
    lock = os.fdopen(os.open(path / NAME, flags, 0o644), "ab")
    try:
        fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        lock.close()
        raise RunError(f"{path} is in use: another process is {doing} in it") from None
    return lock


@contextmanager
def held(path: Path, doing: str) -> Iterator[None]:
    """Keeps a folder locked for a while, and makes it first.

    Raises:
        RunError: another process holds it.
    """
    path.mkdir(parents=True, exist_ok=True)
    with acquire(path, doing):
        yield
