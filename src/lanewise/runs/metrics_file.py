"""Metrics on disk: one JSON object a line, only ever appended.

No wall-clock time belongs here: a resumed run must write the same bytes as one never stopped.
"""

import hashlib
import json
import math
import os
from collections.abc import Mapping, Sequence
from itertools import count
from pathlib import Path
from typing import Any

from lanewise.errors import RunError
from lanewise.system import safe_io
from lanewise.system.folder_io import OpenFolder, begin_file, write_atomically

LEVEL = ("updates", "transitions", "epsilon", "loss", "mean_q")
FRESH = ("escape_rate", "success_rate", "accident_rate", "reward", "speed")
"""Figures of weights on validation starts by which no weights were chosen."""
COLUMNS = {
    "episode": (
        *("stage", "episode", "decision", "escaped", "success", "accident"),
        *("decisions", "reward", "timestep_reward", "speed"),
    ),
    "chunk": (
        *("stage", "chunk", "decisions", "episodes", *LEVEL),
        *("escape_rate", "success_rate", "accident_rate", "reward", "timestep_reward", "speed"),
        *("validation_escape_rate", "validation_success_rate", "validation_accident_rate"),
        *("validation_reward", "best_chunk", *(f"high_level_{name}" for name in LEVEL)),
    ),
    "weights": (
        *("stage", "rule", "kept_chunk", "last_chunk", "fresh_episodes"),
        *(f"{of}_{name}" for of in ("kept", "last") for name in FRESH),
    ),
}
"""Fields by kind of record, besides the kind itself."""
_LARGEST = 500_000_000
"""Bytes of a file; ours have a few hundred a line."""


class MetricsWriter:
    """Appends records to a file."""

    def __init__(self, folder: OpenFolder, name: str, resume_at: int | None = 0) -> None:
        """Begins the file, anew or with its first ``resume_at`` bytes; None keeps all whole lines.

        ``resume_at`` is its length by the `mark` of the checkpoint.
        """
        path = folder.path / name
        kept = _whole_lines(path, resume_at) if resume_at or os.path.lexists(path) else b""
        self._file = os.fdopen(begin_file(folder, name, kept), "ab")
        self._digest = hashlib.sha256(kept)

    def append(self, record: Mapping[str, Any]) -> None:
        """Write one record; numbers that are not finite become null."""
        line = json.dumps({name: _plain(value) for name, value in record.items()}, allow_nan=False)
        data = line.encode() + b"\n"
        self._file.write(data)
        self._digest.update(data)

    def sync(self) -> int:
        """Force everything to disk and return the length in bytes."""
        self._file.flush()
        os.fsync(self._file.fileno())
        return self._file.tell()

    def mark(self) -> dict[str, Any]:
        """The length and digest of the file, safely on disk, for `read_marked`."""
        return {"metrics_bytes": self.sync(), "metrics_sha256": self._digest.hexdigest()}

    def __enter__(self) -> "MetricsWriter":
        return self

    def __exit__(self, *_: object) -> None:
        self._file.close()


def read(path: Path, end: int | None = None, sha256: str | None = None) -> list[dict[str, Any]]:
    """The records in the first ``end`` bytes of a file, which must have the digest; None takes any.

    A last line cut short by a kill is left out.

    Raises:
        UnreadableError: the file cannot be read.
        RunError: it was cut short or altered, or a line is damaged.
    """
    data = _whole_lines(path, end)
    if sha256 is not None and hashlib.sha256(data).hexdigest() != sha256:
        raise RunError(f"{path} was altered after it was written")
    found = []
    for number, line in enumerate(data.splitlines(), 1):
        try:
            found.append(safe_io.parse_json(line))
        except ValueError as error:
            reason = f"line {number} is not valid JSON ({error})"
            raise RunError(f"{path} is damaged: {reason}") from error
    return found


def read_marked(path: Path, meta: Mapping[str, Any]) -> list[dict[str, Any]]:
    """The records up to a `MetricsWriter.mark` in ``meta``, which must be as they were written.

    Where the mark is at 0, the file may be missing.
    """
    length = meta["metrics_bytes"]
    return read(path, length, meta.get("metrics_sha256")) if length else []


def keep_copy(folder: OpenFolder, path: Path, end: int) -> Path | None:
    """Copy a metrics file of a folder that is about to be cut to its first ``end`` bytes.

    A stage whose checkpoints were lost begins anew, and its metrics are all that is left of it.
    Returns the copy, ``metrics-before-1.jsonl`` or the first number that is free, if there is one.
    """
    if not path.is_file() or path.stat().st_size <= end:
        return None
    places = (path.with_stem(f"{path.stem}-before-{number}") for number in count(1))
    place = next(place for place in places if not os.path.lexists(place))
    write_atomically(folder, {place.name: path.read_bytes()})
    return place


def settled_episode(chunks: Sequence[Mapping[str, Any]]) -> float | None:
    """Episodes at the record of kind ``chunk`` where a stage's epsilon has `settled_at`."""
    index = settled_at([chunk["epsilon"] for chunk in chunks])
    return None if index is None else float(chunks[index]["episodes"])


def settled_at(epsilon: Sequence[float | None]) -> int | None:
    """First record where epsilon is at its final value; None if it still falls in the last.

    An epsilon that is the same in all of them has settled before the first.
    """
    values = [math.inf if value is None else value for value in epsilon]
    final = next((value for value in reversed(values) if value < math.inf), -math.inf)
    first = next((at for at, value in enumerate(values) if value <= final + 1e-6), len(values))
    return first if first < len(values) - 1 else None


def _whole_lines(path: Path, end: int | None) -> bytes:
    """The whole lines up to a place, or all; what follows the last of all is left out."""
    data = safe_io.read_bytes(path, _LARGEST, links=False)
    if end is None:
        end = data.rfind(b"\n") + 1
    if len(data) < end:
        raise RunError(f"{path} is damaged: truncated: {len(data)} of {end} bytes")
    if data[:end][-1:] not in (b"", b"\n"):
        raise RunError(f"{path} is damaged: no line ends at byte {end}")
    return data[:end]


def _plain(value: Any) -> Any:
    """A value that JSON knows: array scalars become Python's own."""
    plain = value.item() if hasattr(value, "item") else value
    if isinstance(plain, float) and not math.isfinite(plain):
        return None
    return plain
