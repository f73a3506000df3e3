"""Trained controllers ready to drive."""

from dataclasses import dataclass
from pathlib import Path

from lanewise.config.settings import Settings
from lanewise.controllers.controller import Parameters
from lanewise.driving.task_functions import PAPER_TASK, TaskFunctions
from lanewise.errors import RunError, shell_line
from lanewise.runs import checkpoint, pretrained, run_state
from lanewise.runs.run_folder import RunFolder
from lanewise.training.plan import TrainingPlan


@dataclass(frozen=True)
class Trained:
    """A controller ready to drive."""

    name: str
    """Which controller."""
    settings: Settings
    """Of the run it comes from."""
    seed: int
    """Of the run it comes from."""
    parameters: Parameters
    """Of all its levels."""
    task: TaskFunctions = PAPER_TASK
    """The user's own functions it was trained with."""


def load(path: Path, task: TaskFunctions = PAPER_TASK) -> Trained:
    """The finished controller of a run, or one that comes with the package (`pretrained`).

    Args:
        path: a run folder, ``pretrained/NAME`` or ``reference/NAME``.
        task: the user's own functions it was trained with.
    """
    if name := pretrained.reference_name(path):
        return Trained(name, Settings(), 0, {})
    folder = RunFolder.open(pretrained.locate(path))
    folder.check_parts(task.names())
    if not run_state.is_finished(folder):
        raise RunError(
            f"{path} is not finished; "
            f"{shell_line('lanewise', 'train', folder.controller, '--out', path, '--resume')} "
            "continues it"
        )
    plan = TrainingPlan.build(folder.settings, folder.controller, task)
    stored = checkpoint.load(folder.path, run_state.CONTROLLER, plan.parameters, folder.digest)
    run_state.check_seed(folder, stored.meta, folder.path / run_state.CONTROLLER)
    return Trained(folder.controller, folder.settings, folder.seed, stored.tree, task)
