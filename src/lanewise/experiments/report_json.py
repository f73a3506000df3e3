"""The report of an experiment as JSON: every seed of every arm, with all its settings."""

import json
from typing import Any

from lanewise import config
from lanewise.evaluation import metrics
from lanewise.experiments import drives, published
from lanewise.experiments.report_data import ReportData, paired
from lanewise.experiments.results import ArmResult, SeedResult
from lanewise.report import experiment_tables
from lanewise.report.markup import finite


def text(data: ReportData) -> str:
    """The whole of `report.json`."""
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
    settings = result.seeds[0].job.settings
    return {
        "name": result.arm.name,
        "title": result.arm.title,
        "controller": result.arm.controller,
        "changes": dict(result.arm.changes),
        "settings": config.flatten(settings),
        "unlike_published": {
            "test": published.unlike_test(settings),
            "training": published.unlike_training(settings),
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
    pair = paired(seed)
    return {
        "seed": seed.job.seed,
        "trained_by": seed.trained_by,
        "tests": tests,
        "test_seconds": {world: test.seconds for world, test in seed.tests.items()},
        "paired": None if pair is None else pair.to_json(),
        "training": last,
        "weights": [dict(each.line) | {"chosen_for": each.chosen_for} for each in seed.selected],
        "effort": seed.effort or None,
    }
