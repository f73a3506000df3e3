"""A stage under way, seen from the host: chunk by chunk, with the weights worth keeping.

Nothing here reads or writes files or prints: every chunk returns a `Report`, and consumers stand
outside.
"""

import time
from dataclasses import asdict, dataclass, field, replace
from typing import Any

import jax
import numpy as np

from lanewise.controllers.controller import Parameters
from lanewise.driving.episode import EpisodeStats
from lanewise.errors import NumbersError
from lanewise.evaluation import evaluator
from lanewise.evaluation.episodes import ACCIDENTS, Episodes
from lanewise.evaluation.evaluator import EvaluationConfig
from lanewise.training import findings, selection, stage
from lanewise.training.rollout import StageConfig
from lanewise.training.stage import ChunkMetrics, StageState

VALIDATION_SEED = 0
"""Validation starts are the same for every seed and stage, so that weights compete fairly."""
FRESH_SEED = 1
"""Of validation starts by which no weights were chosen."""


@dataclass(frozen=True)
class StageCounters:
    """The host's books of a stage: plain numbers, stored with each checkpoint."""

    chunks: int = 0
    """Chunks done."""
    decisions: int = 0
    """Decisions over all worlds."""
    episodes: int = 0
    """Completed episodes."""
    recent: tuple[float, ...] = ()
    """Rewards of the last `selection.RECENT` completed episodes, ordered by (decision, world)."""
    validations: int = 0
    """Validations done."""
    window: tuple[float, ...] = ()
    """Scores of the last `selection.WINDOW` of them."""
    window_chunks: tuple[int, ...] = ()
    """When these were."""
    best_score: tuple[float, ...] = ()
    """Score of the best weights so far, compared in order; empty before the first."""
    best_chunk: int = 0
    """When they were found."""


@dataclass(frozen=True)
class StageProgress:
    """A stage between two chunks."""

    state: StageState
    best: Parameters
    """The best parameters so far of the levels that learn."""
    window: Parameters
    """Those of the last validations (`selection.put`); empty where the rule looks at none."""
    counters: StageCounters = field(default_factory=StageCounters)


@dataclass(frozen=True)
class Report:
    """What a chunk has to say."""

    chunk: dict[str, Any]
    """One line of metrics about the chunk."""
    episodes: list[dict[str, Any]]
    """One line for each episode completed in it, ordered by (decision, world)."""
    validation_seconds: float
    """Wall-clock time of the validation after it; 0 without one."""


