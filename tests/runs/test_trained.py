"""A run named before it is finished, by a checkpoint, or by a stage."""

import shutil

import jax
import numpy as np
import pytest

from fabricate import make_episodes
from lanewise.cli.main import main
from lanewise.errors import CheckpointError, LanewiseError, RunError
from lanewise.experiments import evaluate_trained
from lanewise.runs import checkpoint, run_folder, trained
from lanewise.runs.run_folder import RunFolder
from lanewise.system.folder_io import OpenFolder
from lanewise.training.plan import TrainingPlan

NEWEST = "stage-01-chunk-00000003"


def same(first, second):
    equal = jax.tree.map(lambda a, b: bool((np.asarray(a) == np.asarray(b)).all()), first, second)
    return all(jax.tree.leaves(equal))


def stored(run, name=NEWEST):
    """A checkpoint of step 2."""
    folder = RunFolder.open(run)
    template = TrainingPlan.build(folder.settings, folder.controller).progress(1)
    return checkpoint.load(folder.checkpoints, name, template, folder.digest)


def online(found):
    learners = found.tree["state"].learners
    return {name: learner.online for name, learner in learners.items()}


def test_an_unfinished_run_has_its_last_weights_until_it_selects_some(stopped):
    found, held = trained.load(stopped), stored(stopped)
    share = f"{stopped} is unfinished: 80 % of its decisions; "
    assert found.note == f"{share}last weights of step-2 (chunk 3)"
    assert found.name == "hierarchical"
    assert same(found.parameters["low_level"], online(held)["low_level"])
    selected = held.meta["counters"] | {"best_score": [0.5], "best_chunk": 2}
    with OpenFolder(stopped / "checkpoints") as place:
        meta = held.meta | {"counters": selected}
        checkpoint.save(place, NEWEST, held.tree, meta, RunFolder.open(stopped).digest)
    again = trained.load(stopped)
    assert again.note == f"{share}weights of step-2 selected so far (chunk 2)"
    assert same(again.parameters["low_level"], held.tree["best"]["low_level"])
    assert same(again.parameters["high_level"], found.parameters["high_level"])


def test_after_its_first_step_a_run_drives_as_that_step_did(stopped):
    shutil.rmtree(stopped / "checkpoints")
    found = trained.load(stopped)
    assert found.note == f"{stopped} is unfinished: 50 % of its decisions; weights of step-1"
    assert (found.name, list(found.parameters)) == ("planned", ["high_level"])
    assert same(found.parameters, trained.load(stopped / "stages" / "step-1.json").parameters)
    with pytest.raises(RunError, match=f"has no checkpoints/{NEWEST}; it has no checkpoints$"):
        trained.load(stopped / "checkpoints" / NEWEST)
    shutil.rmtree(stopped / "stages")
    with pytest.raises(RunError, match=r"has no stages/step-1; it has no stages$"):
        trained.load(stopped / "stages" / "step-1")


@pytest.mark.parametrize("ending", ["", ".json", ".safetensors"])
def test_a_checkpoint_has_the_weights_of_its_chunk(stopped, ending):
    older = "stage-01-chunk-00000002"
    path = stopped / "checkpoints" / f"{older}{ending}"
    found = trained.load(path)
    assert found.note == f"{path} is from within a training: 70 % of its decisions"
    assert same(found.parameters["low_level"], online(stored(stopped, older))["low_level"])


def test_a_finished_run_by_its_parts(whole, stopped):
    finished = trained.load(whole)
    assert finished.note == ""
    assert same(trained.load(whole / "controller.safetensors").parameters, finished.parameters)
    by_stage = trained.load(whole / "stages" / "step-2")
    assert by_stage.note.endswith("stages/step-2 is what step-2 handed on")
    assert same(by_stage.parameters, finished.parameters)
    # As a kill leaves it between its last stage and the end.
    shutil.rmtree(stopped)
    shutil.copytree(whole, stopped)
    (stopped / "controller.json").unlink()
    again = trained.load(stopped)
    assert (again.note, again.name) == ("", "hierarchical")
    assert same(again.parameters, finished.parameters)


def test_what_is_not_there_or_damaged_is_refused(stopped, whole, tmp_path):
    older, checkpoints = "stage-01-chunk-00000002", stopped / "checkpoints"
    for path, said in (
        (checkpoints / "stage-01-chunk-00000009", f"; there: {older}, {NEWEST}"),
        (checkpoints / "stage-99-chunk-00000001", "has no checkpoints/stage-99"),
        (whole / "checkpoints" / NEWEST, f"has no checkpoints/{NEWEST}; it has no checkpoints$"),
        (stopped / "stages" / "step-2", "has no stages/step-2; there: step-1"),
        (checkpoints, "no run in .*checkpoints: looked for"),
        (tmp_path / "checkpoints" / NEWEST, f"no run in .*{NEWEST}: looked for"),
    ):
        with pytest.raises(RunError, match=said):
            trained.load(path)
    (checkpoints / f"{NEWEST}.safetensors").write_bytes(b"")
    with pytest.raises(CheckpointError, match="truncated or altered"):
        trained.load(checkpoints / NEWEST)
    found = trained.load(stopped).note
    assert "70 % of its decisions; last weights of step-2 (chunk 2); " in found
    assert f"{NEWEST}.safetensors was truncated or altered" in found
    for path in checkpoints.glob("*.safetensors"):
        path.unlink()
    with pytest.raises(LanewiseError, match="no checkpoint can be used"):
        trained.load(stopped)


def test_a_folder_called_as_one_of_a_run_is_none(tmp_path):
    for path in (tmp_path / "stages" / "h0", tmp_path / "controller"):
        path.mkdir(parents=True)
        (tmp_path / "run.json").touch()
        assert run_folder.split(path) == (path, None)


def test_commands_say_that_a_run_is_unfinished(stopped, capsys, monkeypatch, refused):
    monkeypatch.setattr(evaluate_trained, "evaluate", lambda *_: make_episodes(5, 5))
    assert main(["evaluate", str(stopped)]) == 0
    said = capsys.readouterr()
    assert "is unfinished: 80 % of its decisions; last weights of step-2" in said.err
    assert "hierarchical" in said.out
    first, second = (f"{stopped}/checkpoints/stage-01-chunk-0000000{n}.json" for n in (2, 3))
    assert main(["compare", first, second]) == 0
    assert "70 % of its decisions" in capsys.readouterr().err
    assert "are the same run twice" in refused("compare", first, first.removesuffix(".json"))
    out = stopped.parent / "policy.npz"
    assert main(["export", str(stopped), "-o", str(out)]) == 0
    assert "is unfinished" in capsys.readouterr().err
