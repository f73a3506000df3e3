"""What `lanewise.evaluate` is given besides a policy, and where its results are written."""

import dataclasses
from pathlib import Path
from typing import get_type_hints

import numpy as np
import pytest

import lanewise
from lanewise import api
from lanewise.cli.evaluate_command import Evaluate
from lanewise.errors import LanewiseError
from lanewise.evaluation import metrics
from lanewise.evaluation.episodes import Episodes
from lanewise.fields.ranges import FieldType
from lanewise.report import tables
from lanewise.runs import trained


class Agent:
    def predict(self, observation):
        return np.full(len(observation), 4)


def idle(seen):
    return 4


def hurry(settings, world, steering, accident):
    return world.vehicles.speed[0]


OURS = ("pretrained/single-level", "reference/rule-based")
PARTS = lanewise.TaskFunctions(reward=hurry)


@pytest.fixture
def driven(monkeypatch):
    """Reached only by a test that was not refused."""

    def drive(*_, **__):
        pytest.fail("an episode was driven")

    monkeypatch.setattr(api.evaluate_trained, "evaluate", drive)
    monkeypatch.setattr(api.stepwise, "evaluate", drive)


@pytest.mark.usefixtures("driven")
@pytest.mark.parametrize("policy", OURS)
@pytest.mark.parametrize(
    "given",
    [
        {"actions": "gaol"},
        {"actions": "low-level"},
        {"batched": "x"},
        {"batched": False},
        {"name": 3},
        {"name": "mine"},
    ],
    ids=str,
)
def test_what_is_for_policies_of_others_is_refused_for_ours(policy, given):
    (option,) = given
    with pytest.raises(LanewiseError, match=rf"^{option}: .* leave it out$"):
        lanewise.evaluate(policy, **given)


@pytest.mark.usefixtures("driven")
@pytest.mark.parametrize(
    ("given", "said"),
    [
        ({"actions": "gaol"}, "did you mean goal"),
        ({"batched": "x"}, 'batched: expected true or false, got "x"'),
        ({"name": 3}, "name: expected text, got 3"),
    ],
    ids=str,
)
def test_what_makes_no_sense_for_a_function(given, said):
    with pytest.raises(LanewiseError, match=said):
        lanewise.evaluate(idle, **given)


@pytest.mark.usefixtures("driven")
@pytest.mark.parametrize("policy", [*OURS, idle, Agent()], ids=["ours", "reference", "f", "agent"])
@pytest.mark.parametrize(
    ("given", "said"),
    [
        ({"episodes": 10**30}, "episodes must be between 1 and 10000000, got 1000"),
        ({"episodes": 10_000_001}, "episodes must be between 1 and 10000000, got 10000001"),
        ({"episodes": 0}, "episodes must be between 1 and 10000000, got 0"),
        ({"episodes": np.int64(0)}, "episodes must be between 1 and 10000000, got 0"),
        ({"episodes": True}, "episodes: expected a whole number, got true"),
        ({"episodes": 2.0}, "episodes: expected a whole number, got 2.0"),
        ({"quiet": "yes"}, 'quiet: expected true or false, got "yes"'),
        ({"seed": None}, "seed: expected a whole number, got None"),
    ],
    ids=str,
)
def test_what_makes_no_sense_for_anybody(policy, given, said):
    with pytest.raises(LanewiseError, match=said):
        lanewise.evaluate(policy, **given)


@pytest.mark.usefixtures("driven")
def test_an_object_with_predict_is_always_asked_with_batches():
    with pytest.raises(LanewiseError, match=r"batched: .* leave it out"):
        lanewise.evaluate(Agent(), batched=False)


@pytest.mark.usefixtures("driven")
def test_parts_that_a_controller_was_not_trained_with_are_not_passed_over():
    said = "task: .* made with no task functions of the user's own"
    with pytest.raises(LanewiseError, match=said):
        lanewise.evaluate("reference/rule-based", task=PARTS)
    with pytest.raises(LanewiseError, match=said):
        lanewise.evaluate(trained.load(Path("reference/search")), task=PARTS)


def test_as_many_episodes_as_on_the_command_line():
    hint = get_type_hints(Evaluate, include_extras=True)["episodes"]
    assert FieldType.of(hint) == api.COUNT


