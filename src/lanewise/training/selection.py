"""Which weights a stage hands on (row 27 of the reading).

``best-training``    those with the best mean reward over 10 training episodes (the paper's rule
                     for step 1)
``best-validation``  of every `WINDOW` validations in a row the weights with the median score, and
                     of these the best: one lucky validation is never a median
``last``             those at the end
"""

from dataclasses import dataclass, field, replace
from statistics import median_low
from typing import Any

import jax
import numpy as np

from lanewise.controllers.controller import Parameters
from lanewise.evaluation.episodes import Episodes
from lanewise.training import stage
from lanewise.training.stage import StageState

RECENT = 10
"""Training episodes over which `best-training` averages (the paper's 10)."""
WINDOW = 5
"""Validations in a row, of which `best-validation` takes the median."""
REWARD_SCALE = 50.0
"""In a validation's score, this much more reward weighs as much as success in every episode."""


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
    """Rewards of the last `RECENT` completed episodes, ordered by (decision, world)."""
    validations: int = 0
    """Validations done."""
    window: tuple[float, ...] = ()
    """Scores of the last `WINDOW` of them."""
    window_chunks: tuple[int, ...] = ()
    """When these were."""
    best_score: tuple[float, ...] = ()
    """Score of the best weights so far; empty before the first."""
    best_chunk: int = 0
    """When they were found."""


@dataclass(frozen=True)
class StageProgress:
    """A stage between two chunks."""

    state: StageState
    best: Parameters
    """The best parameters so far of the levels that learn."""
    window: Parameters
    """Those of the last `WINDOW` validations, along a leading axis; empty where the rule looks at
    no validation."""
    counters: StageCounters = field(default_factory=StageCounters)

    @classmethod
    def restored(cls, arrays: dict[str, Any], counters: dict[str, Any]) -> "StageProgress":
        """Of `arrays` and the fields of the counters as JSON has them, lists for tuples."""
        best, window = jax.device_get((arrays["best"], arrays["window"]))
        plain: dict[str, Any] = {
            name: tuple(value) if isinstance(value, list) else value
            for name, value in counters.items()
        }
        return cls(arrays["state"], best, window, StageCounters(**plain))

    @property
    def arrays(self) -> dict[str, Any]:
        """What a checkpoint holds of it, beside the counters."""
        return {"state": self.state, "best": self.best, "window": self.window}

    @property
    def last(self) -> Parameters:
        """The parameters as they are now, by level that learns."""
        now: Parameters = jax.device_get(stage.online(self.state.learners))
        return now


def weighed(success_rate: float, accident_rate: float, reward: float) -> float:
    """The score of weights by a validation, its reward one a second: success first."""
    return success_rate - accident_rate + reward / REWARD_SCALE


def no_window(keep: str, weights: Parameters) -> Parameters:
    """Room for the weights of `WINDOW` validations; none where the rule looks at no validation."""
    if keep != "best-validation":
        return {}
    room: Parameters = jax.tree.map(
        lambda leaf: np.zeros((WINDOW, *leaf.shape), leaf.dtype), weights
    )
    return room


def select(
    keep: str, progress: StageProgress, validation: Episodes | None, finished: bool
) -> StageProgress:
    """The progress with the weights that a rule keeps after a chunk.

    ``validation`` is of the weights as they are now; ``finished`` is true after the last chunk.
    """
    counters = progress.counters
    if keep == "best-training" and len(counters.recent) == RECENT:
        return _prefer(progress, float(np.mean(counters.recent)), counters.chunks, progress.last)
    if keep != "best-validation" or validation is None:
        return progress
    progress = _validated(progress, validation)
    counters = progress.counters
    if len(counters.window) < WINDOW and not finished:
        return progress
    # Equal scores count in order of time; of an even number of validations the lower one is taken.
    score, place = median_low((each, place) for place, each in enumerate(counters.window))
    number = counters.validations - len(counters.window) + place
    weights = jax.tree.map(lambda room: room[number % WINDOW], progress.window)
    return _prefer(progress, score, counters.window_chunks[place], weights)


def result(keep: str, progress: StageProgress) -> tuple[Parameters, int]:
    """(the parameters that a stage hands on, the chunk they are of)."""
    if keep == "last" or not progress.counters.best_score:
        return progress.last, progress.counters.chunks
    return progress.best, progress.counters.best_chunk


def _validated(progress: StageProgress, validation: Episodes) -> StageProgress:
    """The progress with one more validation in its window, in place of the oldest."""
    counters = progress.counters

    def placed(room: np.ndarray, leaf: jax.Array) -> np.ndarray:
        room = room.copy()
        room[counters.validations % WINDOW] = leaf
        return room

    score = weighed(
        float(np.mean(validation.success)),
        float(np.mean(validation.accident > 0)),
        float(np.mean(validation.accumulated_reward)),
    )
    counters_after = replace(
        counters,
        validations=counters.validations + 1,
        window=(*counters.window, score)[-WINDOW:],
        window_chunks=(*counters.window_chunks, counters.chunks)[-WINDOW:],
    )
    window = jax.tree.map(placed, progress.window, progress.last)
    return replace(progress, window=window, counters=counters_after)


def _prefer(
    progress: StageProgress, score: float, chunk: int, weights: Parameters
) -> StageProgress:
    """The progress with these weights as the best ones, if their score is the highest so far."""
    if progress.counters.best_score and score <= progress.counters.best_score[0]:
        return progress
    counters = replace(progress.counters, best_score=(score,), best_chunk=chunk)
    return replace(progress, best=weights, counters=counters)
