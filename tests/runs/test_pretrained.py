"""Controllers called by name: they are there, and drive as their provenance says."""

import json
from pathlib import Path

import numpy as np
import pytest

from lanewise.errors import RunError
from lanewise.evaluation import evaluator
from lanewise.runs import pretrained, trained
from lanewise.training import recipe, selection

NAMES = ("driver", "hierarchical", "single-level")


def provenance(name):
    return json.loads((pretrained.PRETRAINED / name / "provenance.json").read_text())


def test_they_are_there_and_small():
    assert pretrained.names() == NAMES
    files = [path for path in pretrained.PRETRAINED.rglob("*") if path.is_file()]
    assert sum(path.stat().st_size for path in files) < 5e6


@pytest.mark.parametrize("name", NAMES)
def test_they_are_loaded(name):
    story, controller = provenance(name), trained.load(Path("pretrained") / name)
    assert (controller.name, controller.seed) == (story["controller"], story["seed"])


@pytest.mark.parametrize(
    "name", ["driver", *(pytest.param(name, marks=pytest.mark.slow) for name in NAMES[1:])]
)
def test_they_drive_as_they_did_when_they_were_made(name):
    story, controller = provenance(name), trained.load(Path("pretrained") / name)
    stored = story["tests"]["lanewise"]["summary"]
    config = recipe.evaluation_config(controller.settings, controller.name)
    found = evaluator.evaluate(config, controller.parameters, controller.seed, stored["episodes"])
    # Another processor may round otherwise; on one machine the figures are the same.
    assert np.mean(found.success) == pytest.approx(stored["success_rate"], abs=0.02)
    assert np.mean(found.accumulated_reward) == pytest.approx(
        stored["accumulated_reward"], rel=0.02
    )


@pytest.mark.parametrize("name", NAMES)
def test_they_were_chosen_on_validation_starts(name):
    def score(seed):
        figures = ("success_rate", "accident_rate", "reward")
        return selection.weighed(*(candidates[seed][f"validation_{each}"] for each in figures))

    story = provenance(name)
    candidates = story["candidates"]
    assert len(candidates) >= 3
    place = {"best": -1, "median": (len(candidates) - 1) // 2}[story.get("chosen", "best")]
    chosen = sorted(candidates, key=score)[place]
    assert chosen == f"seed-{story['seed']}"
    assert candidates[chosen] == list(story["validation"].values())[-1]


def test_references_are_called_by_name():
    assert pretrained.controller_name(Path("reference/search")) == "search"
    loaded = trained.load(Path("reference/rule-based"))
    assert (loaded.name, loaded.parameters) == ("rule-based", {})


@pytest.mark.parametrize(
    ("path", "hint"),
    [
        ("reference/rulebased", "did you mean rule-based?"),
        ("pretrained/nobody", "there is no pretrained controller"),
        ("reference/../search", "no run in"),
    ],
)
def test_unknown_names(path, hint):
    with pytest.raises(RunError) as caught:
        trained.load(Path(path))
    assert hint in str(caught.value)
