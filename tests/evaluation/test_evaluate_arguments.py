"""What `lanewise.evaluate` is given besides a policy, and where its results are written."""

import dataclasses
from pathlib import Path
from typing import get_type_hints

import numpy as np
import pytest

import lanewise
from fabricate import make_episodes
from lanewise import api
from lanewise.cli.evaluate_command import Evaluate
from lanewise.errors import LanewiseError
from lanewise.evaluation import metrics
from lanewise.fields.ranges import FieldType
from lanewise.report import tables
from lanewise.runs import trained
from lanewise.scenario import trap


class Agent:
    def predict(self, observation):
        return np.full(len(observation), 4)


def idle(seen):
    return 4


def hurry(settings, world, steering, accident):
    return world.vehicles.speed[0]


def short(settings, world):
    return world.vehicles.x[:3]


def halted(settings, key, split):
    """A start that ignores `ego_driver`."""
    return trap.sample(dataclasses.replace(settings, ego_driver="controller"), key, split)


def quick_at_once(world):
    return world.vehicles.speed[0] > 0.0


OURS = "pretrained/single-level"
PARTS = lanewise.TaskFunctions(reward=hurry)
SHORT = lanewise.TaskFunctions(observe=short)
HALTED = lanewise.TaskFunctions(start=halted)
NO_COUNT = "episodes must be between 1 and 10000000, got"


@pytest.mark.parametrize(
    ("policy", "given", "said"),
    [
        # What is for policies of others is refused for ours, be it right or wrong.
        (OURS, {"actions": "gaol"}, "^actions: .* leave it out$"),
        (OURS, {"batched": False}, "^batched: .* leave it out$"),
        (OURS, {"name": "mine"}, "^name: .* leave it out$"),
        (OURS, {"deterministic": False}, "^deterministic: .* leave it out$"),
        (OURS, {"task": SHORT}, "^observe: short returns 3 numbers; the networks .* observe 26$"),
        ("reference/rule-based", {"task": HALTED}, "^start: halted must leave the ego to the rule"),
        (idle, {"actions": "gaol"}, "did you mean goal"),
        (idle, {"batched": "x"}, 'batched: expected true or false, got "x"'),
        (idle, {"name": 3}, "name: expected text, got 3"),
        (idle, {"world": "highwayenv"}, "did you mean highway-env"),
        # What makes no sense for anybody.
        (idle, {"episodes": 10_000_001}, f"{NO_COUNT} 10000001"),
        (Agent(), {"episodes": np.int64(0)}, f"{NO_COUNT} 0"),
        (OURS, {"episodes": True}, "episodes: expected a whole number, got true"),
        (Agent(), {"seed": None}, "seed: expected a whole number, got None"),
        (3.0, {}, "a policy is"),
        ("nowhere/at-all", {}, "no run"),
        ("x" * 300, {}, "cannot read .*: File name too long"),
        ("", {}, "policy: expected a path, got"),
    ],
    # Without addresses, which differ from process to process.
    ids=lambda value: ascii(value).partition(" at ")[0][:40],
)
def test_what_makes_no_sense_is_refused_before_an_episode_is_driven(
    monkeypatch, policy, given, said
):
    def drive(*_, **__):
        pytest.fail("an episode was driven")

    monkeypatch.setattr(api.evaluate_trained, "evaluate", drive)
    monkeypatch.setattr(api.stepwise, "evaluate", drive)
    with pytest.raises(LanewiseError, match=said):
        lanewise.evaluate(policy, **given)


def test_names_of_the_package_are_looked_up():
    with pytest.raises(AttributeError, match="evaluat"):
        lanewise.evaluat  # noqa: B018


def test_as_many_episodes_as_on_the_command_line():
    hint = get_type_hints(Evaluate, include_extras=True)["episodes"]
    assert FieldType.of(hint) == api.COUNT


@pytest.fixture
def found():
    episodes = make_episodes(1, 1)
    summary = metrics.summarise(episodes, controller="idle", world="lanewise")
    return lanewise.Evaluation(episodes, summary, None)


def test_both_files_are_written_or_none(found, tmp_path):
    for name in ("mine.csv", "mine.CSV"):
        with pytest.raises(LanewiseError, match=rf"cannot write .*{name}: .* end in \.json"):
            found.save(tmp_path / name)
    assert list(tmp_path.iterdir()) == []
    (tmp_path / "mine.csv").mkdir()
    with pytest.raises(LanewiseError, match=r"cannot write .*mine\.csv: a folder has that name"):
        found.save(tmp_path / "mine.json")
    assert [path.name for path in tmp_path.iterdir()] == ["mine.csv"]


@pytest.mark.parametrize("write", ["save", "clip"])
def test_results_are_written_to_paths(found, write):
    for place in ("", None, 3):
        with pytest.raises(LanewiseError, match="path: expected a path, got"):
            getattr(found, write)(place)
    for place in (".", "/"):
        with pytest.raises(LanewiseError, match="a folder has that name"):
            found.save(place)


@pytest.mark.parametrize(
    ("settings", "why"),
    [
        ({}, ""),
        ({"duration": 40}, "evaluation.duration is 40.0, not 25"),
        ({"split": "training"}, "its starts are those of training"),
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


@pytest.mark.parametrize("policy", [OURS, trained.load(Path(OURS))], ids=["path", "loaded"])
def test_a_controller_of_ours_drives_in_a_task_of_ones_own(policy, capsys):
    task = lanewise.TaskFunctions(start=halted, reward=hurry, success=quick_at_once)
    found = lanewise.evaluate(policy, task=task, episodes=3, duration=2, vehicles_ahead=0)
    assert (found.episodes.success == (found.episodes.accident == 0)).all()
    # One a second, and it is the speed, m/s.
    assert (found.episodes.accumulated_reward > 10.0).all()
    said = " ".join(capsys.readouterr().err.split())
    assert "single-level was trained on scenario.traffic.vehicles_ahead 9 (here 0), " in said
    assert f"start the paper's (here {__name__}.halted), reward the paper's (here " in said
    assert found.record(0).accumulated_reward[-1] == pytest.approx(
        found.episodes.accumulated_reward[0], rel=1e-5
    )


def test_a_controller_of_ours_brings_the_settings_that_decide_this(monkeypatch, found):
    monkeypatch.setattr(api.evaluate_trained, "evaluate", lambda *_: found.episodes)
    ours = trained.load(Path(OURS))
    assert lanewise.evaluate(ours, quiet=True).summary.unlike_paper == ""
    longer = dataclasses.replace(ours.settings.evaluation, duration=40)
    settings = dataclasses.replace(ours.settings, evaluation=longer)
    found = lanewise.evaluate(dataclasses.replace(ours, settings=settings), quiet=True)
    assert "published" not in str(found).replace(tables.LEFT_OUT, "")
    assert "single-level: evaluation.duration is 40.0, not 25" in str(found)
