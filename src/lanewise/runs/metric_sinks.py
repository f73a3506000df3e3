"""A run's metrics where people look: tables for spreadsheets, and TensorBoard's events if wanted.

Both are made of ``metrics.jsonl`` and hold nothing else. They are written anew when a run is
continued, so that nothing that a kill has undone stays in them.
"""

import csv
import os
import shutil
from collections.abc import Mapping
from contextlib import ExitStack
from typing import Any, Self

from lanewise.runs import metrics_file
from lanewise.runs.metrics_file import COLUMNS
from lanewise.system.extras import install, needed_for
from lanewise.system.folder_io import OpenFolder

TABLES = {"episode": "episodes.csv", "chunk": "chunks.csv"}
"""Tables by kind of record; a field that a record lacks is empty."""
TENSORBOARD = "tensorboard"
"""Folder of TensorBoard's events, in the run's."""
LABELS = {
    "reward": "reward_one_a_decision",
    "timestep_reward": "reward_one_a_second",
    "validation_reward": "validation_reward_one_a_second",
}
"""What TensorBoard calls the figures whose names do not say how they are counted."""
COUNTS = ("kind", "stage", "chunk")
"""Fields of a chunk that are no curves."""


class MetricSinks:
    """All sinks of a run; to be used in a ``with`` block."""

    def __init__(self, folder: OpenFolder, *, tensorboard: bool) -> None:
        """Opens them and gives them what the metrics file holds.

        Args:
            folder: of the run, its metrics file cut to what is safely stored.
            tensorboard: whether events are wanted; a run that has some goes on with them.

        Raises:
            LanewiseError: events are wanted and tensorboardX is not installed.
        """
        self._sinks: list[CsvTable | TensorBoardEvents] = []
        with ExitStack() as stack:
            for kind in TABLES:
                self._sinks.append(CsvTable(folder, kind))
                stack.callback(self._sinks[-1].close)
            if tensorboard or (folder.path / TENSORBOARD).exists():
                self._sinks.append(TensorBoardEvents(folder))
                stack.callback(self._sinks[-1].close)
            for record in metrics_file.read(folder.path / "metrics.jsonl"):
                self.append(record)
            self._close = stack.pop_all()

    def append(self, record: Mapping[str, Any]) -> None:
        """Give one record to all."""
        for sink in self._sinks:
            sink.append(record)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._close.close()


class CsvTable:
    """The records of one kind as comma-separated values."""

    def __init__(self, folder: OpenFolder, kind: str) -> None:
        self._kind = kind
        folder.require_same()
        # A new file: a backup may hold the old one under another name.
        folder.unlink(TABLES[kind])
        flags = os.O_WRONLY | os.O_CREAT | os.O_EXCL
        file = os.open(TABLES[kind], flags, 0o644, dir_fd=folder.descriptor)
        self._file = os.fdopen(file, "w", encoding="utf-8", newline="")
        self._rows = csv.DictWriter(self._file, COLUMNS[kind], lineterminator="\n")
        self._rows.writeheader()

    def append(self, record: Mapping[str, Any]) -> None:
        """One row, of a record of the table's kind."""
        if record["kind"] != self._kind:
            return
        self._rows.writerow({name: value for name, value in record.items() if name != "kind"})
        if self._kind == "chunk":
            self._file.flush()

    def close(self) -> None:
        """Close the file."""
        self._file.close()


class TensorBoardEvents:
    """Chunks as TensorBoard's scalars, by stage, over decisions."""

    def __init__(self, folder: OpenFolder) -> None:
        writer = tensorboard_writer()
        folder.require_same()
        shutil.rmtree(TENSORBOARD, ignore_errors=True, dir_fd=folder.descriptor)
        # TensorBoard's writer takes a name, no descriptor.
        self._writer = writer(str(folder.path / TENSORBOARD))

    def append(self, record: Mapping[str, Any]) -> None:
        """The figures of a chunk."""
        if record["kind"] != "chunk":
            return
        for name, value in record.items():
            if name not in COUNTS and value is not None:
                label = f"{record['stage']}/{LABELS.get(name, name)}"
                self._writer.add_scalar(label, value, record["decisions"])
        self._writer.flush()

    def close(self) -> None:
        """Close the file."""
        self._writer.close()


def tensorboard_writer() -> Any:
    """TensorboardX's writer.

    Raises:
        LanewiseError: it is not installed.
    """
    with needed_for("TensorBoard", install("tensorboard")):
        from tensorboardX import SummaryWriter
    return SummaryWriter
