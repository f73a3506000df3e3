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

from lanewise import pinned, signals
from lanewise.controllers.controller import Parameters
from lanewise.controllers.registry import Stage
from lanewise.driving.parts import OURS, Parts
from lanewise.errors import NumbersError, RunError, shell_line
from lanewise.progress import Progress
from lanewise.runs import checkpoint, diverged, kept, metrics, resume, trained, tree
from lanewise.runs.folder import CHECKPOINTS, RunFolder
from lanewise.runs.metrics import MetricsWriter, keep_copy
from lanewise.runs.resume import plan_of
from lanewise.runs.trained import Mark
from lanewise.runs.views import Views
from lanewise.training import host as stages
from lanewise.training import recipe
from lanewise.training.host import StagePlan, StageProgress

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


@dataclass
class _Files:
    """The open files of a run that is being trained."""

    folder: RunFolder
    metrics: MetricsWriter
    timings: MetricsWriter
    views: Views
    unusable: tuple[str, ...]
    """Checkpoints that cannot be used; they stay until another is saved."""


class _Interrupts:
    """Ctrl-C waits for the end of a chunk, when state and metrics fit together and can be saved.

    So does SIGTERM, by which clusters announce that a machine is needed otherwise. A second signal
    does not wait: the run then continues from its newest checkpoint.
    """

    def __init__(self, reporter: Progress) -> None:
        self.asked = False
        self._reporter = reporter
        self._listening = ExitStack()

    def __enter__(self) -> "_Interrupts":
        for number in (signal.SIGINT, signal.SIGTERM):
            self._listening.enter_context(signals.heard(number, self._hear))
        return self

    def __exit__(self, *_: object) -> None:
        self._listening.close()

    def _hear(self, *_: object) -> None:
        if self.asked:
            raise KeyboardInterrupt
        self.asked = True
        with suppress(RuntimeError):  # In the middle of another line.
            self._reporter.note("stopping: this chunk is finished and saved first")


@pinned.switches()
def train(
    folder: RunFolder,
    high_level: Path | None,
    reporter: Progress,
    *,
    tensorboard: bool = False,
    parts: Parts = OURS,
) -> None:
    """Train ``folder.controller`` to the end; continue where the folder's checkpoints stop.

    Args:
        folder: a locked run folder, new or stopped.
        high_level: a run whose step-1 result is taken over, or None.
        reporter: told how far the training is.
        tensorboard: whether to write TensorBoard's events too.
        parts: the user's own functions; those the folder was made with.

    Raises:
        RunError: the run is finished already, or was made with other parts, or ``high_level`` is
            no finished step 1; or the folder was moved, removed or replaced meanwhile.
        CheckpointError: a stored file is damaged beyond falling back.
        NumbersError: a number is not finite; `diverged` says what is kept of it.
    """
    folder.check_parts(parts.names())
    if trained.is_finished(folder):
        test = shell_line("lanewise", "evaluate", folder.path)
        raise RunError(f"{folder.path} is finished; {test} tests it")
    if warning := folder.other_code():
        reporter.note(warning)
    if high_level is not None:
        trained.take_over_high_level(folder, high_level, parts)
    left = resume.read(folder, parts)
    if left.warning:
        reporter.note(left.warning)
    if left.checkpoint is None and (
        kept := keep_copy(folder.metrics, left.mark.bytes, folder.held)
    ):
        begins = "without a checkpoint, the stage under way begins anew"
        reporter.note(f"{begins}; metrics so far are kept in {kept}")
    with (
        MetricsWriter(folder.metrics, left.mark.bytes, folder.held) as metrics,
        MetricsWriter(folder.timings, None, folder.held) as timings,
        Views(folder.held, tensorboard=tensorboard) as views,
    ):
        files = _Files(folder, metrics, timings, views, left.unusable)
        frozen: Parameters = {}
        found = left.checkpoint
        for index, stage in enumerate(recipe.RECIPES[folder.controller]):
            if stage.name in left.handed:
                frozen = frozen | left.handed[stage.name]
                continue
            _run_stage(files, index, stage, frozen, found, reporter, parts)
            found = None
            frozen = frozen | trained.load_stage(folder, stage, parts)
    trained.save_controller(folder, frozen)
    # Only now, when nothing is left to resume.
    if folder.checkpoints.is_dir():
        with folder.held.inside(CHECKPOINTS) as place:
            checkpoint.prune(place, keep=0)


