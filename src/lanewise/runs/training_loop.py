"""Train a controller into a run folder: stage after stage, checkpointed, resumable to the bit.

Every stage leaves ``stages/NAME``, the parameters it hands on; the run ends with ``controller``,
the parameters of all levels. In between, ``checkpoints/`` holds all that the stage under way needs.
"""

import signal
import time
from contextlib import ExitStack, suppress
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import jax

from lanewise.controllers.controller import Parameters
from lanewise.errors import NumbersError, RunError, shell_line
from lanewise.runs import checkpoint, divergence, metrics_file, run_state, selected_weights
from lanewise.runs.checkpoint import Checkpoint
from lanewise.runs.metric_sinks import MetricSinks
from lanewise.runs.metrics_file import MetricsWriter
from lanewise.runs.run_folder import CHECKPOINTS, RunFolder
from lanewise.system import pinned, process
from lanewise.system.progress import Progress
from lanewise.training import trainer
from lanewise.training.plan import TrainingPlan, stored_progress
from lanewise.training.trainer import StagePlan, StageProgress

INTERVAL = 10.0
"""Seconds of training between checkpoints, at least; a kill loses no more than about this."""
STAGE_STREAM = 1000
"""First random stream of the stages, apart from those of the test starts (`trap.start_key`)."""
SHOWN = {
    "success_rate": "success rate",
    "reward": "reward (one a decision)",
    "epsilon": "epsilon",
    "validation_success_rate": "validation success rate",
}
"""Figures of a chunk shown while training, and what they are called there."""
KEPT = 2
"""Checkpoints kept, so that a damaged newest one can be skipped."""


@pinned.switches()
def train(
    folder: RunFolder,
    plan: TrainingPlan,
    reporter: Progress,
    *,
    high_level: Path | None = None,
    tensorboard: bool = False,
) -> None:
    """Train ``folder.controller`` to the end; continue where the folder's checkpoints stop.

    Args:
        folder: a locked run folder, new or stopped.
        plan: of the folder's settings and controller, with the task functions it was made with.
        reporter: shows how far the training is.
        high_level: a run whose step-1 result is taken over, or None.
        tensorboard: whether to write TensorBoard's events too.

    Raises:
        RunError: the run is finished already, or was made with other parts, or ``high_level`` is
            no finished step 1; or the folder was moved, removed or replaced meanwhile.
        CheckpointError: a stored file is damaged beyond falling back.
        NumbersError: a number is not finite; see `divergence`.
    """
    folder.check_parts(plan.task.names())
    if run_state.is_finished(folder):
        test = shell_line("lanewise", "evaluate", folder.path)
        raise RunError(f"{folder.path} is finished; {test} tests it")
    if warning := folder.other_code():
        reporter.note(warning)
    if high_level is not None:
        run_state.transfer_high_level(folder, plan, high_level)
    state = run_state.read(folder, plan)
    if state.warning:
        reporter.note(state.warning)
    if state.checkpoint is None and (
        copy := metrics_file.keep_copy(folder.metrics, state.metrics_bytes, folder.held)
    ):
        begins = "without a checkpoint, the stage under way begins anew"
        reporter.note(f"{begins}; metrics so far are kept in {copy}")
    with (
        MetricsWriter(folder.metrics, state.metrics_bytes, folder.held) as metrics,
        MetricsWriter(folder.timings, None, folder.held) as timings,
        MetricSinks(folder.held, tensorboard=tensorboard) as sinks,
    ):
        files = _OpenFiles(folder, metrics, timings, sinks, state.unusable)
        frozen: Parameters = {}
        for index, stage in enumerate(plan.stages):
            if stage.name not in state.handed:
                found = state.checkpoint if index == len(state.handed) else None
                _StageRun(files, plan, index, frozen, reporter).run(found)
            frozen = frozen | (
                state.handed.get(stage.name) or run_state.load_stage(folder, plan, stage.name)
            )
    run_state.save_controller(folder, frozen)
    # Only now, when nothing is left to resume.
    if folder.checkpoints.is_dir():
        with folder.held.inside(CHECKPOINTS) as place:
            checkpoint.prune(place, keep=0)


