"""Train a controller into a run folder: stage after stage, checkpointed, resumable to the bit.

Every stage leaves ``stages/NAME``, the parameters it hands on; the run ends with ``controller``,
the parameters of all levels. In between, ``checkpoints/`` holds all that the stage under way needs.
"""

import time
from collections.abc import Collection, Mapping
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from typing import Any

import jax

from lanewise.controllers.controller import Parameters
from lanewise.errors import NumbersError, RunError, shell_line
from lanewise.runs import checkpoint, divergence, metrics_file, run_state, selected_weights
from lanewise.runs.checkpoint import Checkpoint
from lanewise.runs.metric_sinks import MetricSinks
from lanewise.runs.run_folder import CHECKPOINTS, RunFolder
from lanewise.system import pinned, process
from lanewise.system.progress import Progress
from lanewise.training import selection, trainer
from lanewise.training.plan import TrainingPlan
from lanewise.training.selection import StageProgress
from lanewise.training.trainer import StagePlan

INTERVAL = 10.0
"""Seconds of training between checkpoints, at least."""
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
    """Train the controller of a locked run folder; continue where its checkpoints stop.

    Args:
        folder: new or stopped.
        plan: of the folder's settings, controller and task functions.
        reporter: shows how far the training is.
        high_level: a run whose step-1 result is taken over, or None.
        tensorboard: whether to write TensorBoard's events too.

    Raises:
        RunError: the run is finished, or made with other parts; or ``high_level`` is no finished
            step 1; or the folder was moved, removed or replaced meanwhile.
        CheckpointError: a stored file is damaged beyond falling back.
        NumbersError: a number is not finite; see `divergence`.
    """
    folder.check_parts(plan.task.names())
    if run_state.is_finished(folder):
        test = shell_line("lanewise", "evaluate", folder.path)
        raise RunError(f"{folder.path} is finished; test it with: {test}")
    if warning := folder.other_code():
        reporter.note(warning)
    if high_level is not None:
        run_state.transfer_high_level(folder, plan, high_level)
    state = run_state.read(folder, plan)
    if state.checkpoint is not None and state.unusable:
        newest = next(iter(state.unusable.values()))
        reporter.note(f"{newest}; continuing from {state.checkpoint.name}")
    if state.checkpoint is None and (
        copy := metrics_file.keep_copy(folder.held, folder.metrics, state.metrics_bytes)
    ):
        begins = "without a checkpoint, the stage under way begins anew"
        reporter.note(f"{begins}; metrics so far are kept in {copy}")
    frozen: Parameters = {}
    with MetricSinks(folder.held, state.metrics_bytes, tensorboard=tensorboard) as metrics:
        training = _Training(folder, plan, reporter, metrics, state.unusable)
        for index, stage in enumerate(plan.stages):
            if stage.name not in state.handed:
                found = state.checkpoint if index == len(state.handed) else None
                training.run_stage(index, frozen, found)
            frozen = frozen | (
                state.handed.get(stage.name) or run_state.load_stage(folder, plan, stage.name)
            )
    run_state.save_controller(folder, frozen)
    # Only now, when nothing is left to resume.
    if folder.checkpoints.is_dir():
        with folder.held.inside(CHECKPOINTS) as place:
            checkpoint.prune(place, keep=0)


@dataclass
class _Training:
    """A training under way."""

    folder: RunFolder
    plan: TrainingPlan
    reporter: Progress
    metrics: MetricSinks
    unusable: Collection[str]
    """Checkpoints that cannot be used; they stay until another is saved."""

    def run_stage(self, index: int, frozen: Parameters, found: Checkpoint | None) -> None:
        """Train a stage, from its beginning or a checkpoint to its end, and store its weights."""
        stage, reporter = self.plan.stages[index], self.reporter
        progress = self._begun(index, frozen, found)
        reporter.stage(stage.name, 1.0, stage.fraction(progress.counters))
        saved = time.monotonic()
        # Within a chunk state and metrics do not fit together, and cannot be saved.
        hear = partial(reporter.note, "stopping once this chunk is finished and saved")
        with process.interrupts(hear) as asked_to_stop:
            while not stage.finished(progress.counters):
                began = time.monotonic()
                try:
                    progress, report = trainer.advance(stage, frozen, progress)
                except NumbersError as error:
                    raise self._diverged(index, frozen, progress, error) from None
                self._write(report, time.monotonic() - began)
                reporter.update(stage.fraction(progress.counters), **_figures(report.chunk))
                if asked_to_stop() or time.monotonic() - saved > INTERVAL:
                    self._save(index, progress)
                    saved = time.monotonic()
                if asked_to_stop():
                    raise KeyboardInterrupt
        self._finish(stage, frozen, progress)

    def _begun(self, index: int, frozen: Parameters, found: Checkpoint | None) -> StageProgress:
        """A stage as a checkpoint holds it, or at its beginning."""
        if found is not None:
            return StageProgress.restored(found.tree, found.meta["counters"])
        # The stage's own stream of the run's seed.
        key = jax.random.fold_in(pinned.key(self.folder.seed), STAGE_STREAM + index)
        return trainer.begin(self.plan.stages[index], frozen, key)

    def _write(self, report: trainer.Report, seconds: float) -> None:
        # The open files stay those of the run, wherever it is; to go on would be in vain.
        self.folder.held.require_same()
        for record in (*report.episodes, report.chunk):
            self.metrics.append(record)
        times = {"seconds": seconds, "validation": report.validation_seconds}
        which = {name: report.chunk[name] for name in ("stage", "chunk")}
        self.metrics.timings.append(which | {name: round(each, 4) for name, each in times.items()})

    def _save(self, index: int, progress: StageProgress) -> None:
        """A checkpoint: everything the stage needs to continue to the same bits."""
        mark = self.metrics.mark()
        with self.folder.held.inside(CHECKPOINTS) as place:
            checkpoint.save(
                place,
                checkpoint.checkpoint_name(index, progress.counters.chunks),
                progress.arrays,
                {"seed": self.folder.seed, "counters": asdict(progress.counters), **mark},
                self.folder.digest,
                keep=KEPT,
                unusable=self.unusable,
            )
        self.unusable = ()

    def _diverged(
        self, index: int, frozen: Parameters, progress: StageProgress, error: NumbersError
    ) -> NumbersError:
        newest, _ = run_state.newest_checkpoint(self.folder, self.plan, index)
        stored = self._begun(index, frozen, newest)
        return divergence.save(
            self.folder, self.plan, index, frozen, stored, progress.counters, error
        )

    def _finish(self, stage: StagePlan, frozen: Parameters, progress: StageProgress) -> None:
        """Compare what a stage hands on with its last weights, and store it."""
        self.metrics.append(selected_weights.compare(stage, frozen, progress))
        meta = {"counters": asdict(progress.counters), **self.metrics.mark()}
        self.folder.held.require_same()
        selected = selected_weights.of_run(metrics_file.read(self.folder.metrics))[-1]
        for warning in selected.warnings:
            self.reporter.note(warning)
        weights, _ = selection.result(stage.config.budget.keep, progress)
        run_state.save_stage(self.folder, stage.name, weights, meta)


def _figures(record: Mapping[str, Any]) -> dict[str, float]:
    """The few figures of a chunk shown while training."""
    return {label: record[name] for name, label in SHOWN.items() if record.get(name) is not None}
