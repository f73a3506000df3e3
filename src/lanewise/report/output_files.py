"""Writing result files whole or not at all."""

import os
import tempfile
import zlib
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from lanewise.errors import LanewiseError
from lanewise.runs.run_folder import require_outside


@contextmanager
def replacing(path: Path | str) -> Iterator[Path]:
    """Write to the hidden path yielded, then rename: the file is whole, or as it was before.

    Raises:
        LanewiseError: if the file cannot be written, or belongs to a run.
    """
    path = Path(path)
    require_outside(path)
    # Its whole name with anything more may be too long. Some packages tell a format by the suffix.
    name = f"{zlib.crc32(os.fsencode(path.name)):08x}.{os.getpid()}"
    beside = path.with_name(f".{name}{path.suffix if len(path.suffix) < 10 else ''}")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        yield beside
        beside.replace(path)
    except OSError as error:
        # A video encoder's error is its whole log; the first line says enough.
        reason = error.strerror or (str(error).splitlines() or ["unknown reason"])[0]
        raise LanewiseError(f"cannot write {path}: {reason}") from error
    finally:
        with suppress(OSError):  # gone already, or never there
            beside.unlink()


def check_writable(*paths: Path | str, new: bool = False) -> None:
    """Refuses files that cannot be written, before the work whose results they are to hold.

    With ``new`` also those that are there already.
    """
    places = [Path(path).absolute().parent.resolve() / Path(path).name for path in paths]
    for path, place in zip(map(Path, paths), places, strict=True):
        if places.count(place) > 1:
            raise LanewiseError(f"{path} is named for two results; give each its own file")
        require_outside(path)
        if new and os.path.lexists(path):
            raise LanewiseError(f"{path} exists; choose another file")
        # Path's own function fails where a name is too long.
        if os.path.isdir(path):
            raise LanewiseError(f"cannot write {path}: a folder has that name")
        try:
            with suppress(FileNotFoundError):
                path.lstat()  # fails where a name is too long
            # Its folder may have to be made. Permissions alone do not tell: try.
            folder = next(parent for parent in path.absolute().parents if parent.exists())
            tempfile.TemporaryFile(dir=folder).close()
        except OSError as error:
            raise LanewiseError(f"cannot write {path}: {error.strerror}") from error


def write_text(path: Path | str, text: str) -> None:
    """Write a text file as UTF-8."""
    with replacing(path) as beside:
        beside.write_text(text, encoding="utf-8", newline="\n")
