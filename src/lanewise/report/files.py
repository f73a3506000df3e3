"""Writing result files whole or not at all."""

import os
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from lanewise.errors import LanewiseError
from lanewise.evaluation.episodes import Episodes
from lanewise.evaluation.metrics import to_csv


@contextmanager
def replacing(path: Path | str) -> Iterator[Path]:
    """Write beside, then rename: `path` is either the finished file or what it was before.

    Yields:
        A path in the same folder, with the same suffix, to write to.

    Raises:
        LanewiseError: if the file cannot be written (no room, no permission, a folder's name).
    """
    path = Path(path)
    beside = path.with_name(f".{path.stem}.{os.getpid()}{path.suffix}")
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


def check_suffix(path: Path | str, allowed: tuple[str, ...]) -> str:
    """The suffix of a path in lower case.

    Raises:
        LanewiseError: if it is none of the allowed ones.
    """
    suffix = Path(path).suffix.lower()
    if suffix not in allowed:
        raise LanewiseError(f"cannot write {path}: the name must end in {' or '.join(allowed)}")
    return suffix


def write_text(path: Path | str, text: str) -> None:
    """Write a text file as UTF-8."""
    with replacing(path) as beside:
        beside.write_text(text, encoding="utf-8", newline="\n")


def write_csv(path: Path | str, episodes: Episodes) -> None:
    """Write test episodes, one row each."""
    write_text(path, to_csv(episodes))
