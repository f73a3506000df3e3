"""Folders that one process writes into: locked, and never half a file. Imports no JAX.

A folder is held by its descriptor and not by its name. A writer whose folder was moved, removed or
replaced therefore notices before it writes, and writes into no other folder.
"""

import fcntl
import os
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path, PurePath

from lanewise.errors import RunError

PARTIAL = ".partial"
"""Ending of files that are not complete yet."""


class OpenFolder:
    """An open folder: files are opened, renamed and deleted relative to its ``descriptor``."""

    def __init__(self, path: Path) -> None:
        """Open a folder; an OSError if it does not exist."""
        self.path = path
        """Its name when it was opened."""
        self.descriptor = os.open(path, os.O_RDONLY | os.O_DIRECTORY)
        """For functions of `os` that take ``dir_fd``."""
        self._root = self
        """The outermost open folder, whose name is compared."""

    @contextmanager
    def inside(self, name: str | PurePath) -> Iterator["OpenFolder"]:
        """Open a folder in this one, made with its parents where they are missing."""
        self.require_same()
        with self.duplicate() as inner:
            inner.path = self.path / name
            for part in PurePath(name).parts:
                with suppress(FileExistsError):
                    os.mkdir(part, dir_fd=inner.descriptor)
                outer = inner.descriptor
                inner.descriptor = os.open(part, os.O_RDONLY | os.O_DIRECTORY, dir_fd=outer)
                os.close(outer)
            yield inner

    def duplicate(self) -> "OpenFolder":
        """The same folder opened once more, to be locked and closed by itself."""
        copy = object.__new__(OpenFolder)
        copy.path, copy._root = self.path, self._root
        copy.descriptor = os.open(".", os.O_RDONLY | os.O_DIRECTORY, dir_fd=self.descriptor)
        return copy

    @classmethod
    def same(cls, path: Path, status: os.stat_result) -> "OpenFolder":
        """Open a folder that another process holds, by its ``status``; raises as `require_same`."""
        with suppress(FileNotFoundError, NotADirectoryError):
            folder = cls(path)
            if os.path.samestat(folder.status, status):
                return folder
            folder.close()
        raise _gone(path)

    @property
    def status(self) -> os.stat_result:
        """Which folder it is."""
        return os.fstat(self.descriptor)

    def require_same(self) -> None:
        """Raise a RunError where the name no longer leads here; called before each write."""
        root = self._root
        with suppress(FileNotFoundError, NotADirectoryError):
            if os.path.samestat(os.stat(root.path), root.status):
                return
        raise _gone(root.path)

    def unlink(self, name: str) -> None:
        """Delete a file in it, if there is one."""
        with suppress(FileNotFoundError):
            os.unlink(name, dir_fd=self.descriptor)

    def close(self) -> None:
        """Close it and release its lock if it has one; closing twice does nothing."""
        if self.descriptor >= 0:
            os.close(self.descriptor)
            self.descriptor = -1

    def __enter__(self) -> "OpenFolder":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


def _gone(path: Path) -> RunError:
    return RunError(
        f"{path} was moved, removed or replaced; nothing more is written\n"
        "  a folder that was moved can be continued under its new name"
    )


def lock(place: Path | OpenFolder, doing: str) -> OpenFolder:
    """Lock a folder, made if it is only named and missing.

    Closing it, or the end of the process, releases the lock.

    The folder itself is locked. A lock file could be deleted, which would let another process in.

    Raises:
        RunError: another process is ``doing`` something in it, or its name leads elsewhere by now.
    """
    if isinstance(place, Path):
        place.mkdir(parents=True, exist_ok=True)
    folder = place.duplicate() if isinstance(place, OpenFolder) else OpenFolder(place)
    try:
        fcntl.flock(folder.descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        folder.require_same()
    except BaseException as error:
        folder.close()
        if isinstance(error, BlockingIOError):
            message = f"{folder.path} is in use: another process is {doing} in it"
            raise RunError(message) from None
        raise
    return folder


def write_atomically(folder: OpenFolder, contents: Mapping[str, bytes]) -> None:
    """Write files into a folder, all complete on disk before the first gets its name.

    They get their names one after the other, in the order given, so that the last one can vouch
    for the others. If a write fails, files that already had these names are unchanged.
    """
    folder.require_same()
    place = folder.descriptor
    try:
        for name, content in contents.items():
            _write(folder, name + PARTIAL, content)
    except OSError:
        for name in contents:
            folder.unlink(name + PARTIAL)
        raise
    for name in contents:
        os.replace(name + PARTIAL, name, src_dir_fd=place, dst_dir_fd=place)
    # The new names survive a power cut.
    os.fsync(place)


def begin_file(folder: OpenFolder, name: str, kept: bytes = b"") -> int:
    """A descriptor to append to a file that holds so far what is kept, and nothing else.

    It is a new file: a backup may hold the old one under another name, a hard link.
    """
    write_atomically(folder, {name: kept})
    return os.open(name, os.O_WRONLY | os.O_APPEND, dir_fd=folder.descriptor)


def publish(source: Path, target: OpenFolder, last: str) -> None:
    """Copy all files of ``source``, with the folders they lie in, into a folder.

    Files of the same names are replaced, others stay. Where the file ``last`` is, the others are.
    """
    found = sorted(source.iterdir(), key=lambda path: (path.is_file(), path.name == last))
    for path in found:
        if path.is_dir():
            with target.inside(path.name) as inner:
                write_atomically(inner, {each.name: each.read_bytes() for each in path.iterdir()})
    write_atomically(target, {path.name: path.read_bytes() for path in found if path.is_file()})


def _write(folder: OpenFolder, name: str, content: bytes) -> None:
    # A link left under this name would lead the write elsewhere.
    folder.unlink(name)
    flags = os.O_WRONLY | os.O_CREAT | os.O_EXCL
    descriptor = os.open(name, flags, 0o644, dir_fd=folder.descriptor)
    try:
        rest = memoryview(content)
        while rest:
            rest = rest[os.write(descriptor, rest) :]
        os.fsync(descriptor)
    except OSError as error:
        # The error of os.write names no file; the message should.
        raise OSError(error.errno, error.strerror, str(folder.path / name)) from error
    finally:
        os.close(descriptor)
