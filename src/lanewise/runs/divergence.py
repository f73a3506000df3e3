"""Trainings whose numbers stopped being finite: what is kept of them, and how to look again.

``DIR/diverged/`` holds ``found.json``, what was not finite and where, and ``before``, the stage's
state before the chunk in which it happened. The run's checkpoints and metrics stay as the chunks
before it left them.
"""

import json
from dataclasses import asdict, dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import jax
import numpy as np
from numpy.typing import NDArray

from lanewise.controllers.controller import Parameters
from lanewise.driving.task_functions import PAPER_TASK, TaskFunctions
from lanewise.errors import NumbersError, RunError
from lanewise.runs import checkpoint, pytree_io, run_state
from lanewise.runs.run_folder import RunFolder
from lanewise.system import pinned
from lanewise.system.folder_io import write_atomically
from lanewise.system.version import __version__
from lanewise.training import finite_checks, stage
from lanewise.training.finite_checks import Finding
from lanewise.training.plan import TrainingPlan
from lanewise.training.selection import StageCounters, StageProgress
from lanewise.training.stage import CHUNK, ChunkMetrics, StageState

FOLDER, BEFORE, FOUND = "diverged", "before", "found.json"
_LEARNING_RATE = "a lower learner.learning_rate of {level} may help, in a new run"
_FUNCTION = "mend the function that {does}, then resuming goes on before it"
ADVICE = {
    "observation": _FUNCTION.format(does="observes or makes the start"),
    "reward": _FUNCTION.format(does="rewards"),
    "vehicles": _FUNCTION.format(does="makes the start"),
    "transitions": _FUNCTION.format(does="observes or rewards"),
    "loss": _LEARNING_RATE,
    "weights": _LEARNING_RATE,
    "validation": _FUNCTION.format(does="did it"),
}
"""What to do, by what was found first."""


@dataclass(frozen=True)
class FirstNonfinite:
    """The first iteration of a chunk that left something behind that is not finite."""

    stage: str
    """Its name."""
    chunk: int
    """Its number, as in metrics."""
    iteration: int
    """Of the chunk, from 1 on."""
    found: tuple[Finding, ...]
    """What is not finite, likely causes first."""
    observation: NDArray[np.float32]
    """[worlds, n] what every ego observes after it."""
    reward: NDArray[np.float32]
    """[worlds] the rewards of its decisions."""
    loss: dict[str, float]
    """Mean loss of its updates, by level that had any."""
    weights: dict[str, list[str]]
    """Arrays of the learner that are not finite, by level that learns."""
    before: StageState
    """The stage before the iteration."""
    after: StageState
    """The stage after it."""


def save(
    folder: RunFolder,
    training: TrainingPlan,
    index: int,
    frozen: Parameters,
    stored: StageProgress,
    reached: StageCounters,
    error: NumbersError,
) -> NumbersError:
    """Keep what is needed to see a failure again; returns the error to show to the user.

    The chunk has consumed the state it began with. Chunks repeat to the bit, so the stage is
    driven there once more, from where the run would be resumed: from what is ``stored``, which is
    consumed, to the counters that were ``reached`` before the chunk that failed.
    """
    plan, state = training.stages[index], stored.state
    for _ in range(reached.chunks - stored.counters.chunks):
        state, _ = stage.advance(plan.config, frozen, state)
    meta = {"stage": index, "chunks": reached.chunks, "message": str(error)}
    with folder.held.inside(FOLDER) as place:
        checkpoint.save(place, BEFORE, state, meta, folder.digest)
    _, metrics = stage.advance(plan.config, frozen, state)
    again = list(map(asdict, finite_checks.findings(jax.device_get(metrics.finite))))
    found, first = list(map(asdict, error.found)), error.found[0]
    about = {
        "message": str(error),
        "stage": plan.name,
        "chunk": reached.chunks + 1,
        "decisions_before": reached.decisions,
        "worlds": plan.config.budget.worlds,
        "found": found,
        # A validation is not driven again here; its message names the episode.
        "found_again": None if again == [] and first.what == "validation" else again == found,
        "controller": folder.controller,
        "seed": folder.seed,
        "settings_digest": folder.digest,
        "task_functions": list(folder.task),
        "lanewise": __version__,
        "jax": jax.__version__,
    }
    with folder.held.inside(FOLDER) as place:
        write_atomically(place, {FOUND: (json.dumps(about, indent=1) + "\n").encode()})
    advice = ADVICE[first.what].format(level=first.level)
    call = f"lanewise.runs.divergence.find_first_nonfinite({str(folder.path)!r})"
    return NumbersError(
        f"{error}; training stopped, earlier chunks are kept\n"
        f"  {advice}; {call} shows it ({folder.path / FOLDER})",
        error.found,
    )


def find_first_nonfinite(path: Path | str, task: TaskFunctions = PAPER_TASK) -> FirstNonfinite:
    """Drive once more through the chunk in which a training's numbers stopped being finite.

    Iteration by iteration; compiled that way, last digits may differ from those of a whole chunk.
    ``task`` are the user's own functions that the run is trained with.

    Raises:
        RunError: the run did not diverge, or was made with other task functions.
        NumbersError: this time all numbers are finite.
    """
    folder = RunFolder.open(Path(path))
    folder.check_parts(task.names())
    place = folder.path / FOLDER
    if not (place / f"{BEFORE}.json").exists():
        raise RunError(f"{folder.path} holds no training whose numbers went wrong")
    training = TrainingPlan.build(folder.settings, folder.controller, task)
    meta = checkpoint.read_manifest(place, BEFORE, folder.digest)["meta"]
    index, chunk = meta["stage"], meta["chunks"] + 1
    shapes = training.progress(index)["state"]
    before: StageState = checkpoint.load(place, BEFORE, shapes, folder.digest).tree
    frozen: Parameters = {}
    for earlier in training.stages[:index]:
        frozen = frozen | run_state.load_stage(folder, training, earlier.name)
    plan = training.stages[index]
    iterate_once = pinned.jit()(partial(stage.iterate, plan.config, frozen, count=1))
    for iteration in range(1, CHUNK + 1):
        after, metrics = iterate_once(before)
        if found := finite_checks.findings(jax.device_get(metrics.finite)):
            found[0] = replace(found[0], iteration=iteration)
            return FirstNonfinite(
                stage=plan.name,
                chunk=chunk,
                iteration=iteration,
                found=tuple(found),
                observation=np.asarray(after.rollouts.percept.features),
                reward=_rewards(before, after, metrics),
                loss={
                    level: float(figures.loss)
                    for level, figures in metrics.levels.items()
                    if figures.updates > before.learners[level].updates
                },
                weights={level: _spoilt(learner) for level, learner in after.learners.items()},
                before=before,
                after=after,
            )
        before = after
    raise NumbersError(
        f"this time every number of {plan.name}, chunk {chunk} is finite; found had been:\n"
        f"  {meta['message']}"
    )


def _rewards(before: StageState, after: StageState, metrics: ChunkMetrics) -> NDArray[np.float32]:
    episodes = jax.device_get(metrics.episodes)
    under_way = np.asarray(after.rollouts.episode.stats.reward)
    # An episode that ended has left its world; the facts hold its sum.
    total = np.where(episodes.outcome.over[0], episodes.reward[0], under_way)
    given: NDArray[np.float32] = total - np.asarray(before.rollouts.episode.stats.reward)
    return given


def _spoilt(tree: Any) -> list[str]:
    """Names of the arrays that are not finite."""
    arrays = pytree_io.flatten(tree)
    return [name for name, values in arrays.items() if not np.isfinite(values).all()]
