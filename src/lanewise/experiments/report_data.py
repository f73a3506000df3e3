"""The data of an experiment's report, and the same as JSON."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from lanewise import config
from lanewise.evaluation import metrics
from lanewise.evaluation.metrics import Paired, Summary
from lanewise.evaluation.settings import WORLDS
from lanewise.experiments import drives
from lanewise.experiments.claims import Claim
from lanewise.experiments.experiment import Experiment
from lanewise.experiments.results import ArmResult, SeedResult
from lanewise.report import experiment_tables
from lanewise.report.experiment_tables import ArmFigures
from lanewise.report.markup import finite
from lanewise.runs.selected_weights import SelectedWeights


@dataclass(frozen=True)
class ReportData:
    """Everything the report says."""

    experiment: Experiment
    command: str
    results: Sequence[ArmResult]
    ledger: Sequence[Claim]
    drawn: Mapping[str, str]
    """Captions of the figures, by their names."""
    made: Mapping[str, Any]
    """Date, versions, machine."""
    times: Mapping[str, float]
    """Seconds by part of the work done now."""

    @property
    def figures(self) -> list[ArmFigures]:
        """What the tables need."""
        return [result.figures for result in self.results]

    @property
    def summaries(self) -> list[Summary]:
        """Every test, arm by arm and world by world."""
        return [s for arm in self.figures for world in WORLDS for s in arm.tests.get(world, ())]

    @property
    def worlds(self) -> list[str]:
        """Where any arm was tested."""
        return [w for w in WORLDS if any(arm.tests.get(w) for arm in self.figures)]

    @property
    def several_seeds(self) -> bool:
        """Whether there is anything to say about seeds."""
        return any(len(result.seeds) > 1 for result in self.results)

    @property
    def arm_by_arm(self) -> bool:
        """Whether tables want a row an arm: one seed of each controller needs no arms' names."""
        controllers = [result.arm.controller for result in self.results]
        return self.several_seeds or len(set(controllers)) < len(controllers)

    @property
    def selected(self) -> dict[str, list[tuple[int, SelectedWeights]]]:
        """By title of an arm's stage, the seeds and the weights each handed on."""
        found: dict[str, list[tuple[int, SelectedWeights]]] = {}
        for result in self.results:
            for seed in result.seeds:
                for each in seed.selected:
                    stage = f", {each.stage}" if len(seed.selected) > 1 else ""
                    found.setdefault(result.arm.title + stage, []).append((seed.job.seed, each))
        return found

    @property
    def paired(self) -> dict[str, dict[int, Paired]]:
        """By arm and seed: the same starts in both worlds."""
        found = {
            arm.arm.name: {each.job.seed: each.paired for each in arm.seeds if each.paired}
            for arm in self.results
        }
        return {name: pairs for name, pairs in found.items() if pairs}


def as_json(data: ReportData) -> str:
    """The whole of ``report.json``: every seed of every arm, with all its settings."""
    stored = {
        "title": data.experiment.title,
        "command": data.command,
        **data.made,
        "preset": data.experiment.preset,
        "published": {"test": metrics.PUBLISHED, "training": metrics.PUBLISHED_TRAINING},
        "arms": [_arm_json(result) for result in data.results],
        "claims": [
            {"claim": c.text, "verdict": c.verdict, "seeds": list(c.seeds), "measured": c.figures}
            for c in data.ledger
        ],
        "times": dict(data.times),
    }
    return json.dumps(finite(stored), indent=1, allow_nan=False, ensure_ascii=False) + "\n"


def _arm_json(result: ArmResult) -> dict[str, Any]:
    return {
        "name": result.arm.name,
        "title": result.arm.title,
        "controller": result.arm.controller,
        "changes": dict(result.arm.changes),
        "settings": config.flatten(result.settings),
        "unlike_published": {
            "test": result.figures.unlike_paper,
            "training": result.figures.unlike_papers_training,
        },
        "median_seed": drives.median_seed(result.seeds).job.seed,
        "seeds": [_seed_json(seed) for seed in result.seeds],
    }


def _seed_json(seed: SeedResult) -> dict[str, Any]:
    tests = {world: test.summary.to_json() for world, test in seed.tests.items()}
    last = {
        name: experiment_tables.last_mean(seed.episodes, name)
        for name, *_ in experiment_tables.TRAINING
        if seed.job.trains
    }
    return {
        "seed": seed.job.seed,
        "trained_by": seed.trained_by,
        "tests": tests,
        "test_seconds": {world: test.seconds for world, test in seed.tests.items()},
        "paired": None if seed.paired is None else seed.paired.to_json(),
        "training": last,
        "weights": [dict(each.line) | {"chosen_for": each.chosen_for} for each in seed.selected],
        "effort": seed.effort or None,
    }
