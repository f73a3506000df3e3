"""What a stopped run has left on disk: read and checked as a whole, before any of it is touched."""

import math
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

import jax

from lanewise import pinned
from lanewise.controllers.controller import Parameters
from lanewise.controllers.registry import Stage
from lanewise.driving.parts import OURS, Parts
from lanewise.errors import CheckpointError, RunError
from lanewise.runs import checkpoint, records, trained, tree
from lanewise.runs.folder import RunFolder
from lanewise.runs.templates import Template
from lanewise.runs.trained import Mark
from lanewise.training import recipe, selection
from lanewise.training import stage as stage_loop
from lanewise.training.host import Ledger, StagePlan, StageProgress

_LISTS = {
    "recent": selection.RECENT,
    "window": selection.WINDOW,
    "window_chunks": selection.WINDOW,
    "best_score": 1,
}
"""Of a ledger, and how many numbers each holds at most."""


@dataclass(frozen=True)
class Left:
    """What there is to go on from."""

    handed: dict[str, Parameters]
    """What each finished stage handed on, by its name."""
    checkpoint: checkpoint.Checkpoint | None
    """Of the stage under way, if it has one yet."""
    warning: str
    """About newer checkpoints that cannot be used; often empty."""
    unusable: tuple[str, ...]
    """Their names."""
    mark: Mark
    """How much of the metrics file belongs to all this."""


def read(folder: RunFolder, parts: Parts = OURS) -> Left:
    """Read a stopped run.

    Raises:
        CheckpointError: a stored file is damaged beyond falling back.
        RunError: its metrics are.
    """
    done = trained.finished_stages(folder)
    handed = {stage.name: trained.load_stage(folder, stage, parts) for stage in done}
    found, warning, unusable = newest(folder, len(done), parts)
    if found is not None:
        mark = Mark.of(found.meta, folder.checkpoints / f"{found.name}.json")
    else:
        mark = trained.metrics_of(folder, done[-1]) if done else Mark()
        _check_metrics(folder, mark)
    return Left(handed, found, warning, unusable, mark)


def plan_of(folder: RunFolder, stage: Stage, parts: Parts = OURS) -> StagePlan:
    """The stage ready to run, with the run's settings."""
    settings = folder.settings
    return StagePlan(
        name=stage.name,
        course=recipe.course(settings, stage, parts),
        validation=recipe.validation_course(settings, stage, parts),
        validation_episodes=settings.evaluation.validation_episodes,
        validation_interval=settings.evaluation.validation_interval,
        fresh_episodes=settings.evaluation.fresh_episodes,
    )


def restored(progress: StageProgress, found: checkpoint.Checkpoint) -> StageProgress:
    """The progress stored in a checkpoint; ``progress`` lends its structure."""
    stored = tree.unflatten(arrays_of(progress), found.arrays)
    return StageProgress(**stored, ledger=ledger_of(found.meta))


def arrays_of(progress: StageProgress) -> dict[str, Any]:
    """What a checkpoint holds of a stage, besides its books."""
    return {"state": progress.state, "best": progress.best, "window": progress.window}


def newest(
    folder: RunFolder, index: int, parts: Parts
) -> tuple[checkpoint.Checkpoint | None, str, tuple[str, ...]]:
    """The newest whole checkpoint of the stage under way that the metrics reach, if there is one.

    Its arrays are checked against the shapes they must have before any is read. Where a run was
    copied while it was trained, the metrics may be older than the newest checkpoint.

    Returns:
        The checkpoint; a warning about newer ones that cannot be used, often empty; their names.
    """
    names = checkpoint.names(folder.checkpoints)
    stages = recipe.RECIPES[folder.controller]
    later = tuple(map(checkpoint.stage_prefix, range(index + 1, len(stages))))
    if after := [name for name in names if name.startswith(later)]:
        # To begin anew here would throw away what comes after.
        lost = folder.stages / f"{stages[index].name}.json"
        raise CheckpointError(f"{lost} is missing, though {after[0]} comes after it")
    if not any(name.startswith(checkpoint.stage_prefix(index)) for name in names):
        return None, "", ()
    plans = [plan_of(folder, stage, parts) for stage in stages]

    def template(meta: dict[str, Any]) -> Template:
        trained.check_seed(folder, meta, folder.checkpoints)
        stage = stage_of(meta, len(plans))
        ledger = ledger_of(meta)
        _check_books(ledger, plans[stage])
        name = checkpoint.checkpoint_name(stage, ledger.chunks)
        try:
            _check_metrics(folder, Mark.of(meta, folder.checkpoints / f"{name}.json"))
        except RunError as error:
            raise CheckpointError(str(error)) from error
        return tree.shapes(blank(folder, stage, parts))

    found, warning = checkpoint.newest_valid(folder.checkpoints, template, folder.digest)
    if found is None:
        return None, warning, ()
    _check_name(folder.checkpoints, found)
    unusable = tuple(name for name in names if name > found.name)
    if found.meta["stage"] != index:
        anew = warning.replace(f"continuing from {found.name}", "starting the stage anew")
        return None, anew, unusable
    return found, warning, unusable