@dataclass(frozen=True)
class StagePlan:
    """A stage ready to run."""

    name: str
    config: StageConfig
    validation: EvaluationConfig
    validation_episodes: int
    validation_interval: int
    """Chunks between validations."""
    fresh_episodes: int
    """Episodes on fresh validation starts when the stage is over."""

    @property
    def last_chunk(self) -> int | None:
        """Chunks of the whole stage, where its decisions are limited."""
        per_chunk = stage.CHUNK * self.config.budget.worlds
        decisions = self.config.budget.decisions
        return -(-decisions // per_chunk) if decisions else None

    def finished(self, counters: StageCounters) -> bool:
        """Whether the stage's budget is spent; looked at between chunks."""
        limit = self.config.budget.episodes
        by_episodes = bool(limit) and counters.episodes >= limit
        last = self.last_chunk
        return by_episodes or (last is not None and counters.chunks >= last)

    def fraction(self, counters: StageCounters) -> float:
        """Share of the budget spent, 0 to 1."""
        settings = self.config.budget
        shares = [1.0 if self.finished(counters) else 0.0]
        if settings.episodes:
            shares.append(counters.episodes / settings.episodes)
        if settings.decisions:
            shares.append(counters.decisions / settings.decisions)
        return min(1.0, max(shares))


def begin(plan: StagePlan, frozen: Parameters, key: jax.Array) -> StageProgress:
    """The stage before its first chunk."""
    state = stage.begin(plan.config, frozen, key)
    weights = jax.device_get(stage.online(state.learners))
    return StageProgress(state, weights, selection.no_window(plan.config.budget.keep, weights))


def advance(
    plan: StagePlan, frozen: Parameters, progress: StageProgress
) -> tuple[StageProgress, Report]:
    """One chunk; ``progress`` is consumed.

    Raises:
        NumbersError: a number is not finite; nothing of the chunk may be kept.
    """
    return finish_chunk(plan, frozen, progress, *stage.advance(plan.config, frozen, progress.state))


def finish_chunk(
    plan: StagePlan,
    frozen: Parameters,
    progress: StageProgress,
    state: StageState,
    metrics: ChunkMetrics,
) -> tuple[StageProgress, Report]:
    """What follows a compiled chunk: its episodes counted, its weights validated when due.

    Args:
        plan: the stage.
        frozen: parameters of levels that do not learn here.
        progress: before the chunk.
        state: after the chunk.
        metrics: the chunk's.

    Raises:
        NumbersError: a number is not finite; nothing of the chunk may be kept.
    """
    metrics = jax.device_get(metrics)
    _check_numbers(plan, progress.counters, metrics)
    lines = _episode_lines(plan, progress.counters, metrics.episodes)
    counters = _counted(plan, progress.counters, lines)
    began = time.perf_counter()
    validation = _validate(plan, frozen, state, counters)
    seconds = time.perf_counter() - began if validation is not None else 0.0
    after = _select(plan, replace(progress, state=state, counters=counters), validation)
    line = _chunk_line(plan, after.counters, metrics, lines, validation)
    return after, Report(line, lines, seconds)


def result(plan: StagePlan, progress: StageProgress) -> Parameters:
    """The parameters the stage hands on, by level that learnt."""
    return _kept(plan, progress)[0]


def _kept(plan: StagePlan, progress: StageProgress) -> tuple[Parameters, int]:
    """(parameters the stage hands on, the chunk they are of)."""
    if plan.config.budget.keep == "last" or not progress.counters.best_score:
        return _last(progress), progress.counters.chunks
    return progress.best, progress.counters.best_chunk


def _last(progress: StageProgress) -> Parameters:
    """The parameters as they are now, by level that learns."""
    now: Parameters = jax.device_get(stage.online(progress.state.learners))
    return now


def compare(plan: StagePlan, frozen: Parameters, progress: StageProgress) -> dict[str, Any]:
    """A line about a finished stage: what it hands on and its last weights, on fresh starts.

    `runs.selected_weights` says when the two are an accident.
    """
    weights, chunk = _kept(plan, progress)
    last = _fresh(plan, frozen | _last(progress))
    kept = last if chunk == progress.counters.chunks else _fresh(plan, frozen | weights)
    return {
        "kind": "weights",
        "stage": plan.name,
        "rule": plan.config.budget.keep,
        "kept_chunk": chunk,
        "last_chunk": progress.counters.chunks,
        "fresh_episodes": plan.fresh_episodes,
        **{f"last_{name}": value for name, value in last.items()},
        **{f"kept_{name}": value for name, value in kept.items()},
    }


def _fresh(plan: StagePlan, parameters: Parameters) -> dict[str, float]:
    """Figures of greedy episodes on validation starts by which no weights were chosen."""
    found = evaluator.evaluate(plan.validation, parameters, FRESH_SEED, plan.fresh_episodes)
    return _figures(found) | {"speed": float(np.mean(found.average_speed))}


def _figures(found: Episodes) -> dict[str, float]:
    """The figures of a validation that metrics hold."""
    return {
        "escape_rate": float(np.mean(found.escaped)),
        "success_rate": float(np.mean(found.success)),
        "accident_rate": float(np.mean(found.accident > 0)),
        "reward": float(np.mean(found.accumulated_reward)),
    }


def _check_numbers(plan: StagePlan, counters: StageCounters, metrics: ChunkMetrics) -> None:
    """Before anything of a chunk is kept, shown or validated."""
    found = findings.of(metrics.finite)
    if found:
        said = found[0].said(counters.decisions, plan.config.budget.worlds)
        raise NumbersError(
            f"{plan.name}, chunk {counters.chunks + 1}: {said}", tuple(map(asdict, found))
        )


def _counted(
    plan: StagePlan, counters: StageCounters, lines: list[dict[str, Any]]
) -> StageCounters:
    """The counters after a chunk with these episodes."""
    rewards = counters.recent + tuple(line["reward"] for line in lines)
    return replace(
        counters,
        chunks=counters.chunks + 1,
        decisions=counters.decisions + stage.CHUNK * plan.config.budget.worlds,
        episodes=counters.episodes + len(lines),
        recent=rewards[-selection.RECENT :],
    )


def _validate(
    plan: StagePlan, frozen: Parameters, state: StageState, counters: StageCounters
) -> Episodes | None:
    """Greedy episodes on validation starts, when they are due."""
    due = counters.chunks % plan.validation_interval == 0 or plan.finished(counters)
    if not due:
        return None
    parameters = frozen | stage.online(state.learners)
    try:
        return evaluator.evaluate(
            plan.validation, parameters, VALIDATION_SEED, plan.validation_episodes
        )
    except NumbersError as error:
        raise NumbersError(
            f"{plan.name}, validation after chunk {counters.chunks}: {error}",
            (asdict(findings.Finding("validation")),),
        ) from None


def _select(plan: StagePlan, progress: StageProgress, validation: Episodes | None) -> StageProgress:
    """The progress with the weights that the stage's rule keeps now."""
    keep, counters = plan.config.budget.keep, progress.counters
    weights = stage.online(progress.state.learners)
    if keep == "best-training" and len(counters.recent) == selection.RECENT:
        return _prefer(progress, float(np.mean(counters.recent)), counters.chunks, weights)
    if keep != "best-validation" or validation is None:
        return progress
    progress = _validated(progress, selection.score(validation), weights)
    counters = progress.counters
    if len(counters.window) < selection.WINDOW and not plan.finished(counters):
        return progress
    place = selection.median_place(counters.window)
    number = counters.validations - len(counters.window) + place
    weights = selection.taken(progress.window, number)
    return _prefer(progress, counters.window[place], counters.window_chunks[place], weights)


def _validated(progress: StageProgress, score: float, weights: Parameters) -> StageProgress:
    """The progress with one more validation in its window."""
    counters = progress.counters
    window = selection.put(progress.window, counters.validations, jax.device_get(weights))
    counters = replace(
        counters,
        validations=counters.validations + 1,
        window=(*counters.window, score)[-selection.WINDOW :],
        window_chunks=(*counters.window_chunks, counters.chunks)[-selection.WINDOW :],
    )
    return replace(progress, window=window, counters=counters)


def _prefer(
    progress: StageProgress, score: float, chunk: int, weights: Parameters
) -> StageProgress:
    """The progress with these weights as the best ones, if their score is the highest so far."""
    if progress.counters.best_score and score <= progress.counters.best_score[0]:
        return progress
    counters = replace(progress.counters, best_score=(score,), best_chunk=chunk)
    return replace(progress, best=jax.device_get(weights), counters=counters)


def _episode_lines(
    plan: StagePlan, counters: StageCounters, stats: EpisodeStats
) -> list[dict[str, Any]]:
    """A line for each completed episode; ``stats`` has axes [iteration, world]."""
    lines: list[dict[str, Any]] = []
    for iteration, world in np.argwhere(stats.outcome.over):
        at = (iteration, world)
        lines.append(
            {
                "kind": "episode",
                "stage": plan.name,
                "episode": counters.episodes + len(lines) + 1,
                "decision": counters.decisions
                + int(iteration) * plan.config.budget.worlds
                + int(world)
                + 1,
                "escaped": bool(stats.escaped[at]),
                "success": bool(stats.success[at]),
                "accident": ACCIDENTS[int(stats.outcome.accident[at])],
                "decisions": int(stats.decisions[at]),
                "reward": float(stats.reward[at]),
                "timestep_reward": float(stats.timestep_reward[at]),
                "speed": float(stats.speed_sum[at] / np.float32(stats.decisions[at])),
            }
        )
    return lines


def _level_figures(plan: StagePlan, metrics: ChunkMetrics) -> dict[str, Any]:
    """Figures of the levels that learn; those of all but the last carry the level's name."""

    def finite(value: Any) -> float | None:
        return float(value) if np.isfinite(value) else None

    figures: dict[str, Any] = {}
    names = [name for name, _ in plan.config.learning]
    for name in names:
        level = metrics.levels[name]
        prefix = "" if name == names[-1] else f"{name}_"
        figures |= {
            f"{prefix}updates": int(level.updates),
            f"{prefix}transitions": int(level.transitions),
            f"{prefix}epsilon": float(level.epsilon),
            f"{prefix}loss": finite(level.loss),
            f"{prefix}mean_q": finite(level.mean_q),
        }
    return figures


def _chunk_line(
    plan: StagePlan,
    counters: StageCounters,
    metrics: ChunkMetrics,
    lines: list[dict[str, Any]],
    validation: Episodes | None,
) -> dict[str, Any]:
    """A line about a chunk; means are null where there was nothing to average."""

    def mean(values: list[float]) -> float | None:
        return float(np.mean(values)) if values else None

    line: dict[str, Any] = {
        "kind": "chunk",
        "stage": plan.name,
        "chunk": counters.chunks,
        "decisions": counters.decisions,
        "episodes": counters.episodes,
        **_level_figures(plan, metrics),
        "escape_rate": mean([line["escaped"] for line in lines]),
        "success_rate": mean([line["success"] for line in lines]),
        "accident_rate": mean([line["accident"] != "none" for line in lines]),
        "reward": mean([line["reward"] for line in lines]),
        "timestep_reward": mean([line["timestep_reward"] for line in lines]),
        "speed": mean([line["speed"] for line in lines]),
    }
    if validation is not None:
        line |= {f"validation_{name}": value for name, value in _figures(validation).items()}
        line |= {"best_chunk": counters.best_chunk}
    return line
