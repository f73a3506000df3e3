"""The weights that a stage hands on beside its last ones, and whether they are an outlier.

Both drive validation starts by which no weights were chosen.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from lanewise.controllers.controller import Parameters
from lanewise.evaluation import evaluator
from lanewise.evaluation.episodes import Episodes
from lanewise.training import records, selection
from lanewise.training.selection import StageProgress, weighed
from lanewise.training.trainer import StagePlan

FRESH_SEED = 1
"""Of these starts."""
OUTLIER = 0.2
"""Kept weights are an outlier if their success or accidents differ from the last ones' by more."""
TOLERANCE = 0.05
"""On fresh starts, kept weights should do what they were chosen for, within this."""


def compare(plan: StagePlan, frozen: Parameters, progress: StageProgress) -> dict[str, Any]:
    """The record of a finished stage: what it hands on and its last weights, on fresh starts."""
    episodes = plan.tests.fresh_episodes

    def tested(weights: Parameters) -> Episodes:
        parameters = frozen | weights
        return evaluator.evaluate(plan.validation, parameters, FRESH_SEED, episodes)

    keep, last_chunk = plan.config.budget.keep, progress.counters.chunks
    weights, chunk = selection.result(keep, progress)
    last = tested(progress.last)
    kept = last if chunk == last_chunk else tested(weights)
    record = {
        "kind": "weights",
        "stage": plan.name,
        "rule": keep,
        "kept_chunk": chunk,
        "last_chunk": last_chunk,
        "fresh_episodes": episodes,
    }
    for prefix, found in (("last", last), ("kept", kept)):
        record |= records.of_tested(prefix, found)
        record[f"{prefix}_speed"] = float(np.mean(found.average_speed))
    return record


@dataclass(frozen=True)
class SelectedWeights:
    """What one stage of a run handed on."""

    line: Mapping[str, Any]
    """Record of the metrics, of kind ``weights``."""
    chosen_for: float | None
    """Success in the validation by which they were chosen; None for another rule."""

    @property
    def stage(self) -> str:
        """The stage's name."""
        return str(self.line["stage"])

    @property
    def score(self) -> float:
        """Their score on fresh starts, as training chooses between its own weights."""
        names = ("success_rate", "accident_rate", "reward")
        return weighed(*(self.line[f"kept_{name}"] for name in names))

    @property
    def warnings(self) -> Iterator[str]:
        """What is odd about the weights; often nothing."""
        line = self.line
        for name, what in (("success_rate", "success"), ("accident_rate", "accidents")):
            kept, last = line[f"kept_{name}"], line[f"last_{name}"]
            if abs(kept - last) > OUTLIER:
                yield (
                    f"{what} {100 * kept:.1f} % with the kept weights, {100 * last:.1f} % with the "
                    f"last ones: {self.stage} ended with other behaviour than it kept"
                )
        kept = line["kept_success_rate"]
        if self.chosen_for is not None and abs(kept - self.chosen_for) > TOLERANCE:
            yield (
                f"chosen for {100 * self.chosen_for:.1f} % success, the kept weights of "
                f"{self.stage} have {100 * kept:.1f} % on {line['fresh_episodes']:,} fresh starts"
            )


def of_run(lines: Sequence[Mapping[str, Any]]) -> list[SelectedWeights]:
    """The weights that each finished stage handed on, in order, by the run's metrics."""
    handed = (line for line in lines if line["kind"] == "weights")
    return [SelectedWeights(line, _chosen_for(line, lines)) for line in handed]


def _chosen_for(weights: Mapping[str, Any], lines: Sequence[Mapping[str, Any]]) -> float | None:
    if weights["rule"] != "best-validation":
        return None
    place = ("chunk", weights["stage"], weights["kept_chunk"])
    chunks = (line for line in lines if (line["kind"], line["stage"], line.get("chunk")) == place)
    return next((float(line["validation_success_rate"]) for line in chunks), None)