def _run_stage(
    files: _Files,
    index: int,
    stage: Stage,
    frozen: Parameters,
    found: checkpoint.Checkpoint | None,
    reporter: Progress,
    parts: Parts,
) -> None:
    """Run a stage to its end, from its beginning or from a checkpoint."""
    plan = plan_of(files.folder, stage, parts)
    progress = _from(files.folder, index, plan, frozen, found)
    reporter.stage(stage.name, 1.0, plan.fraction(progress.ledger))
    saved = time.monotonic()
    with _Interrupts(reporter) as interrupts:
        while not plan.finished(progress.ledger):
            began = time.monotonic()
            try:
                progress, report = stages.advance(plan, frozen, progress)
            except NumbersError as error:
                newest, _, _ = resume.newest(files.folder, index, parts)
                stored = _from(files.folder, index, plan, frozen, newest)
                raise diverged.keep(
                    files.folder, index, plan, frozen, stored, progress.ledger, error
                ) from None
            _write(files, report, time.monotonic() - began)
            reporter.update(plan.fraction(progress.ledger), **_figures(report.chunk))
            if interrupts.asked or time.monotonic() - saved > INTERVAL:
                _save(files, index, progress)
                saved = time.monotonic()
            if interrupts.asked:
                raise KeyboardInterrupt
    _compare(files, plan, frozen, progress, reporter)
    parameters = stages.result(plan, progress)
    meta = {"ledger": asdict(progress.ledger), **Mark.after(files.metrics)}
    trained.save_stage(files.folder, stage, parameters, meta)


def _compare(
    files: _Files,
    plan: StagePlan,
    frozen: Parameters,
    progress: StageProgress,
    reporter: Progress,
) -> None:
    """Hold what a finished stage hands on against its last weights; say what is odd about it."""
    _append(files, stages.compare(plan, frozen, progress))
    files.metrics.sync()
    files.folder.held.require_same()
    found = kept.of_run(metrics.read(files.folder.metrics))[-1]
    for warning in found.warnings:
        reporter.note(warning)


def _from(
    folder: RunFolder,
    index: int,
    plan: StagePlan,
    frozen: Parameters,
    found: checkpoint.Checkpoint | None,
) -> StageProgress:
    """The stage as a checkpoint holds it, or at its beginning."""
    progress = stages.begin(plan, frozen, _stage_key(folder, index))
    return progress if found is None else resume.restored(progress, found)


def _stage_key(folder: RunFolder, index: int) -> jax.Array:
    """The random key of a stage: its own stream of the run's seed."""
    return jax.random.fold_in(pinned.key(folder.seed), STAGE_STREAM + index)


def _write(files: _Files, report: stages.Report, seconds: float) -> None:
    """A chunk's lines; wall-clock times go elsewhere, so that metrics can repeat to the byte."""
    # The open files stay those of the run, wherever it is; to go on would be in vain.
    files.folder.held.require_same()
    for line in (*report.episodes, report.chunk):
        _append(files, line)
    chunk = report.chunk
    files.timings.append(
        {
            "stage": chunk["stage"],
            "chunk": chunk["chunk"],
            "seconds": round(seconds, 4),
            "validation": round(report.validation_seconds, 4),
        }
    )


def _append(files: _Files, line: dict[str, Any]) -> None:
    """A line of metrics, in the file and wherever else people look."""
    files.metrics.append(line)
    files.views.append(line)


def _figures(line: dict[str, Any]) -> dict[str, float]:
    """The few figures shown while training."""
    return {label: line[name] for name, label in SHOWN.items() if line.get(name) is not None}


def _save(files: _Files, index: int, progress: StageProgress) -> None:
    """A checkpoint: everything the stage needs to continue to the same bits."""
    mark = Mark.after(files.metrics)
    files.timings.sync()
    with files.folder.held.inside(CHECKPOINTS) as place:
        checkpoint.save(
            place,
            checkpoint.checkpoint_name(index, progress.ledger.chunks),
            tree.flatten(resume.arrays_of(progress)),
            {
                "stage": index,
                "seed": files.folder.seed,
                "ledger": asdict(progress.ledger),
                **mark,
            },
            files.folder.digest,
            keep=KEPT,
            unusable=files.unusable,
        )
    files.unusable = ()
