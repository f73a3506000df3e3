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
from typing import IO, Any

from lanewise.errors import CheckpointError, RunError, brief
from lanewise.system import safe_io
from lanewise.system.folder_io import OpenFolder, opened, write_atomically

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
_OPTIONAL = ("validation_", "best_chunk", "high_level_")
"""Beginnings of fields that only some chunks have."""
_TEXTS = ("kind", "stage", "accident", "rule")
_LARGEST = 500_000_000
"""Bytes of a file; ours have a few hundred a line."""
_BLOCK = 65_536


class MetricsWriter:
    """Appends records to a file."""

    def __init__(
        self, path: Path, resume_at: int | None = 0, folder: OpenFolder | None = None
    ) -> None:
        """Opens the file and cuts it to its first ``resume_at`` bytes.

        Args:
            path: the file.
            resume_at: its length by the `mark` of the checkpoint; 0 for a fresh file, None to keep
                every whole line (timings).
            folder: the folder it lies in, open; None opens it.
        """
        self._file = _open_to_append(path, folder)
        size = self._file.tell()
        if resume_at is None:
            resume_at = _end_of_lines(self._file, path, size)
        if size < resume_at:
            self._file.close()
            raise RunError(f"{path} is truncated: {size} bytes, the checkpoint expects {resume_at}")
        self._file.truncate(resume_at)
        self._file.seek(0, os.SEEK_END)
        self._digest = hashlib.sha256()
        for start in range(0, resume_at, _BLOCK):
            self._digest.update(os.pread(self._file.fileno(), _BLOCK, start))

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
    """The lines of a file, objects of plain values; a last line cut short by a kill is left out.

    Args:
        path: the file.
        end: read no further than this many bytes; None reads all.
        sha256: digest that these bytes must have; None for any.

    Raises:
        RunError: the file cannot be read, was altered, or a line is no object of plain values.
    """
    data = _whole_lines(path, end)
    found = []
    for number, line in enumerate(data.splitlines(), 1):
        try:
            found.append(_record(line))
        except ValueError as error:
            reason = f"line {number} is not valid JSON of plain values ({error})"
            raise RunError(f"{path} is damaged: {reason}") from error
    if sha256 is not None and hashlib.sha256(data).hexdigest() != sha256:
        raise RunError(f"{path} was altered after it was written")
    return found


def read_records(
    path: Path, end: int | None = None, sha256: str | None = None
) -> list[dict[str, Any]]:
    """As `read`, each a record of a known kind with its fields."""
    found = read(path, end, sha256)
    for number, record in enumerate(found, 1):
        if problem := _problem(record):
            raise RunError(f"{path} is damaged: line {number} {problem}")
    return found


def read_marked(path: Path, meta: Mapping[str, Any]) -> list[dict[str, Any]]:
    """The records up to a `MetricsWriter.mark` in ``meta``, which must be as they were written.

    Where the mark is at 0, the file may be missing.
    """
    length, digest = (meta.get(name) for name in ("metrics_bytes", "metrics_sha256"))
    if type(length) is not int:
        raise CheckpointError(f"{path}: a manifest does not say how far it goes")
    return read_records(path, length, digest) if length else []


def keep_copy(path: Path, end: int, folder: OpenFolder | None = None) -> Path | None:
    """Copy a metrics file that is about to be cut to its first ``end`` bytes.

    A stage whose checkpoints were lost begins anew, and its metrics are all that is left of it.
    Returns the copy, ``metrics-before-1.jsonl`` or the first number that is free, if there is one.
    """
    if not path.is_file() or path.stat().st_size <= end:
        return None
    places = (path.with_stem(f"{path.stem}-before-{number}") for number in count(1))
    place = next(place for place in places if not os.path.lexists(place))
    write_atomically(folder or path.parent, {place.name: path.read_bytes()})
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


def _record(line: bytes) -> dict[str, Any]:
    record = safe_io.parse_json(line)
    if not isinstance(record, dict):
        raise ValueError("it is no object")
    for name, value in record.items():
        if not (value is None or isinstance(value, str | int | float)):
            raise ValueError(f"{brief(name)} is no plain value")
    return record


def _problem(record: Mapping[str, Any]) -> str:
    """What is wrong with a record; empty where nothing is."""
    kind = record.get("kind")
    if kind not in COLUMNS:
        return f"has a kind other than {', '.join(COLUMNS)}"
    for name in COLUMNS[kind]:
        if name not in record and not name.startswith(_OPTIONAL):
            return f"lacks {name}"
    for name, value in record.items():
        if name != "kind" and name not in COLUMNS[kind]:
            return f'has a field "{brief(name)}", which does not belong there'
        if isinstance(value, str) != (name in _TEXTS):
            return f"has a {name} of the wrong type"
    return ""


def _whole_lines(path: Path, end: int | None) -> bytes:
    """The whole lines up to a place, or all; what follows the last of all is left out."""
    try:
        data = safe_io.read_bytes(path, _LARGEST, links=False)
        if end is None:
            end = data.rfind(b"\n") + 1
        if len(data) < end:
            raise safe_io.UnreadableError(f"truncated: {len(data)} of {end} bytes")
        if data[:end][-1:] not in (b"", b"\n"):
            raise safe_io.UnreadableError(f"no line ends at byte {end}")
    except safe_io.UnreadableError as error:
        raise RunError(f"{path} is damaged: {error}") from error
    return data[:end]


def _open_to_append(path: Path, folder: OpenFolder | None) -> IO[bytes]:
    """Open a file that is no link, no pipe, and has no second name."""
    flags = os.O_RDWR | os.O_CREAT | os.O_APPEND | os.O_NOFOLLOW | os.O_NONBLOCK
    try:
        safe_io.require_plain(path)
    except safe_io.UnreadableError as error:
        raise RunError(f"cannot write {path}: {error}") from error
    with opened(folder or path.parent) as place:
        file = os.fdopen(os.open(path.name, flags, 0o644, dir_fd=place.descriptor), "ab")
    if os.fstat(file.fileno()).st_nlink > 1:
        file.close()
        raise RunError(
            f"cannot write {path}: another name leads to the same file (a hard link, as backups "
            "make them); copy the run and resume the copy"
        )
    return file


def _end_of_lines(file: IO[bytes], path: Path, size: int) -> int:
    """Where the last whole line ends, looked for from the end of the file."""
    tail = os.pread(file.fileno(), _BLOCK, max(0, size - _BLOCK))
    if b"\n" not in tail and size > _BLOCK:
        raise RunError(f"{path} is damaged: a line is longer than any record")
    return size - len(tail) + tail.rfind(b"\n") + 1


def _plain(value: Any) -> Any:
    """A value that JSON knows: array scalars become Python's own."""
    plain = value.item() if hasattr(value, "item") else value
    if isinstance(plain, float) and not math.isfinite(plain):
        return None
    return plain
