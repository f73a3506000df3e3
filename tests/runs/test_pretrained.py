"""Controllers that come with the package: they are there, and drive as their provenance says."""

import json
from pathlib import Path

import numpy as np
import pytest

from lanewise.evaluation import evaluator
from lanewise.runs import shelf, trained
from lanewise.training import recipe, selection

NAMES = ("hierarchical", "single-level")


def provenance(name):
    return json.loads((shelf.PRETRAINED / name / "provenance.json").read_text())


def test_both_are_there_and_small():
    assert shelf.pretrained() == NAMES
    files = [path for path in shelf.PRETRAINED.rglob("*") if path.is_file()]
    assert sum(path.stat().st_size for path in files) < 5e6


@pytest.mark.parametrize("name", NAMES)
def test_they_drive_as_they_did_when_they_were_made(name):
    story, controller = provenance(name), trained.load(Path("pretrained") / name)
    assert (controller.name, controller.seed) == (story["controller"], story["seed"])
    stored = story["tests"]["lanewise"]["summary"]
    course = recipe.test_course(controller.settings, controller.name)
    found = evaluator.evaluate(course, controller.parameters, controller.seed, stored["episodes"])
    # Another processor may round otherwise; on one machine the figures are the same.
    assert np.mean(found.success) == pytest.approx(stored["success_rate"], abs=0.02)
    assert np.mean(found.accumulated_reward) == pytest.approx(
        stored["accumulated_reward"], rel=0.02
    )


@pytest.mark.parametrize("name", NAMES)
def test_they_were_chosen_on_validation_starts(name):
    def merit(figures):
        names = ("success_rate", "accident_rate", "reward")
        return selection.weighed(*(figures[f"validation_{name}"] for name in names))

    story = provenance(name)
    candidates = story["candidates"]
    assert len(candidates) == 5
    best = max(candidates, key=lambda seed: merit(candidates[seed]))
    assert best == f"seed-{story['seed']}"
    assert candidates[best] == list(story["validation"].values())[-1]
