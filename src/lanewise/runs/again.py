"""A training whose numbers went wrong, seen again from what `diverged` kept of it."""

from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import jax
import numpy as np
from numpy.typing import NDArray

from lanewise import pinned
from lanewise.controllers.controller import Parameters
from lanewise.driving.parts import OURS, Parts
from lanewise.errors import NumbersError, RunError
from lanewise.runs import checkpoint, resume, trained, tree
from lanewise.runs.diverged import BEFORE, FOLDER
from lanewise.runs.folder import RunFolder
from lanewise.runs.templates import Template
from lanewise.training import findings, recipe, stage
from lanewise.training.findings import Finding
from lanewise.training.stage import CHUNK, ChunkMetrics, StageState


@dataclass(frozen=True)
class Moment:
    """The first iteration of a chunk that left something behind that is not finite."""

    stage: str
    """Name of the stage."""
    chunk: int
    """Number of the chunk, as in metrics."""
    iteration: int
    """Of the chunk, from 1 on."""
    found: tuple[Finding, ...]
    """What is not finite, likely causes first."""
    observation: NDArray[np.float32]
    """[worlds, n] what every ego sees after it."""
    reward: NDArray[np.float32]
    """[worlds] what its decisions were paid."""
    loss: dict[str, float]
    """Mean loss of its updates, by level that had any."""
    weights: dict[str, list[str]]
    """Arrays of the learner that are not finite, by level that learns."""
    before: StageState
    """The stage before the iteration."""
    after: StageState
    """The stage after it."""


def see(path: Path | str, parts: Parts = OURS) -> Moment:
    """Drive once more into the chunk in which a training's numbers went wrong.

    Iteration by iteration; compiled so, last digits may differ from those of a whole chunk.

    Args:
        path: the run folder.
        parts: the user's own functions it is trained with.

    Raises:
        RunError: nothing went wrong there, or the run was made with other parts.
        CheckpointError: what was kept is damaged.
        NumbersError: this time all numbers are finite.
    """
    folder = RunFolder.open(Path(path))
    folder.check_parts(parts.names())
    place = folder.path / FOLDER
    if not (place / f"{BEFORE}.json").exists():
        raise RunError(f"{folder.path} holds no training whose numbers went wrong")

    def index_of(meta: dict[str, Any]) -> int:
        return resume.stage_of(meta, len(recipe.RECIPES[folder.controller]))

    def template(meta: dict[str, Any]) -> Template:
        return tree.shapes({"state": resume.blank(folder, index_of(meta), parts)["state"]})

    kept = checkpoint.load(place, BEFORE, template, folder.digest)
    index, chunk = index_of(kept.meta), resume.ledger_of(kept.meta).chunks + 1
    blank = {"state": resume.blank(folder, index, parts)["state"]}
    before: StageState = tree.unflatten(blank, kept.arrays)["state"]
    frozen: Parameters = {}
    for earlier in recipe.RECIPES[folder.controller][:index]:
        frozen = frozen | trained.load_stage(folder, earlier, parts)
    plan = resume.plan_of(folder, recipe.RECIPES[folder.controller][index], parts)
    once = pinned.jit()(partial(stage.iterate, plan.course, frozen, count=1))
    for iteration in range(1, CHUNK + 1):
        after, metrics = once(before)
        found = findings.of(jax.device_get(metrics.finite))
        if found:
            since = replace(found[0], iteration=iteration)
            return _moment(plan.name, chunk, iteration, (since, *found[1:]), before, after, metrics)
        before = after
    raise NumbersError(
        f"this time every number of {plan.name}, chunk {chunk} is finite; found had been:\n"
        f"  {kept.meta['message']}"
    )


def _moment(
    name: str,
    chunk: int,
    iteration: int,
    found: tuple[Finding, ...],
    before: StageState,
    after: StageState,
    metrics: ChunkMetrics,
) -> Moment:
    """What there is to see of an iteration."""
    episodes = jax.device_get(metrics.episodes)
    under_way = np.asarray(after.rollouts.episode.stats.reward)
    # An episode that ended has left its world; the facts hold its sum.
    total = np.where(episodes.outcome.over[0], episodes.reward[0], under_way)
    return Moment(
        stage=name,
        chunk=chunk,
        iteration=iteration,
        found=found,
        observation=np.asarray(after.rollouts.percept.features),
        reward=total - np.asarray(before.rollouts.episode.stats.reward),
        loss={
            level: float(figures.loss)
            for level, figures in metrics.levels.items()
            if figures.updates > before.learners[level].updates
        },
        weights={
            level: [
                array
                for array, values in tree.flatten(learner).items()
                if not np.isfinite(values).all()
            ]
            for level, learner in after.learners.items()
        },
        before=before,
        after=after,
    )
