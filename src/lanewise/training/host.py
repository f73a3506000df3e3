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
from lanewise.errors import NumbersError
from lanewise.evaluation import drive
from lanewise.evaluation.drive import TestCourse
from lanewise.evaluation.episodes import ACCIDENTS, Episodes
from lanewise.training import findings, stage
from lanewise.training.rollout import Course, Finished
from lanewise.training.stage import ChunkMetrics, StageState

RECENT = 10
"""Training episodes over which `best-training` averages (the paper's 10)."""
REWARD_SCALE = 50.0
"""In `best-validation`, this much more reward weighs as much as success in every episode."""
VALIDATION_SEED = 0
"""Validation starts are the same for every seed and stage, so that weights compete fairly."""


@dataclass(frozen=True)
class Ledger:
    """The host's books of a stage: plain numbers, stored with each checkpoint."""

    chunks: int = 0
    """Chunks done."""
    decisions: int = 0
    """Decisions over all worlds."""
    episodes: int = 0
    """Completed episodes."""
    recent: tuple[float, ...] = ()
    """Rewards of the last `RECENT` completed episodes, ordered by (decision, world)."""
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
    ledger: Ledger = field(default_factory=Ledger)


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
    course: Course
    validation: TestCourse
    validation_episodes: int
    validation_interval: int
    """Chunks between validations."""

    @property
    def last_chunk(self) -> int | None:
        """Chunks of the whole stage, where its decisions are limited."""
        per_chunk = stage.CHUNK * self.course.budget.worlds
        decisions = self.course.budget.decisions
        return -(-decisions // per_chunk) if decisions else None

    def finished(self, ledger: Ledger) -> bool:
        """Whether the stage's budget is spent; looked at between chunks."""
        limit = self.course.budget.episodes
        by_episodes = bool(limit) and ledger.episodes >= limit
        last = self.last_chunk
        return by_episodes or (last is not None and ledger.chunks >= last)

    def fraction(self, ledger: Ledger) -> float:
        """Share of the budget spent, 0 to 1."""
        settings = self.course.budget
        shares = [1.0 if self.finished(ledger) else 0.0]
        if settings.episodes:
            shares.append(ledger.episodes / settings.episodes)
        if settings.decisions:
            shares.append(ledger.decisions / settings.decisions)
        return min(1.0, max(shares))


def begin(plan: StagePlan, frozen: Parameters, key: jax.Array) -> StageProgress:
    """The stage before its first chunk."""
    state = stage.begin(plan.course, frozen, key)
    return StageProgress(state=state, best=jax.device_get(stage.online(state.learners)))


def advance(
    plan: StagePlan, frozen: Parameters, progress: StageProgress
) -> tuple[StageProgress, Report]:
    """One chunk; ``progress`` is consumed.

    Raises:
        NumbersError: a number is not finite; nothing of the chunk may be kept.
    """
    return book(plan, frozen, progress, *stage.advance(plan.course, frozen, progress.state))


def book(
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
    _check_numbers(plan, progress.ledger, metrics)
    lines = _episode_lines(plan, progress.ledger, metrics.finished)
    ledger = _booked(plan, progress.ledger, lines)
    began = time.perf_counter()
    validation = _validate(plan, frozen, state, ledger)
    seconds = time.perf_counter() - began if validation is not None else 0.0
    score = _score(plan, ledger, validation)
    best = progress.best
    if score and score > ledger.best_score:
        best = jax.device_get(stage.online(state.learners))
        ledger = replace(ledger, best_score=score, best_chunk=ledger.chunks)
    line = _chunk_line(plan, ledger, metrics, lines, validation)
    return StageProgress(state, best, ledger), Report(line, lines, seconds)


def result(progress: StageProgress, keep: str) -> Parameters:
    """The parameters the stage hands on, by level that learnt."""
    if keep == "last" or not progress.ledger.best_score:
        last: Parameters = jax.device_get(stage.online(progress.state.learners))
        return last
    return progress.best


def _check_numbers(plan: StagePlan, ledger: Ledger, metrics: ChunkMetrics) -> None:
    """Before anything of a chunk is kept, shown or validated."""
    found = findings.of(metrics.finite)
    if found:
        said = found[0].said(ledger.decisions, plan.course.budget.worlds)
        raise NumbersError(
            f"{plan.name}, chunk {ledger.chunks + 1}: {said}", tuple(map(asdict, found))
        )


def _booked(plan: StagePlan, ledger: Ledger, lines: list[dict[str, Any]]) -> Ledger:
    """The ledger after a chunk with these episodes."""
    rewards = ledger.recent + tuple(line["reward"] for line in lines)
    return replace(
        ledger,
        chunks=ledger.chunks + 1,
        decisions=ledger.decisions + stage.CHUNK * plan.course.budget.worlds,
        episodes=ledger.episodes + len(lines),
        recent=rewards[-RECENT:],
    )


def _validate(
    plan: StagePlan, frozen: Parameters, state: StageState, ledger: Ledger
) -> Episodes | None:
    """Greedy episodes on validation starts, when they are due."""
    due = ledger.chunks % plan.validation_interval == 0 or plan.finished(ledger)
    if not due:
        return None
    parameters = frozen | stage.online(state.learners)
    try:
        return drive.test(plan.validation, parameters, VALIDATION_SEED, plan.validation_episodes)
    except NumbersError as error:
        raise NumbersError(
            f"{plan.name}, validation after chunk {ledger.chunks}: {error}",
            (asdict(findings.Finding("validation")),),
        ) from None


def _score(plan: StagePlan, ledger: Ledger, validation: Episodes | None) -> tuple[float, ...]:
    """Score of the current weights by the stage's rule; empty where the rule has nothing to say."""
    keep = plan.course.budget.keep
    if keep == "best-validation" and validation is not None:
        success, accidents = np.mean(validation.success), np.mean(validation.accident > 0)
        reward = np.mean(validation.accumulated_reward)
        return (merit(float(success), float(accidents), float(reward)),)
    if keep == "best-training" and len(ledger.recent) == RECENT:
        return (float(np.mean(ledger.recent)),)
    return ()


def merit(success_rate: float, accident_rate: float, reward: float) -> float:
    """What weights are worth by their validation: success first, then reward (row 27)."""
    return success_rate - accident_rate + reward / REWARD_SCALE


def _episode_lines(plan: StagePlan, ledger: Ledger, finished: Finished) -> list[dict[str, Any]]:
    """A line for each completed episode; ``finished`` has axes [iteration, world]."""
    lines: list[dict[str, Any]] = []
    for iteration, world in np.argwhere(finished.done):
        at = (iteration, world)
        lines.append(
            {
                "kind": "episode",
                "stage": plan.name,
                "episode": ledger.episodes + len(lines) + 1,
                "decision": ledger.decisions
                + int(iteration) * plan.course.budget.worlds
                + int(world)
                + 1,
                "escaped": bool(finished.escaped[at]),
                "success": bool(finished.success[at]),
                "accident": ACCIDENTS[int(finished.accident[at])],
                "decisions": int(finished.decisions[at]),
                "reward": float(finished.reward[at]),
                "timestep_reward": float(finished.timestep_reward[at]),
                "speed": float(finished.average_speed[at]),
            }
        )
    return lines


def _level_figures(plan: StagePlan, metrics: ChunkMetrics) -> dict[str, Any]:
    """Figures of the levels that learn; those of all but the last carry the level's name."""

    def finite(value: Any) -> float | None:
        return float(value) if np.isfinite(value) else None

    figures: dict[str, Any] = {}
    names = [name for name, _ in plan.course.learning]
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
    ledger: Ledger,
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
        "chunk": ledger.chunks,
        "decisions": ledger.decisions,
        "episodes": ledger.episodes,
        **_level_figures(plan, metrics),
        "escape_rate": mean([line["escaped"] for line in lines]),
        "success_rate": mean([line["success"] for line in lines]),
        "accident_rate": mean([line["accident"] != "none" for line in lines]),
        "reward": mean([line["reward"] for line in lines]),
        "timestep_reward": mean([line["timestep_reward"] for line in lines]),
        "speed": mean([line["speed"] for line in lines]),
    }
    if validation is not None:
        line |= {
            "validation_escape_rate": float(np.mean(validation.escaped)),
            "validation_success_rate": float(np.mean(validation.success)),
            "validation_accident_rate": float(np.mean(validation.accident > 0)),
            "validation_reward": float(np.mean(validation.accumulated_reward)),
            "best_chunk": ledger.best_chunk,
        }
    return line
