"""What a sweep has done so far, in memory and on disk: a line a result, only ever appended.

Each line carries a digest of itself and of all lines before it, which shows damage and gaps.
"""

import hashlib
import json
import os
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import IO, Any

from lanewise.errors import RunError
from lanewise.evaluation.grid import PointResult, Reach
from lanewise.runs.run_folder import require_outside
from lanewise.system import folder_io, safe_io
from lanewise.system.folder_io import PARTIAL, OpenFolder, write_atomically

_LARGEST = 1_000_000_000
_KINDS: dict[str, type] = {"Reach": Reach, "PointResult": PointResult}


@dataclass
class Journal:
    """What is done so far."""

    reached: list[Reach]
    outcomes: list[PointResult]
    file: IO[str]
    digest: str
    """Of all lines so far; the first stands for what the sweep is."""
    folder: OpenFolder
    """Locked; closing it gives it back."""

    def add(self, found: list[Reach] | list[PointResult]) -> None:
        """Keep some results; a kill loses only what comes after."""
        self.folder.require_same()
        for result in found:
            kept: list[Any] = self.reached if isinstance(result, Reach) else self.outcomes
            kept.append(result)
            line = {"kind": type(result).__name__, **asdict(result)}
            self.digest = _digest(self.digest, line)
            self.file.write(json.dumps(line | {"digest": self.digest}) + "\n")
        self.file.flush()


def open_(path: Path, identity: dict[str, Any]) -> Journal:
    """The journal of a sweep in a file, continued if its first line is the ``identity``, or begun.

    Raises:
        RunError: the folder is in use or holds something else, or the journal is damaged.
    """
    out = path.parent
    check_place(path)
    folder = folder_io.lock(out, "sweeping")
    try:
        # Checked again: another process may have begun before this one had the lock.
        if not check_place(path):
            write_atomically(folder, {path.name: (json.dumps(identity) + "\n").encode()})
        kept, results, digest = read(path, identity)
        # What a kill has cut short is left out, here and on disk.
        file = folder_io.begin_file(folder, path.name, kept)
    except BaseException:
        folder.close()
        raise
    return Journal(
        reached=[result for result in results if isinstance(result, Reach)],
        outcomes=[result for result in results if isinstance(result, PointResult)],
        file=os.fdopen(file, "a", encoding="utf-8"),
        digest=digest,
        folder=folder,
    )


def check_place(path: Path) -> bool:
    """Whether a sweep has begun in a journal's folder; refuses one that holds something else."""
    out = path.parent
    require_outside(out)
    if os.path.lexists(path):
        return True
    # A kill while the journal was begun leaves only this.
    left = {path.name + PARTIAL}
    if out.exists() and (not out.is_dir() or set(os.listdir(out)) - left):
        raise RunError(f"{out} is not an empty folder and holds no sweep; choose another")
    return False


def read(path: Path, identity: dict[str, Any]) -> tuple[bytes, list[Reach | PointResult], str]:
    """(the whole lines of a journal, their results, the last one's digest); changes nothing.

    Raises:
        RunError: it is the journal of another sweep, or damaged.
    """
    try:
        content = safe_io.read_bytes(path, _LARGEST, links=False)
        content = content[: content.rfind(b"\n") + 1]
        if not content:
            raise ValueError("it holds no line")
        head, *lines = content.splitlines()
        if safe_io.parse_json(head) != identity:
            raise RunError(
                f"{path.parent} holds another sweep: continue with its options, or choose another"
            )
        digest, results = safe_io.digest(identity), []
        for line in lines:
            record = safe_io.parse_json(line)
            results.append(_result(record, digest))
            digest = record["digest"]
    except ValueError as error:
        raise RunError(f"{path} is damaged: remove it to begin anew ({error})") from error
    return content, results, digest


def _result(record: Any, before: str) -> Reach | PointResult:
    """Raises ValueError unless it is one, as it was written after the line before."""
    if not isinstance(record, dict) or record.get("digest") != _digest(before, record):
        raise ValueError("a line was altered, left out or moved")
    values = {name: value for name, value in record.items() if name not in ("kind", "digest")}
    result: Reach | PointResult = _KINDS[record["kind"]](**values)
    return result


def _digest(before: str, line: dict[str, Any]) -> str:
    """Of a line and all before it."""
    return hashlib.sha256((before + safe_io.digest(line)).encode()).hexdigest()[:16]
