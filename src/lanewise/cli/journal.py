"""What a sweep has done so far, in memory and in a file that is written anew with every result."""

import os
from collections.abc import Callable
from dataclasses import asdict, dataclass, field
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from lanewise.errors import RunError
from lanewise.evaluation.cells import CellOutcome, Reach
from lanewise.runs.run_folder import require_outside
from lanewise.system import folder_io, safe_io
from lanewise.system.folder_io import PARTIAL, OpenFolder, write_atomically

FORMAT, VERSION = "lanewise-sweep", 1
_LARGEST = 1_000_000_000


@dataclass
class Journal:
    """What is done so far."""

    folder: OpenFolder
    """Locked; closing it gives it back."""
    name: str
    """Of the file."""
    identity: dict[str, Any]
    """What must be the same for it to be continued."""
    reached: list[Reach] = field(default_factory=list)
    outcomes: list[CellOutcome] = field(default_factory=list)

    def add(self, found: list[Reach] | list[CellOutcome]) -> None:
        """Keep some results; a kill loses only what comes after."""
        for result in found:
            kept: list[Any] = self.reached if isinstance(result, Reach) else self.outcomes
            kept.append(result)
        self.save()

    def save(self) -> None:
        """Write the file."""
        done = {
            "sweep": self.identity,
            "reached": list(map(asdict, self.reached)),
            "outcomes": list(map(asdict, self.outcomes)),
        }
        text = safe_io.document(FORMAT, VERSION, done)
        write_atomically(self.folder, {self.name: text})

    def publish(self, write: Callable[[str], Path]) -> Path:
        """Move what ``write`` writes into a folder into the journal's, and delete the journal.

        ``write`` returns the page, which comes last; this returns where it is now.
        """
        with TemporaryDirectory(prefix="lanewise-map-") as drawn:
            page = write(drawn).name
            folder_io.publish(Path(drawn), self.folder, last=page)
        self.folder.unlink(self.name)
        return self.folder.path / page


def open_(path: Path, identity: dict[str, Any]) -> Journal:
    """The journal of a sweep in a file, continued if it has this ``identity``, or begun.

    Raises:
        RunError: the folder is in use or holds something else, or the journal is damaged.
    """
    journal = Journal(folder_io.lock(path.parent, "sweeping"), path.name, identity)
    try:
        # The command has looked already; another process may have begun before the lock was had.
        if check_place(path):
            journal.reached, journal.outcomes = read(path, identity)
        else:
            journal.save()
    except BaseException:
        journal.folder.close()
        raise
    return journal


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


def read(path: Path, identity: dict[str, Any]) -> tuple[list[Reach], list[CellOutcome]]:
    """The results in a journal; changes nothing.

    Raises:
        RunError: it is the journal of another sweep, or damaged.
    """
    try:
        done = safe_io.read_document(path, FORMAT, VERSION, _LARGEST)
    except safe_io.UnreadableError as error:
        raise RunError(f"{error}; remove it to begin anew") from error
    if done["sweep"] != identity:
        raise RunError(
            f"{path.parent} holds another sweep: continue with its options, or choose another"
        )
    reached = [Reach(**each) for each in done["reached"]]
    return reached, [CellOutcome(**each) for each in done["outcomes"]]