@pinned.switches()
def blank(folder: RunFolder, index: int, parts: Parts = OURS) -> dict[str, Any]:
    """Shapes of a stage's checkpoint."""
    stages = recipe.RECIPES[folder.controller]
    plan = plan_of(folder, stages[index], parts)
    frozen: Parameters = {}
    for earlier in stages[:index]:
        frozen = frozen | trained.blank_networks(folder, earlier, parts)
    state = jax.eval_shape(
        lambda levels: stage_loop.begin(plan.course, levels, pinned.key(0)), frozen
    )
    weights = stage_loop.online(state.learners)
    window = selection.no_window(plan.course.budget.keep, weights)
    return {"state": state, "best": weights, "window": window}


def stage_of(meta: dict[str, Any], stages: int) -> int:
    """The number of the stage in a manifest.

    Raises:
        CheckpointError: there is none of so many stages.
    """
    index = meta.get("stage")
    if type(index) is not int or not 0 <= index < stages:
        raise CheckpointError("its manifest names no stage of the run")
    return index


def ledger_of(meta: dict[str, Any]) -> Ledger:
    """The host's books out of a manifest.

    Raises:
        CheckpointError: they are none.
    """
    stored = meta.get("ledger")
    names = {field.name for field in fields(Ledger)}
    if not isinstance(stored, dict) or stored.keys() != names:
        raise CheckpointError("its manifest holds no ledger")
    for name, value in stored.items():
        if not (_is_list(value, _LISTS[name]) if name in _LISTS else _is_count(value)):
            raise CheckpointError(f"its ledger's {name} is no such thing")
    values: dict[str, Any] = {n: tuple(v) if n in _LISTS else v for n, v in stored.items()}
    return Ledger(**values)


def _is_count(value: Any) -> bool:
    return type(value) is int and 0 <= value < 2**63


def _is_list(value: Any, longest: int) -> bool:
    return (
        isinstance(value, list)
        and len(value) <= longest
        and all(type(number) in (int, float) and abs(number) < math.inf for number in value)
    )


def _check_books(ledger: Ledger, plan: StagePlan) -> None:
    """Refuses counts that contradict one another.

    Raises:
        CheckpointError: says which.
    """
    if ledger.decisions != ledger.chunks * stage_loop.CHUNK * plan.course.budget.worlds:
        raise CheckpointError("its chunks and decisions do not agree")
    if ledger.episodes > ledger.decisions or ledger.best_chunk > ledger.chunks:
        raise CheckpointError("its ledger counts more than there can be")
    if bool(ledger.best_score) != bool(ledger.best_chunk):
        raise CheckpointError("its best score and the chunk of that do not agree")
    held = min(ledger.validations, selection.WINDOW)
    if not len(ledger.window) == len(ledger.window_chunks) == held:
        raise CheckpointError("its last validations do not agree")
    if len(ledger.recent) != min(ledger.episodes, selection.RECENT):
        raise CheckpointError("its last rewards and episodes do not agree")


def _check_metrics(folder: RunFolder, mark: Mark) -> None:
    """Refuses metrics that are not as they were up to a mark.

    Raises:
        RunError: they are shorter, damaged or were altered.
    """
    if mark.bytes:
        records.read(folder.metrics, mark.bytes, mark.sha256)


def _check_name(directory: Path, found: checkpoint.Checkpoint) -> None:
    """Refuses a checkpoint under the name of another moment.

    Raises:
        CheckpointError: says which.
    """
    chunks = found.meta["ledger"]["chunks"]
    if found.name != checkpoint.checkpoint_name(found.meta["stage"], chunks):
        raise CheckpointError(f"{directory / found.name} is of another moment than it is called")
    if int(found.arrays["state/iteration"]) != chunks * stage_loop.CHUNK:
        raise CheckpointError(f"{directory / found.name}: its state and its ledger do not agree")
