"""One process at a time writes into a folder. Imports no JAX."""

import fcntl
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from lanewise.errors import RunError
from lanewise.runs.files import OpenFolder

OLD = "lock"
"""A file that earlier versions locked; it may still lie in a folder, and means nothing."""


def acquire(place: Path | OpenFolder, doing: str) -> OpenFolder:
    """Locks a folder; closing it, or the end of the process, gives the lock back.

    The folder itself is locked: there is no file that could be deleted to let another process in.

    Args:
        place: the folder, by its name or opened already.
        doing: what the other process would be doing there, for the message.

    Raises:
        RunError: another process holds it, or its name leads elsewhere by now.
    """
    folder = place.again() if isinstance(place, OpenFolder) else OpenFolder(place)
    try:
        fcntl.flock(folder.descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        folder.require_same()
    except BaseException as error:
        folder.close()
        if isinstance(error, BlockingIOError):
            said = f"{folder.path} is in use: another process is {doing} in it"
            raise RunError(said) from None
        raise
    return folder


@contextmanager
def held(path: Path, doing: str) -> Iterator[OpenFolder]:
    """Keeps a folder locked for a while, and makes it first.

    Raises:
        RunError: another process holds it.
    """
    path.mkdir(parents=True, exist_ok=True)
    with acquire(path, doing) as folder:
        yield folder
