"""Exported files where a run is expected: they drive, and say what is wrong with them."""

import json

import numpy as np
import onnx
import pytest
from test_exported_policies import untrained

import lanewise
from lanewise import config
from lanewise.errors import LanewiseError
from lanewise.evaluation import evaluator, stepwise
from lanewise.evaluation.stepwise import Lanewise
from lanewise.experiments import evaluate_trained
from lanewise.export import contents, exported, formats, policy_file
from lanewise.system.progress import Progress

SMALL = {
    "scenario.traffic.vehicles_ahead": 2,
    "evaluation.duration": 8,
    "driving.observation.noise": 0.5,
}


def save(case, path, **more):
    """A file of a controller with random weights, and that controller on a short test."""
    controller = evaluate_trained.with_changes(untrained(case), SMALL, lambda line: None)
    formats.save(contents.policy(controller, "digest", **more), path)
    return controller


SLOW = [("planned", "npz"), ("single-level", "npz"), ("hierarchical", "onnx")]


@pytest.mark.parametrize(
    ("case", "ending"),
    [
        ("hierarchical", "npz"),
        ("single-level, held", "onnx"),
        *(pytest.param(*each, marks=pytest.mark.slow) for each in SLOW),
    ],
)
def test_a_file_drives_as_the_controller_it_was_made_of(tmp_path, monkeypatch, case, ending):
    """Both decision by decision, so that noise, which makes their choices vary, is the same."""
    monkeypatch.setattr(evaluator, "BLOCK", 4)
    path = tmp_path / f"policy.{ending}"
    own = save(case, path)
    theirs, config = exported.load(path), evaluate_trained.evaluation_config(own)
    found = evaluate_trained.evaluate(theirs, "lanewise", 6, 0, Progress(quiet=True))
    wanted = stepwise.evaluate(config, stepwise.greedy(own.parameters), Lanewise(), 0, 6)
    for name, values in vars(found).items():
        np.testing.assert_array_equal(values, getattr(wanted, name), err_msg=name)
    assert len(np.unique(found.travel_distance)) > 3
    one, other = (evaluate_trained.record(each, "lanewise", 0, 5) for each in (own, theirs))
    for name in ("x", "goal_lane", "goal_speed", "goals_ended", "goals_timed_out"):
        np.testing.assert_array_equal(getattr(one, name), getattr(other, name), err_msg=name)
    assert (len(np.unique(one.goal_speed)) > 1) == (own.name != "single-level")


def three_numbers(settings, world):
    return np.zeros(3, np.float32)


def test_a_file_is_named_where_a_run_is(tmp_path, capsys):
    path = tmp_path / "policy.npz"
    save("single-level", path)
    found = lanewise.evaluate(path, episodes=1, duration=2, lanes=4, world="highway-env")
    assert found.summary.controller == "single-level"
    assert found.record().lane_centre.tolist() == [0.0, 4.0, 8.0, 12.0]
    said = capsys.readouterr().err
    assert "trained on scenario.lanes 3 (here 4) and validated for 8 s (here 2)" in said
    assert policy_file.controller_name(path) == "single-level"
    with pytest.raises(LanewiseError, match=r"returns 50 numbers; the networks .* observe 26"):
        lanewise.evaluate(
            path, task=lanewise.TaskFunctions(observe=lambda settings, world: np.zeros(50))
        )


def test_its_goals_are_renewed_as_it_was_exported(tmp_path, refused):
    path = tmp_path / "policy.npz"
    own = save("hierarchical", path, renewal="decision")
    theirs = exported.load(path)
    assert own.settings.goals.test_renewal != "decision"
    assert theirs.settings == config.replace(own.settings, {"goals.test_renewal": "decision"})
    assert "renews goals as it was exported" in refused("evaluate", path, "--renewal", "critic")


def altered(path, change):
    """The file with something else said of it."""
    with np.load(path) as held:
        arrays = dict(held)
    about = json.loads(str(arrays.pop("about")))
    change(about)
    np.savez(path, about=np.asarray(json.dumps(about)), **arrays)


@pytest.mark.parametrize(
    ("change", "says"),
    [
        (lambda about: about.pop("settings"), "does not say how its controller was trained"),
        (lambda about: about.update(seed="0"), "does not say how its controller was trained"),
        (lambda about: about.update(controller="search"), "does not say how its controller was tr"),
        (lambda about: about.update(settings="lanes = ["), "policy.npz is not valid TOML"),
        (lambda about: about.update(settings="[scenario]\nlanes = 99"), "must be between 2 and 8"),
    ],
)
def test_what_a_file_says_is_checked(tmp_path, refused, change, says):
    path = tmp_path / "policy.npz"
    save("single-level", path)
    altered(path, change)
    assert says in refused("evaluate", path)


def model_without_about(path):
    save("single-level", path)
    model = onnx.load(path)
    del model.metadata_props[:]
    onnx.save(model, path)


def model_of_another_version(path):
    save("single-level", path)
    model = onnx.load(path)
    (prop,) = (each for each in model.metadata_props if each.key == "about")
    prop.value = json.dumps(json.loads(prop.value) | {"version": 99})
    onnx.save(model, path)


@pytest.mark.parametrize(
    ("make", "says"),
    [
        (lambda path: path.write_bytes(b"junk"), "is no policy of Lanewise, or a damaged one"),
        (model_without_about, "it lacks 'about'"),
        (model_of_another_version, "has format version 99"),
        (lambda path: None, "No such file"),
    ],
)
def test_models_that_are_none_of_ours(tmp_path, refused, make, says):
    path = tmp_path / "policy.onnx"
    make(path)
    assert says in refused("evaluate", path)


@pytest.mark.parametrize("words", [("sweep", "--out", "maps"), ("export", "-o", "other.onnx")])
def test_what_needs_a_run_says_so(tmp_path, monkeypatch, refused, words):
    monkeypatch.chdir(tmp_path)
    save("single-level", tmp_path / "policy.npz")
    command, *rest = words
    assert "policy.npz is a file; give a run folder" in refused(command, "policy.npz", *rest)
