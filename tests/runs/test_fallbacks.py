"""A stopped run that lost something goes on from what is left, and says so; or it is refused."""

import os
import shutil

import pytest
from small_runs import Quiet, results, resume
from test_train import create, press_ctrl_c

from lanewise.cli.main import main
from lanewise.errors import LanewiseError
from lanewise.runs import checkpoint, files, train

pytestmark = pytest.mark.usefixtures("save_every_chunk", "hears_ctrl_c")


@pytest.fixture(scope="module")
def stopped(tmp_path_factory):
    """A run stopped inside step 2, with two checkpoints of it."""
    path = tmp_path_factory.mktemp("stopped") / "run"
    interval, train.INTERVAL = train.INTERVAL, 0.0
    with create(path) as folder, pytest.raises(KeyboardInterrupt):
        train.train(folder, None, Quiet(("step-2", 3), press_ctrl_c))
    train.INTERVAL = interval
    return path


@pytest.fixture
def copy(stopped, tmp_path):
    return shutil.copytree(stopped, tmp_path / "run")


def newest(path):
    return sorted((path / "checkpoints").glob("*.safetensors"))[-1]


def test_a_truncated_newest_checkpoint_falls_back_to_the_older(copy, whole):
    file = newest(copy)
    file.write_bytes(file.read_bytes()[:-100])
    reporter = Quiet()
    resume(copy, reporter)
    assert len(reporter.notes) == 1
    assert "truncated or altered" in reporter.notes[0]
    assert "continuing from stage-01-chunk-00000002" in reporter.notes[0]
    assert results(copy) == results(whole)


def test_a_damaged_checkpoint_is_none_of_the_two_kept(copy, whole, monkeypatch):
    """After the next save there are two to go on from again."""
    monkeypatch.setattr(train, "INTERVAL", 1e9)
    file = newest(copy)
    file.write_bytes(file.read_bytes()[:-100])
    with pytest.raises(KeyboardInterrupt):
        resume(copy, Quiet(("step-2", 2), press_ctrl_c))
    assert checkpoint.names(copy / "checkpoints") == [
        checkpoint.checkpoint_name(1, chunk) for chunk in (2, 4)
    ]
    file = newest(copy)
    file.write_bytes(b"nothing")
    resume(copy)
    assert results(copy) == results(whole)


def mark(path, chunk):
    """Bytes of metrics that a checkpoint of step 2 goes with."""
    name = checkpoint.checkpoint_name(1, chunk)
    return checkpoint.read_meta(path / "checkpoints", name)["metrics_bytes"]


def test_a_copy_made_while_training_goes_on_from_what_its_metrics_reach(copy, whole):
    """The metrics were copied first, and a checkpoint was saved before those were."""
    left = mark(copy, 2) + 10
    os.truncate(copy / "metrics.jsonl", left)
    said = f"metrics.jsonl is damaged: truncated: {left} of {mark(copy, 3)} bytes"
    reporter = Quiet()
    resume(copy, reporter)
    (note,) = reporter.notes
    assert said in note
    assert "continuing from stage-01-chunk-00000002" in note
    assert results(copy) == results(whole)


def test_metrics_that_no_checkpoint_goes_with_are_refused(copy):
    os.truncate(copy / "metrics.jsonl", mark(copy, 2) - 1)
    before = (copy / "metrics.jsonl").read_bytes()
    with pytest.raises(LanewiseError, match=f"truncated: {len(before)} of {mark(copy, 3)} bytes"):
        resume(copy)
    assert (copy / "metrics.jsonl").read_bytes() == before


@pytest.mark.parametrize("lost", [("checkpoints",), ("checkpoints", "stages")], ids=len)
def test_metrics_of_lost_checkpoints_are_kept(copy, whole, lost):
    for name in lost:
        shutil.rmtree(copy / name)
    before = (copy / "metrics.jsonl").read_bytes()
    reporter = Quiet()
    resume(copy, reporter)
    (note,) = reporter.notes
    kept = copy / "metrics-before-1.jsonl"
    assert note.endswith(f"the stage under way begins anew; metrics so far are kept in {kept}")
    assert kept.read_bytes() == before
    assert results(copy) == results(whole)


def test_no_whole_checkpoint_is_refused(copy, capsys):
    for file in (copy / "checkpoints").glob("*.safetensors"):
        file.write_bytes(b"nothing")
    before = (copy / "metrics.jsonl").read_bytes()
    assert main(["train", "hierarchical", "--out", str(copy), "--resume"]) == 2
    assert "no checkpoint can be used" in capsys.readouterr().err
    assert (copy / "metrics.jsonl").read_bytes() == before


def test_a_full_disk_leaves_the_run_resumable(copy, whole, monkeypatch, capsys):
    def full(folder, name, content):
        (folder.path / name).write_bytes(content[: len(content) // 2])
        raise OSError(28, "No space left on device", str(folder.path / name))

    with monkeypatch.context() as patch:
        patch.setattr(files, "_write", full)
        assert main(["train", "hierarchical", "--out", str(copy), "--resume"]) == 2
    error = capsys.readouterr().err
    assert "No space left on device" in error
    assert "Traceback" not in error
    resume(copy)
    assert results(copy) == results(whole)
