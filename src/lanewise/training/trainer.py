"""A stage under way, seen from the host: chunk by chunk, with the weights worth keeping.

Nothing here reads or writes files or prints: every chunk returns a `Report`, and consumers stand
outside.
"""

import time
from dataclasses import dataclass, replace
from typing import Any

import jax

from lanewise.controllers.controller import Parameters
from lanewise.errors import NumbersError
from lanewise.evaluation import evaluator
from lanewise.evaluation.episodes import Episodes
from lanewise.evaluation.evaluator import EvaluationConfig
from lanewise.evaluation.settings import EvaluationSettings
from lanewise.training import finite_checks, records, selection, stage
from lanewise.training.rollout import StageConfig
from lanewise.training.selection import StageCounters, StageProgress

VALIDATION_SEED = 0
"""Validation starts are the same for every seed and stage, so that weights compete fairly."""


@dataclass(frozen=True)
class StagePlan:
    """A stage ready to run."""

    name: str
    config: StageConfig
    validation: EvaluationConfig
    tests: EvaluationSettings
    """When weights are validated, and on how many episodes."""

    def fraction(self, counters: StageCounters) -> float:
        """Share of the budget spent, 0 to 1."""
        budget = self.config.budget
        spent = ((counters.episodes, budget.episodes), (counters.decisions, budget.decisions))
        return min(1.0, max(done / limit for done, limit in spent if limit))

    def finished(self, counters: StageCounters) -> bool:
        """Whether the budget is spent; looked at between chunks."""
        return self.fraction(counters) >= 1.0


@dataclass(frozen=True)
class Report:
    """What a chunk has to say."""

    chunk: dict[str, Any]
    """Its record."""
    episodes: list[dict[str, Any]]
    """The records of the episodes completed in it, ordered by (decision, world)."""
    validation_seconds: float
    """Wall-clock time of the validation after it; about 0 without one."""


def begin(plan: StagePlan, frozen: Parameters, key: jax.Array) -> StageProgress:
    """The stage before its first chunk."""
    state = stage.begin(plan.config, frozen, key)
    weights = jax.device_get(stage.online(state.learners))
    return StageProgress(state, weights, selection.no_window(plan.config.budget.keep, weights))


def advance(
    plan: StagePlan, frozen: Parameters, progress: StageProgress
) -> tuple[StageProgress, Report]:
    """One chunk: driven, counted, and its weights validated when due; ``progress`` is consumed.

    Raises:
        NumbersError: a number is not finite; nothing of the chunk may be kept.
    """
    before, config = progress.counters, plan.config
    state, metrics = stage.advance(config, frozen, progress.state)
    metrics = jax.device_get(metrics)
    if found := finite_checks.findings(metrics.finite):
        said = found[0].said(before.decisions, config.budget.worlds)
        raise NumbersError(f"{plan.name}, chunk {before.chunks + 1}: {said}", found)
    episodes = records.of_episodes(plan.name, before, metrics.episodes)
    counters = replace(
        before,
        chunks=before.chunks + 1,
        decisions=before.decisions + stage.CHUNK * config.budget.worlds,
        episodes=before.episodes + len(episodes),
        recent=(*before.recent, *(each["reward"] for each in episodes))[-selection.RECENT :],
    )
    progress = replace(progress, state=state, counters=counters)
    began = time.perf_counter()
    validation = _validate(plan, frozen, progress)
    seconds = time.perf_counter() - began
    progress = selection.select(
        config.budget.keep, progress, validation, finished=plan.finished(counters)
    )
    levels = {name: metrics.levels[name] for name, _ in config.learning}
    chunk = records.of_chunk(plan.name, progress.counters, levels, episodes, validation)
    return progress, Report(chunk, episodes, seconds)


def _validate(plan: StagePlan, frozen: Parameters, progress: StageProgress) -> Episodes | None:
    """Greedy episodes on validation starts, when they are due."""
    counters = progress.counters
    due = counters.chunks % plan.tests.validation_interval == 0 or plan.finished(counters)
    if not due:
        return None
    parameters = frozen | stage.online(progress.state.learners)
    try:
        return evaluator.evaluate(
            plan.validation, parameters, VALIDATION_SEED, plan.tests.validation_episodes
        )
    except NumbersError as error:
        raise NumbersError(
            f"{plan.name}, validation after chunk {counters.chunks}: {error}",
            [finite_checks.Finding("validation")],
        ) from None