@pytest.mark.usefixtures("driven")
@pytest.mark.parametrize("policy", ["a\0b", "a\ud800b", ""], ids=ascii)
def test_what_is_no_path_is_refused(policy):
    with pytest.raises(LanewiseError, match="policy: expected a path, got"):
        lanewise.evaluate(policy)


def test_a_name_too_long_for_a_file_is_refused():
    with pytest.raises(LanewiseError, match=r"cannot read .*: File name too long"):
        lanewise.evaluate("x" * 300)


@pytest.fixture
def found():
    """An episode without an accident, as from a test."""
    fields = dataclasses.fields(Episodes)
    episodes = Episodes(**{each.name: np.zeros(1, np.int64) for each in fields})
    summary = metrics.summarise(episodes, controller="idle", world="lanewise")
    return lanewise.Evaluation(episodes, summary, None)


@pytest.mark.parametrize("name", ["mine.csv", "mine.CSV"])
def test_the_metrics_are_not_overwritten_by_the_episodes(found, tmp_path, name):
    with pytest.raises(LanewiseError, match=rf"cannot write .*{name}: .* end in \.json"):
        found.save(tmp_path / name)
    assert list(tmp_path.iterdir()) == []


def test_both_files_are_written_or_none(found, tmp_path):
    (tmp_path / "mine.csv").mkdir()
    with pytest.raises(LanewiseError, match=r"cannot write .*mine\.csv: a folder has that name"):
        found.save(tmp_path / "mine.json")
    assert [path.name for path in tmp_path.iterdir()] == ["mine.csv"]


@pytest.mark.parametrize("place", ["a\0b", "", None, 3], ids=ascii)
@pytest.mark.parametrize("write", ["save", "clip"])
def test_results_are_written_to_paths(found, write, place):
    with pytest.raises(LanewiseError, match="path: expected a path, got"):
        getattr(found, write)(place)


@pytest.mark.parametrize("place", [".", "/"])
def test_results_are_not_written_to_folders(found, place):
    with pytest.raises(LanewiseError, match="a folder has that name"):
        found.save(place)


@pytest.mark.parametrize(
    ("settings", "why"),
    [
        ({}, ""),
        ({"scaling": "highway-env", "goals": {"time_limit": 9.0}}, ""),
        ({"duration": 40}, "evaluation.duration is 40.0, not 25"),
        ({"trap": "trap-10.9"}, "scenario.trap_speed is 10.9, not 10.0"),
        ({"preset": "ranges"}, ""),
        ({"split": "training"}, "its starts are those of training"),
        ({"accident_penalty": 1.0}, "driving.reward.accident_penalty is 1.0, not 10.0"),
        ({"task": PARTS}, f"reward: {__name__}.hurry"),
    ],
    # Not the text of a function, in which its address stands.
    ids=lambda given: "-".join(given) if isinstance(given, dict) else "",
)
def test_the_published_figures_stand_beside_the_papers_test_alone(
    monkeypatch, found, settings, why
):
    monkeypatch.setattr(api.stepwise, "evaluate", lambda *_: found.episodes)
    tested = lanewise.evaluate(idle, name="hierarchical", quiet=True, **settings)
    assert tested.summary.unlike_paper == why
    for shown in (str(tested), tested.table()):
        assert ("97.67" in shown) == (why == "")
        assert (tables.LEFT_OUT in shown) == (why != "")
    assert tested.summary.to_json().keys() == found.summary.to_json().keys()


def test_a_controller_of_ours_brings_the_settings_that_decide_this(monkeypatch, found):
    monkeypatch.setattr(api.evaluate_trained, "evaluate", lambda *_: found.episodes)
    ours = trained.load(Path("pretrained/single-level"))
    assert lanewise.evaluate(ours, quiet=True).summary.unlike_paper == ""
    longer = dataclasses.replace(ours.settings.evaluation, duration=40)
    other = dataclasses.replace(
        ours, settings=dataclasses.replace(ours.settings, evaluation=longer)
    )
    found = lanewise.evaluate(other, quiet=True)
    assert "published" not in str(found).replace(tables.LEFT_OUT, "")
    assert "single-level: evaluation.duration is 40.0, not 25" in str(found)