@dataclass
class _OpenFiles:
    """The open files of a run that is being trained."""

    folder: RunFolder
    metrics: MetricsWriter
    timings: MetricsWriter
    sinks: MetricSinks
    unusable: tuple[str, ...]
    """Checkpoints that cannot be used; they stay until another is saved."""

    def append(self, line: dict[str, Any]) -> None:
        """A line of metrics, in the file and in the sinks."""
        self.metrics.append(line)
        self.sinks.append(line)

    def write(self, report: trainer.Report, seconds: float) -> None:
        """A chunk's lines. Wall-clock times go elsewhere, so that metrics repeat to the byte."""
        # The open files stay those of the run, wherever it is; to go on would be in vain.
        self.folder.held.require_same()
        for line in (*report.episodes, report.chunk):
            self.append(line)
        self.timings.append(
            {
                "stage": report.chunk["stage"],
                "chunk": report.chunk["chunk"],
                "seconds": round(seconds, 4),
                "validation": round(report.validation_seconds, 4),
            }
        )

    def save(self, index: int, progress: StageProgress) -> None:
        """A checkpoint: everything the stage needs to continue to the same bits."""
        mark = self.metrics.mark()
        self.timings.sync()
        with self.folder.held.inside(CHECKPOINTS) as place:
            checkpoint.save(
                place,
                checkpoint.checkpoint_name(index, progress.counters.chunks),
                stored_progress(progress),
                {"seed": self.folder.seed, "counters": asdict(progress.counters), **mark},
                self.folder.digest,
                keep=KEPT,
                unusable=self.unusable,
            )
        self.unusable = ()


@dataclass
class _StageRun:
    """One stage of a training, from its beginning or a checkpoint to its end."""

    files: _OpenFiles
    training: TrainingPlan
    index: int
    frozen: Parameters
    reporter: Progress

    @property
    def plan(self) -> StagePlan:
        """The stage's own plan."""
        return self.training.stages[self.index]

    def run(self, found: Checkpoint | None) -> None:
        """Train the stage and store what it hands on."""
        plan, files, reporter = self.plan, self.files, self.reporter
        progress = self._progress(found)
        reporter.stage(plan.name, 1.0, plan.fraction(progress.counters))
        saved = time.monotonic()
        with _Interrupts(reporter) as interrupts:
            while not plan.finished(progress.counters):
                began = time.monotonic()
                try:
                    progress, report = trainer.advance(plan, self.frozen, progress)
                except NumbersError as error:
                    raise self._diverged(progress, error) from None
                files.write(report, time.monotonic() - began)
                reporter.update(plan.fraction(progress.counters), **_figures(report.chunk))
                if interrupts.asked or time.monotonic() - saved > INTERVAL:
                    files.save(self.index, progress)
                    saved = time.monotonic()
                if interrupts.asked:
                    raise KeyboardInterrupt
        self._finish(progress)

    def _progress(self, found: Checkpoint | None) -> StageProgress:
        """The stage as a checkpoint holds it, or at its beginning."""
        if found is not None:
            return run_state.progress_of(found)
        # The stage's own stream of the run's seed.
        key = jax.random.fold_in(pinned.key(self.files.folder.seed), STAGE_STREAM + self.index)
        return trainer.begin(self.plan, self.frozen, key)

    def _diverged(self, progress: StageProgress, error: NumbersError) -> NumbersError:
        folder = self.files.folder
        newest, _, _ = run_state.newest_checkpoint(folder, self.training, self.index)
        stored = self._progress(newest)
        return divergence.save(
            folder, self.index, self.plan, self.frozen, stored, progress.counters, error
        )

    def _finish(self, progress: StageProgress) -> None:
        """Compare what the stage hands on with its last weights, and store it."""
        files, folder = self.files, self.files.folder
        files.append(trainer.compare(self.plan, self.frozen, progress))
        meta = {"counters": asdict(progress.counters), **files.metrics.mark()}
        folder.held.require_same()
        selected = selected_weights.of_run(metrics_file.read(folder.metrics))[-1]
        for warning in selected.warnings:
            self.reporter.note(warning)
        weights = trainer.result(self.plan, progress)
        run_state.save_stage(folder, self.plan.name, weights, meta)


class _Interrupts:
    """Ctrl-C waits for the end of a chunk, when state and metrics fit together and can be saved.

    So does SIGTERM, by which clusters announce that a machine is needed otherwise. A second signal
    does not wait: the run then continues from its newest checkpoint.
    """

    def __init__(self, reporter: Progress) -> None:
        self.asked = False
        self._reporter = reporter
        self._handlers = ExitStack()

    def __enter__(self) -> "_Interrupts":
        for number in (signal.SIGINT, signal.SIGTERM):
            self._handlers.enter_context(process.handle_signal(number, self._handle))
        return self

    def __exit__(self, *_: object) -> None:
        self._handlers.close()

    def _handle(self, *_: object) -> None:
        if self.asked:
            raise KeyboardInterrupt
        self.asked = True
        with suppress(RuntimeError):  # In the middle of another line.
            self._reporter.note("stopping: this chunk is finished and saved first")


def _figures(line: dict[str, Any]) -> dict[str, float]:
    """The few figures shown while training."""
    return {label: line[name] for name, label in SHOWN.items() if line.get(name) is not None}
