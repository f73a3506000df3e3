"""A run that is stopped anywhere and continued ends in the same bytes as one that never was."""

import os
import shutil
import signal
import subprocess
import sys

import pytest
import small_runs
from small_runs import Quiet, results, resume

from lanewise import cli, version
from lanewise.errors import RunError
from lanewise.evaluation import evaluator
from lanewise.runs import checkpoint, metrics, train, trained
from lanewise.training import host, recipe

FLAGS = small_runs.flags(chunks=5)
pytestmark = pytest.mark.usefixtures("save_every_chunk", "hears_ctrl_c")


def press_ctrl_c():
    os.kill(os.getpid(), signal.SIGINT)


def create(path, seed=4, controller="hierarchical"):
    return small_runs.create(path, FLAGS, controller, seed)


@pytest.mark.parametrize(
    "at", [("step-1", 3), ("step-1", 5), ("step-2", 0), ("step-2", 2)], ids=str
)
def test_ctrl_c_and_resume_give_the_same_bytes(tmp_path, whole, at, monkeypatch):
    monkeypatch.setattr(train, "INTERVAL", 1e9)
    path = tmp_path / "run"
    with create(path) as folder, pytest.raises(KeyboardInterrupt):
        train.train(folder, None, Quiet(at, press_ctrl_c))
    assert not (path / "controller.json").exists()
    if at[1]:
        assert list(folder.checkpoints.glob(f"*chunk-{at[1]:08d}.json"))
    resume(path)
    assert results(path) == results(whole)


@pytest.mark.slow
def test_both_levels_of_h_dqn_resume_to_the_same_bytes(tmp_path, monkeypatch):
    with create(tmp_path / "whole", controller="h-dqn") as folder:
        train.train(folder, None, Quiet())
    monkeypatch.setattr(train, "INTERVAL", 1e9)
    path = tmp_path / "run"
    with create(path, controller="h-dqn") as folder, pytest.raises(KeyboardInterrupt):
        train.train(folder, None, Quiet(("h-dqn", 2), press_ctrl_c))
    resume(path)
    assert results(path) == results(tmp_path / "whole")
    stored = trained.load(path).parameters
    assert {name: weights[0][0].shape for name, weights in stored.items()} == {
        "high_level": (26, 16),
        "low_level": (28, 16),
    }


@pytest.mark.slow
@pytest.mark.parametrize("at", [6, 8])
def test_a_window_of_validations_goes_on_where_it_was(tmp_path, at, monkeypatch):
    """The weights of more validations than are held at once."""
    flags = small_runs.flags(chunks=9) | {"evaluation.validation_interval": 1}
    with small_runs.create(tmp_path / "whole", flags, "single-level", 4) as folder:
        train.train(folder, None, Quiet())
    monkeypatch.setattr(train, "INTERVAL", 1e9)
    path = tmp_path / "run"
    stopped = Quiet(("single-level", at), press_ctrl_c)
    with (
        small_runs.create(path, flags, "single-level", 4) as folder,
        pytest.raises(KeyboardInterrupt),
    ):
        train.train(folder, None, stopped)
    resume(path)
    assert results(path) == results(tmp_path / "whole")


def test_a_finished_run_needs_no_checkpoints(whole):
    assert list((whole / "checkpoints").iterdir()) == []


def test_what_is_told_of_kept_weights_is_true_of_the_controller(whole):
    told = [line for line in metrics.read(whole / "metrics.jsonl") if line["kind"] == "weights"]
    assert [line["stage"] for line in told] == ["step-1", "step-2"]
    controller = trained.load(whole)
    course = recipe.validation_course(controller.settings, recipe.RECIPES["hierarchical"][-1])
    count = told[-1]["fresh_episodes"]
    found = evaluator.evaluate(course, controller.parameters, host.FRESH_SEED, count)
    assert told[-1]["kept_reward"] == pytest.approx(found.accumulated_reward.mean())
    assert told[-1]["kept_accident_rate"] == pytest.approx((found.accident > 0).mean())


