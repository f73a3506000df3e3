"""All that a training tells of itself: its metrics, what is made of them, and wall-clock times.

``metrics.jsonl`` is continued when a run is. Tables for spreadsheets, and TensorBoard's events if
wanted, hold nothing else and are written anew, so that nothing that a kill has undone stays in
them. Wall-clock times stand alone, so that metrics repeat to the byte.
"""

import csv
import os
import shutil
from collections.abc import Mapping
from contextlib import ExitStack
from typing import Any, Self

from lanewise.runs import metrics_file
from lanewise.runs.metrics_file import COLUMNS, MetricsWriter
from lanewise.system.extras import install, needed_for
from lanewise.system.folder_io import OpenFolder, begin_file

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
    """The open files of a run's metrics; to be used in a ``with`` block."""

    def __init__(self, folder: OpenFolder, resume_at: int, *, tensorboard: bool) -> None:
        """Opens them.

        Args:
            folder: of the run.
            resume_at: how many bytes of its metrics are kept.
            tensorboard: whether events are wanted; a run that has some goes on with them.
        """
        path = folder.path / "metrics.jsonl"
        with ExitStack() as stack:
            self.metrics = stack.enter_context(MetricsWriter(folder, path.name, resume_at))
            self.timings = stack.enter_context(MetricsWriter(folder, "timings.jsonl", None))
            self._sinks: list[CsvTable | TensorBoardEvents] = []
            for kind in TABLES:
                self._sinks.append(CsvTable(folder, kind))
                stack.callback(self._sinks[-1].close)
            if tensorboard or (folder.path / TENSORBOARD).exists():
                self._sinks.append(TensorBoardEvents(folder))
                stack.callback(self._sinks[-1].close)
            for record in metrics_file.read(path):
                self._pass_on(record)
            self._close = stack.pop_all()

    def append(self, record: Mapping[str, Any]) -> None:
        """Write one record everywhere."""
        self.metrics.append(record)
        self._pass_on(record)

    def _pass_on(self, record: Mapping[str, Any]) -> None:
        for sink in self._sinks:
            sink.append(record)

    def mark(self) -> dict[str, Any]:
        """As `MetricsWriter.mark`, with the times on disk too."""
        self.timings.sync()
        return self.metrics.mark()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._close.close()


class CsvTable:
    """The records of one kind as comma-separated values."""

    def __init__(self, folder: OpenFolder, kind: str) -> None:
        self._kind = kind
        file = begin_file(folder, TABLES[kind])
        self._file = os.fdopen(file, "w", encoding="utf-8", newline="")
        self._rows = csv.DictWriter(self._file, COLUMNS[kind], lineterminator="\n")
        self._rows.writeheader()
        self.close = self._file.close

    def append(self, record: Mapping[str, Any]) -> None:
        """One row, of a record of the table's kind."""
        if record["kind"] != self._kind:
            return
        self._rows.writerow({name: value for name, value in record.items() if name != "kind"})
        if self._kind == "chunk":
            self._file.flush()


class TensorBoardEvents:
    """Chunks as TensorBoard's scalars, by stage, over decisions."""

    def __init__(self, folder: OpenFolder) -> None:
        writer = tensorboard_writer()
        folder.require_same()
        shutil.rmtree(TENSORBOARD, ignore_errors=True, dir_fd=folder.descriptor)
        # TensorBoard's writer takes a name, no descriptor.
        self._writer = writer(str(folder.path / TENSORBOARD))
        self.close = self._writer.close

    def append(self, record: Mapping[str, Any]) -> None:
        """The figures of a chunk."""
        if record["kind"] != "chunk":
            return
        for name, value in record.items():
            if name not in COUNTS and value is not None:
                label = f"{record['stage']}/{LABELS.get(name, name)}"
                self._writer.add_scalar(label, value, record["decisions"])
        self._writer.flush()


def tensorboard_writer() -> Any:
    """TensorboardX's writer; a LanewiseError if it is not installed."""
    with needed_for("TensorBoard", install("tensorboard")):
        from tensorboardX import SummaryWriter
    return SummaryWriter
