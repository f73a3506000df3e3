"""Trained controllers ready to drive."""

from dataclasses import dataclass, fields
from pathlib import Path

from lanewise.config.settings import Settings
from lanewise.controllers.controller import Parameters
from lanewise.controllers.registry import CONTROLLERS
from lanewise.driving.task_functions import PAPER_TASK, TaskFunctions
from lanewise.errors import CheckpointError, RunError, shell_line
from lanewise.evaluation.stepwise import StepPolicy
from lanewise.runs import checkpoint, pretrained, run_state
from lanewise.runs.run_folder import CONTROLLER, STAGES, RunFolder, split
from lanewise.training import selection
from lanewise.training.plan import TrainingPlan
from lanewise.training.selection import StageCounters, StageProgress


@dataclass(frozen=True)
class Exported:
    """An exported policy (`lanewise.export.exported`)."""

    feature_count: int
    """Number of features it observes."""
    choose: StepPolicy
    """Its decisions."""


@dataclass(frozen=True)
class Trained:
    """A controller ready to drive."""

    name: str
    """Which controller. Of weights from within a training, the one that drove in their stage."""
    settings: Settings
    """Of the run it comes from."""
    seed: int
    """Of the run it comes from."""
    parameters: Parameters
    """Of all its levels; empty for a reference driver and an exported policy."""
    task: TaskFunctions = PAPER_TASK
    """How episodes start, and what is observed, rewarded and counted as success, when it drives."""
    trained_with: tuple[str, ...] = ()
    """Names of the user's own functions it was trained with (`TaskFunctions.names`)."""
    note: str = ""
    """One line on which weights these are; empty for those of a finished run."""
    exported: Exported | None = None
    """Who decides in place of its parameters, if it comes from a file of ``lanewise export``."""

    @property
    def feature_count(self) -> int | None:
        """Number of features it observes; None for a reference driver."""
        if self.exported:
            return self.exported.feature_count
        first = self.parameters.get("high_level") or self.parameters.get("single_level")
        return len(first[0][0]) if first else None


def load(path: Path, task: TaskFunctions = PAPER_TASK) -> Trained:
    """The controller of a run, or one that comes with the package (`pretrained`).

    An unfinished run has the weights that its stage under way has selected so far or, before it has
    selected any, the last ones in its newest checkpoint.

    Args:
        path: a run folder; a checkpoint or a finished stage within one, whose last weights are
            taken; ``pretrained/NAME`` or ``reference/NAME``.
        task: the user's own functions it is to drive with. The run may have been trained with
            others, except that one trained with its own observation needs one that fits.

    Raises:
        LanewiseError: there is no such run, it has no weights yet, or a file is damaged.
    """
    if name := pretrained.reference_name(path):
        return Trained(name, Settings(), 0, {}, task)
    folder, stored = RunFolder.open(pretrained.locate(path)), split(path)[1]
    plan = TrainingPlan.build(folder.settings, folder.controller, _of_training(folder, task))
    try:
        if stored is not None:
            name, weights, note = _stored(folder, plan, stored)
        elif run_state.is_finished(folder):
            name, weights, note = folder.controller, _finished(folder, plan), ""
        else:
            name, weights, note = _unfinished(folder, plan)
    except CheckpointError as error:
        if plan.task.names() == folder.task:
            raise
        raise RunError(f"{error}\n  the run was made with {'; '.join(folder.task)}") from error
    note = note and f"{path} {note}"
    return Trained(name, folder.settings, folder.seed, weights, task, folder.task, note)


def _of_training(folder: RunFolder, task: TaskFunctions) -> TaskFunctions:
    """The functions by which a run's arrays have their shapes, as far as they are known.

    Those that it was trained with are taken from ``task``, by whatever name they have there.
    """
    own = {each.partition(":")[0] for each in folder.task}
    if "observe" in own and task.observe is PAPER_TASK.observe:
        folder.check_parts(task.names())
    known = (each.name for each in fields(TaskFunctions) if each.name in own)
    return TaskFunctions(**{name: getattr(task, name) for name in known})