def test_ctrl_c_within_a_chunk_waits_for_its_end(tmp_path, whole, monkeypatch):
    """There the chunk's old state is consumed already, and its metrics are not yet written."""
    monkeypatch.setattr(train, "INTERVAL", 1e9)
    path, booked = tmp_path / "run", train.stages._booked

    def interrupted(plan, ledger, lines):
        if ledger.chunks == 1:
            press_ctrl_c()
        return booked(plan, ledger, lines)

    with monkeypatch.context() as patch, create(path) as folder:
        patch.setattr(train.stages, "_booked", interrupted)
        with pytest.raises(KeyboardInterrupt):
            train.train(folder, None, Quiet())
    assert [p.name for p in folder.checkpoints.glob("*.json")] == ["stage-00-chunk-00000002.json"]
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler
    resume(path)
    assert results(path) == results(whole)


def test_code_whose_training_differs_goes_on_with_a_warning(tmp_path, monkeypatch):
    path, other = tmp_path / "run", {"commit": "c" * 40, "clean_tree": True, "training": "0" * 12}
    with monkeypatch.context() as patch:
        patch.setattr(version, "source", lambda: other)
        create(path).close()
    assert notes_of_going_on(path) == [
        f"{path} was made by code that trains otherwise (training 000000000000, commit ccccccc; "
        f"here training {version.training()}): it may end in other bits than a run that never "
        "stopped; to avoid that, go on with that code, or train anew in another folder"
    ]
    monkeypatch.setattr(version, "training", lambda: "0" * 12)
    assert notes_of_going_on(path) == []


def test_a_run_that_does_not_say_which_code_made_it_goes_on_without_a_word(tmp_path, monkeypatch):
    with monkeypatch.context() as patch:
        patch.setattr(version, "source", dict)
        create(tmp_path / "run").close()
    assert notes_of_going_on(tmp_path / "run") == []


def notes_of_going_on(path):
    reporter = Quiet(("step-1", 0), press_ctrl_c)
    with pytest.raises(KeyboardInterrupt):
        resume(path, reporter)
    return reporter.notes


def test_the_end_of_a_machines_time_is_announced_by_sigterm(tmp_path, whole, monkeypatch):
    """As by a cluster's scheduler; it saves, says so, and the run resumes to the same bytes."""
    monkeypatch.setattr(train, "INTERVAL", 1e9)
    path = tmp_path / "run"
    reporter = Quiet(("step-1", 2), lambda: os.kill(os.getpid(), signal.SIGTERM))
    with create(path) as folder, pytest.raises(KeyboardInterrupt):
        train.train(folder, None, reporter)
    assert reporter.notes == ["stopping: this chunk is finished and saved first"]
    assert [p.name for p in folder.checkpoints.glob("*.json")] == ["stage-00-chunk-00000002.json"]
    assert signal.getsignal(signal.SIGTERM) is signal.SIG_DFL
    resume(path)
    assert results(path) == results(whole)


def test_a_second_ctrl_c_does_not_wait(tmp_path, whole):
    path = tmp_path / "run"

    def twice():
        press_ctrl_c()
        press_ctrl_c()

    with create(path) as folder, pytest.raises(KeyboardInterrupt):
        train.train(folder, None, Quiet(("step-1", 3), twice))
    # Not even for the third chunk to be saved.
    assert checkpoint.names(folder.checkpoints)[-1] == checkpoint.checkpoint_name(0, 2)
    resume(path)
    assert results(path) == results(whole)


KILLED = """
import os, sys
sys.path.insert(0, sys.argv[2])
import small_runs
from lanewise.runs import train
from pathlib import Path
train.INTERVAL = 0.0
with small_runs.create(Path(sys.argv[1]), small_runs.flags(chunks=5), "hierarchical", 4) as folder:
    train.train(folder, None, small_runs.Quiet(("step-1", 3), lambda: os._exit(9)))
"""


@pytest.mark.slow
def test_a_hard_kill_and_resume_give_the_same_bytes(tmp_path, whole):
    path = tmp_path / "run"
    campaigns = os.path.dirname(small_runs.__file__)
    killed = subprocess.run([sys.executable, "-c", KILLED, str(path), campaigns], check=False)
    assert killed.returncode == 9
    resume(path)
    assert results(path) == results(whole)


