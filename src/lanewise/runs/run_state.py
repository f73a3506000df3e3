"""What a run has on disk: its finished stages, the newest checkpoint, its controller."""

import os
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from lanewise.controllers.controller import Parameters
from lanewise.controllers.registry import CONTROLLERS, STEP_1
from lanewise.errors import CheckpointError, RunError
from lanewise.runs import checkpoint, metrics_file
from lanewise.runs.checkpoint import Checkpoint
from lanewise.runs.run_folder import CONTROLLER, STAGES, RunFolder, open_high_level
from lanewise.system.version import __version__
from lanewise.training.plan import TrainingPlan


@dataclass(frozen=True)
class RunState:
    """What a stopped run goes on from."""

    handed: dict[str, Parameters]
    """What each finished stage handed on, by its name."""
    checkpoint: Checkpoint | None
    """Of the stage under way, if it has one yet."""
    unusable: dict[str, str]
    """Why newer ones cannot be used, by name."""
    metrics_bytes: int
    """How much of the metrics file belongs to all this."""


def read(folder: RunFolder, plan: TrainingPlan) -> RunState:
    """Read a stopped run as a whole, before anything in it changes."""
    done = finished_stages(folder)
    handed = {name: load_stage(folder, plan, name) for name in done}
    found, unusable = newest_checkpoint(folder, plan, len(done))
    meta = {"metrics_bytes": 0}
    if found is not None:
        meta = found.meta
    elif done:
        meta = _stage_meta(folder, done[-1])
        metrics_file.read_marked(folder.metrics, meta)
    return RunState(handed, found, unusable, meta["metrics_bytes"])


def newest_checkpoint(
    folder: RunFolder, plan: TrainingPlan, index: int
) -> tuple[Checkpoint | None, dict[str, str]]:
    """`checkpoint.newest_valid` of a stage, as far as the metrics reach.

    Where a run was copied while it was trained, the metrics may be older than a checkpoint.
    """
    names = checkpoint.names(folder.checkpoints)
    prefix = checkpoint.stage_prefix(index)
    if after := [name for name in names if name[: len(prefix)] > prefix]:
        # To begin anew here would throw away what comes after.
        lost = folder.stages / f"{plan.stages[index].name}.json"
        raise CheckpointError(f"{lost} is missing, though {after[0]} comes after it")
    if not any(name.startswith(prefix) for name in names):
        return None, {}

    def accept(meta: dict[str, Any]) -> None:
        check_seed(folder, meta, folder.checkpoints)
        metrics_file.read_marked(folder.metrics, meta)

    return checkpoint.newest_valid(
        folder.checkpoints, plan.progress(index), folder.digest, prefix, accept
    )


def is_finished(folder: RunFolder) -> bool:
    """Whether the run has its controller."""
    # A link that leads nowhere counts, and is refused when it is read.
    return os.path.lexists(folder.path / f"{CONTROLLER}.json")


def has_stage(folder: RunFolder, name: str) -> bool:
    """Whether a stage is finished."""
    return os.path.lexists(folder.stages / f"{name}.json")


def finished_stages(folder: RunFolder) -> list[str]:
    """Names of the finished stages, in order."""
    names = [stage.name for stage in CONTROLLERS[folder.controller].stages]
    done = [name for name in names if has_stage(folder, name)]
    for name, found in zip(names, done, strict=False):
        if name != found:
            lost = folder.stages / f"{name}.json"
            raise CheckpointError(f"{lost} is missing, though {found} comes after it")
    return done


def save_stage(folder: RunFolder, name: str, weights: Parameters, meta: dict[str, Any]) -> None:
    """Store what a stage hands on: the parameters of the levels that learnt in it."""
    with folder.held.inside(STAGES) as place:
        checkpoint.save(place, name, weights, meta | {"seed": folder.seed}, folder.digest)


def load_stage(folder: RunFolder, plan: TrainingPlan, name: str) -> Parameters:
    """What a stage handed on."""
    stored = checkpoint.load(folder.stages, name, plan.weights[name], folder.digest)
    check_seed(folder, stored.meta, folder.stages / name)
    weights: Parameters = stored.tree
    return weights


def save_controller(folder: RunFolder, parameters: Parameters) -> None:
    """Store the finished controller."""
    meta = {"controller": folder.controller, "seed": folder.seed, "lanewise": __version__}
    checkpoint.save(folder.held, CONTROLLER, parameters, meta, folder.digest)


def weights_digest(folder: RunFolder) -> str:
    """SHA-256 of a finished run's weights, which stands for all of the training behind them."""
    return str(checkpoint.read_manifest(folder.path, CONTROLLER)["sha256"])


def transfer_high_level(folder: RunFolder, plan: TrainingPlan, source: Path) -> None:
    """Copy the step-1 result of another run into this one, so that only step 2 is trained."""
    name = STEP_1.name
    if has_stage(folder, name):
        raise RunError(f"{folder.path} has its own step 1 already; resume it without --high-level")
    lender = open_high_level(source, folder.controller, folder.settings, plan.task.names())
    source_of = {"taken_from_seed": lender.seed, "taken_from_settings": lender.digest}
    # Its high level has the shapes of this plan's, as was checked.
    save_stage(folder, name, load_stage(lender, plan, name), source_of | {"metrics_bytes": 0})


def training_metrics(folder: RunFolder) -> list[dict[str, Any]]:
    """The metrics of a run in full; those of its finished stages as they were written."""
    done, found = finished_stages(folder), metrics_file.read(folder.metrics)
    if done:
        written = metrics_file.read_marked(folder.metrics, _stage_meta(folder, done[-1]))
        if len(done) == len(CONTROLLERS[folder.controller].stages) and len(found) > len(written):
            raise RunError(f"{folder.metrics} was altered: it goes on after the end of the run")
    return found


def check_seed(folder: RunFolder, meta: dict[str, Any], file: Path) -> None:
    """Raise a CheckpointError for what belongs to a run with another seed."""
    if meta["seed"] != folder.seed:
        raise CheckpointError(f"{file} is of another run: its seed is not {folder.seed}")


def _stage_meta(folder: RunFolder, name: str) -> dict[str, Any]:
    meta: dict[str, Any] = checkpoint.read_manifest(folder.stages, name, folder.digest)["meta"]
    return meta
