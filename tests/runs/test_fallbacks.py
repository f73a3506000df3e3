"""A stopped run that lost something goes on from what is left, and says so; or it is refused."""

import shutil

import pytest
from small_runs import Quiet, results, resume
from test_train import create, press_ctrl_c

from lanewise import cli
from lanewise.runs import files, train

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


def test_no_whole_checkpoint_is_refused(copy, capsys):
    for file in (copy / "checkpoints").glob("*.safetensors"):
        file.write_bytes(b"nothing")
    before = (copy / "metrics.jsonl").read_bytes()
    assert cli.main(["train", "hierarchical", "--out", str(copy), "--resume"]) == 2
    assert "no checkpoint can be used" in capsys.readouterr().err
    assert (copy / "metrics.jsonl").read_bytes() == before


def test_a_full_disk_leaves_the_run_resumable(copy, whole, monkeypatch, capsys):
    def full(path, content):
        path.write_bytes(content[: len(content) // 2])
        raise OSError(28, "No space left on device", str(path))

    with monkeypatch.context() as patch:
        patch.setattr(files, "_write", full)
        assert cli.main(["train", "hierarchical", "--out", str(copy), "--resume"]) == 2
    error = capsys.readouterr().err
    assert "No space left on device" in error
    assert "Traceback" not in error
    resume(copy)
    assert results(copy) == results(whole)