def test_a_finished_run_is_not_trained_again(whole):
    before = results(whole)
    with pytest.raises(RunError, match="is finished"):
        resume(whole)
    assert results(whole) == before


def test_an_altered_controller_is_refused(whole, tmp_path, capsys):
    path = shutil.copytree(whole, tmp_path / "run")
    file = path / "controller.safetensors"
    data = bytearray(file.read_bytes())
    data[-1] ^= 1
    file.write_bytes(data)
    assert cli.main(["evaluate", str(path), "--episodes", "1"]) == 2
    captured = capsys.readouterr()
    assert "was altered" in captured.err
    assert captured.out == ""
    assert "Traceback" not in captured.err


def test_a_high_level_is_taken_over_and_the_run_resumes_without_it(whole, tmp_path, monkeypatch):
    monkeypatch.setattr(train, "INTERVAL", 1e9)
    straight, broken = tmp_path / "straight", tmp_path / "broken"
    with create(straight, seed=5) as folder:
        train.train(folder, whole, Quiet())
    with create(broken, seed=5) as folder, pytest.raises(KeyboardInterrupt):
        train.train(folder, whole, Quiet(("step-2", 2), press_ctrl_c))
    resume(broken)
    assert results(broken) == results(straight)
    taken = [(path / "stages" / "step-1.safetensors").read_bytes() for path in (whole, straight)]
    assert taken[0] == taken[1]
    assert b'"stage": "step-1"' not in (straight / "metrics.jsonl").read_bytes()
    assert results(straight) != results(whole)


def test_seeds_differ(whole, tmp_path):
    path = tmp_path / "run"
    with create(path, seed=5) as folder, pytest.raises(KeyboardInterrupt):
        train.train(folder, None, Quiet(("step-1", 1), press_ctrl_c))
    ours = (path / "metrics.jsonl").read_bytes()
    assert ours != (whole / "metrics.jsonl").read_bytes()[: len(ours)]


def removed(path):
    shutil.rmtree(path)


def moved(path):
    path.rename(path.with_name("elsewhere"))


def replaced(path):
    """Another run is trained there up to its first checkpoint."""

    def stop():
        raise KeyboardInterrupt

    removed(path)
    with create(path, seed=5) as folder, pytest.raises(KeyboardInterrupt):
        train.train(folder, None, Quiet(("step-1", 2), stop))
    assert list(folder.checkpoints.glob("*.json"))


@pytest.mark.parametrize("change", [removed, moved, replaced])
def test_a_training_writes_into_no_other_folder_than_its_own(tmp_path, change):
    path, left = tmp_path / "runs" / "run", {}

    def break_in():
        change(path)
        left.update(small_runs.everything(tmp_path))

    with create(path) as folder, pytest.raises(RunError) as caught:
        train.train(folder, None, Quiet(("step-1", 2), break_in))
    first, second = str(caught.value).splitlines()
    assert f"{path} was moved, removed or replaced" in first
    assert "under its new name" in second
    found = small_runs.everything(tmp_path)
    assert found.keys() == left.keys()
    # Metrics already on their way may still reach the run that was moved.
    others = {name for name in found if "elsewhere" not in name.parts}
    assert all(found[name] == left[name] for name in others)


def test_a_moved_training_goes_on_under_its_new_name(tmp_path, whole):
    path = tmp_path / "run"
    with create(path) as folder, pytest.raises(RunError, match="was moved"):
        train.train(folder, None, Quiet(("step-1", 3), lambda: moved(path)))
    resume(tmp_path / "elsewhere")
    assert results(tmp_path / "elsewhere") == results(whole)


def test_step_1_is_taken_over_into_no_other_folder(tmp_path, whole):
    path = tmp_path / "run"
    with create(path) as folder:
        removed(path)
        with pytest.raises(RunError, match="was moved"):
            train.train(folder, whole, Quiet())
    assert not path.exists()


def test_the_figures_shown_while_training_say_how_reward_is_counted():
    line = {"success_rate": 0.5, "reward": 20.0, "timestep_reward": 10.0, "epsilon": 0.1}
    line |= {"validation_success_rate": None}
    assert train._figures(line) == {
        "success rate": 0.5,
        "reward (one a decision)": 20.0,
        "epsilon": 0.1,
    }