def _finished(folder: RunFolder, plan: TrainingPlan) -> Parameters:
    found = checkpoint.load(folder.path, CONTROLLER, plan.parameters, folder.digest)
    run_state.check_seed(folder, found.meta, folder.path / CONTROLLER)
    weights: Parameters = found.tree
    return weights


def _unfinished(folder: RunFolder, plan: TrainingPlan) -> tuple[str, Parameters, str]:
    """(controller, its weights, which they are)."""
    state = run_state.read(folder, plan)
    handed: Parameters = {name: of for each in state.handed.values() for name, of in each.items()}
    index = len(state.handed)
    if index == len(plan.stages):
        return folder.controller, handed, ""
    if state.checkpoint is not None:
        stage = plan.stages[index]
        progress = StageProgress.restored(state.checkpoint.tree, state.checkpoint.meta["counters"])
        weights, chunk = selection.result(stage.config.budget.keep, progress)
        which = f"weights of {stage.name} selected so far"
        if chunk != progress.counters.best_chunk:
            which = f"last weights of {stage.name}"
        which += f" (chunk {chunk})"
        share = _share(plan, index, progress.counters)
        handed, index = handed | weights, index + 1
    elif state.handed:
        which, share = f"weights of {plan.stages[index - 1].name}", _share(plan, index)
    else:
        words = ("train", folder.controller, "--out", folder.path, "--resume")
        raise RunError(
            f"{folder.path} is not finished and has no weights yet; "
            f"{shell_line('lanewise', *words)} continues it"
        )
    damaged = "".join(f"; {why}" for why in state.unusable.values())
    return _driver(folder, index - 1), handed, f"is unfinished: {share}; {which}{damaged}"


def _stored(folder: RunFolder, plan: TrainingPlan, stored: Path) -> tuple[str, Parameters, str]:
    """As `_unfinished`, of a checkpoint or a finished stage named by its path in the run."""
    kind, name = stored.parts
    stages = [each.name for each in plan.stages]
    found = checkpoint.names(folder.checkpoints)
    known = {each: at for each in found if (at := checkpoint.stage_index(each)) < len(stages)}
    if kind == STAGES:
        known = {each: stages.index(each) for each in run_state.finished_stages(folder)}
    if name not in known:
        there = f"there: {', '.join(known)}" if known else f"it has no {kind}"
        raise RunError(f"{folder.path} has no {stored}; {there}")
    index = known[name]
    weights: Parameters = {}
    for each in stages[:index]:
        weights = weights | run_state.load_stage(folder, plan, each)
    if kind == STAGES:
        last = run_state.load_stage(folder, plan, name)
        return _driver(folder, index), weights | last, f"is what {name} handed on"
    held = checkpoint.load(folder.checkpoints, name, plan.progress(index), folder.digest)
    run_state.check_seed(folder, held.meta, folder.checkpoints / name)
    progress = StageProgress.restored(held.tree, held.meta["counters"])
    share = _share(plan, index, progress.counters)
    return _driver(folder, index), weights | progress.last, f"is from within a training: {share}"


def _driver(folder: RunFolder, index: int) -> str:
    """The controller that drives in a stage."""
    return CONTROLLERS[folder.controller].stages[index].controller


def _share(plan: TrainingPlan, index: int, counters: StageCounters | None = None) -> str:
    """How much of a training is done in its stages before ``index`` and by one's counters."""
    budgets = [each.config.budget for each in plan.stages]
    unit = "decisions" if all(budget.decisions for budget in budgets) else "episodes"
    limits = [getattr(budget, unit) for budget in budgets]
    done = sum(limits[:index])
    if counters is not None:
        done += min(getattr(counters, unit), limits[index])
    return f"{100 * done / sum(limits):.0f} % of its {unit}"
