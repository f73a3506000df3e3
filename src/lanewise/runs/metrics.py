"""Metrics on disk: one JSON object a line, only ever appended.

No wall-clock time belongs here: a resumed run must write the same bytes as one never stopped.
"""

import json
import math
import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from types import TracebackType
from typing import Any

import numpy as np

from lanewise.errors import RunError


class MetricsWriter:
    """Appends records to a file; ``sync`` says how many bytes are safely on disk."""

    def __init__(self, path: Path, resume_at: int | None = 0) -> None:
        """Opens the file and cuts it to its first ``resume_at`` bytes.

        Args:
            path: The file.
            resume_at: The length that ``sync`` returned before the checkpoint was saved; 0 for a
                fresh file, None to keep every whole line that is there (timings).

        Raises:
            RunError: The file is shorter than that.
        """
        self._file = path.open("ab")
        size = self._file.tell()
        if resume_at is None:
            resume_at = len(_whole_lines(path))
        if size < resume_at:
            self._file.close()
            raise RunError(f"{path} is truncated: {size} bytes, the checkpoint expects {resume_at}")
        self._file.truncate(resume_at)
        self._file.seek(0, os.SEEK_END)

    def append(self, record: Mapping[str, Any]) -> None:
        """Writes one record; numbers that are not finite become null."""
        line = json.dumps({name: _plain(value) for name, value in record.items()}, allow_nan=False)
        self._file.write(line.encode() + b"\n")

    def sync(self) -> int:
        """Forces everything to disk and returns the length in bytes."""
        self._file.flush()
        os.fsync(self._file.fileno())
        return self._file.tell()

    def close(self) -> None:
        """Closes the file."""
        self._file.close()

    def __enter__(self) -> "MetricsWriter":
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()


def read(path: Path) -> list[dict[str, Any]]:
    """The records of a metrics file; a last line cut short by a kill is left out."""
    try:
        return [json.loads(line) for line in _whole_lines(path).splitlines()]
    except ValueError as error:
        raise RunError(f"{path} is damaged: a line is not valid JSON") from error


def settled_episode(chunks: Sequence[Mapping[str, Any]]) -> float | None:
    """Episodes that had ended when epsilon reached its final value; None if it never did.

    Args:
        chunks: one stage's records of kind ``chunk``, with ``epsilon`` and ``episodes``.
    """
    index = settled_at([chunk["epsilon"] for chunk in chunks])
    return None if index is None else float(chunks[index]["episodes"])


def settled_at(epsilon: Sequence[float | None]) -> int | None:
    """First record where epsilon is at its final value; None if it is still falling in the last.

    An epsilon that is the same in all of them has settled before the first.
    """
    values = np.array([math.nan if value is None else value for value in epsilon], np.float64)
    known = values[~np.isnan(values)]
    if not len(known):
        return None
    first = int(np.flatnonzero(values <= known[-1] + 1e-6)[0])
    return first if first < len(values) - 1 else None


def _whole_lines(path: Path) -> bytes:
    """What is there, without a last line that a kill or a full disk has cut short."""
    content = path.read_bytes()
    return content[: content.rfind(b"\n") + 1]


def _plain(value: Any) -> Any:
    """A value that JSON knows: array scalars become Python's own."""
    plain = value.item() if hasattr(value, "item") else value
    if isinstance(plain, float) and not math.isfinite(plain):
        return None
    return plain
