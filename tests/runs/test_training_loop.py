"""A run that is stopped anywhere and continued ends in the same bytes as one that never was."""

import os
import shutil
import signal
from functools import partial

import pytest
import small_runs
from small_runs import Quiet, moved, results, resume

from lanewise.cli.main import main
from lanewise.controllers.registry import STEP_2
from lanewise.errors import CheckpointError, RunError
from lanewise.evaluation import evaluator
from lanewise.runs import checkpoint, metrics_file, selected_weights, trained, training_loop
from lanewise.system import folder_io, version
from lanewise.training import recipe, trainer

FLAGS = small_runs.flags(chunks=5)
pytestmark = pytest.mark.usefixtures("save_every_chunk", "hears_ctrl_c")


def press_ctrl_c():
    os.kill(os.getpid(), signal.SIGINT)


def create(path, seed=4, controller="hierarchical"):
    return small_runs.create(path, FLAGS, controller, seed)


@pytest.fixture
def save_only_when_stopped(save_every_chunk, monkeypatch):
    monkeypatch.setattr(training_loop, "INTERVAL", 1e9)


@pytest.mark.usefixtures("save_only_when_stopped")
@pytest.mark.parametrize("at", [("step-1", 3), ("step-1", 5), ("step-2", 0)], ids=str)
def test_ctrl_c_and_resume_give_the_same_bytes(tmp_path, whole, at):
    path = tmp_path / "run"
    with create(path) as folder, pytest.raises(KeyboardInterrupt):
        small_runs.train(folder, Quiet(at, press_ctrl_c))
    assert not (path / "controller.json").exists()
    if at[1]:
        assert list(folder.checkpoints.glob(f"*chunk-{at[1]:08d}.json"))
    resume(path)
    assert results(path) == results(whole)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("controller", "chunks", "flags"),
    [
        ("h-dqn", 5, {}),
        # The weights of more validations than are held at once.
        (
            "single-level",
            9,
            {"evaluation.validation_interval": 1, "driving.observation.variant": "lanes"},
        ),
    ],
)
def test_other_trainings_resume_to_the_same_bytes(tmp_path, monkeypatch, controller, chunks, flags):
    begin = partial(
        small_runs.create, values=small_runs.flags(chunks) | flags, controller=controller, seed=4
    )
    with begin(tmp_path / "whole") as folder:
        small_runs.train(folder)
    monkeypatch.setattr(training_loop, "INTERVAL", 1e9)
    path, late = tmp_path / "run", Quiet((controller, chunks - 1), press_ctrl_c)
    with begin(path) as folder, pytest.raises(KeyboardInterrupt):
        small_runs.train(folder, late)
    resume(path)
    assert results(path) == results(tmp_path / "whole")
    for record in metrics_file.read(path / "metrics.jsonl"):
        assert set(record) - {"kind"} <= set(metrics_file.COLUMNS[record["kind"]])


def test_a_finished_run_is_complete_and_not_trained_again(whole):
    assert list((whole / "checkpoints").iterdir()) == []
    before = results(whole)
    with pytest.raises(RunError, match="is finished"):
        resume(whole)
    assert results(whole) == before


def test_what_is_told_of_kept_weights_is_true_of_the_controller(whole):
    lines = metrics_file.read(whole / "metrics.jsonl")
    told = [line for line in lines if line["kind"] == "weights"]
    assert [line["stage"] for line in told] == ["step-1", "step-2"]
    controller = trained.load(whole)
    config = recipe.validation_config(controller.settings, STEP_2)
    count = told[-1]["fresh_episodes"]
    found = evaluator.evaluate(config, controller.parameters, selected_weights.FRESH_SEED, count)
    assert told[-1]["kept_reward"] == pytest.approx(found.accumulated_reward.mean())
    assert told[-1]["kept_accident_rate"] == pytest.approx((found.accident > 0).mean())


@pytest.mark.usefixtures("save_only_when_stopped")
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_within_a_chunk_waits_for_its_end(tmp_path, whole, monkeypatch, number):
    """There the chunk's old state is consumed already, and its metrics are not yet written."""
    path, validate, reporter = tmp_path / "run", trainer._validate, Quiet()
    before = signal.getsignal(number)

    def interrupted(plan, frozen, progress):
        if progress.counters.chunks == 2:
            os.kill(os.getpid(), number)
        return validate(plan, frozen, progress)

    with monkeypatch.context() as patch, create(path) as folder:
        patch.setattr(trainer, "_validate", interrupted)
        with pytest.raises(KeyboardInterrupt):
            small_runs.train(folder, reporter)
    assert reporter.notes == ["stopping once this chunk is finished and saved"]
    assert [p.name for p in folder.checkpoints.glob("*.json")] == ["stage-00-chunk-00000002.json"]
    assert signal.getsignal(number) is before
    resume(path)
    assert results(path) == results(whole)


def test_a_second_ctrl_c_does_not_wait(tmp_path):
    path = tmp_path / "run"

    def twice():
        press_ctrl_c()
        press_ctrl_c()

    with create(path) as folder, pytest.raises(KeyboardInterrupt):
        small_runs.train(folder, Quiet(("step-1", 3), twice))
    # Not even for the third chunk to be saved.
    assert checkpoint.names(folder.checkpoints)[-1] == checkpoint.checkpoint_name(0, 2)


def test_code_whose_training_differs_goes_on_with_a_warning(tmp_path, monkeypatch):
    path, other = tmp_path / "run", {"commit": "c" * 40, "clean_tree": True, "training": "0" * 12}
    with monkeypatch.context() as patch:
        patch.setattr(version, "source", lambda: other)
        create(path).close()
    for said in (f"{path} was made by code that trains otherwise (training 000000000000, ", ""):
        reporter = Quiet(("step-1", 0), press_ctrl_c)
        with pytest.raises(KeyboardInterrupt):
            resume(path, reporter)
        assert said in "".join(reporter.notes)
        assert len(reporter.notes) == bool(said)
        monkeypatch.setattr(version, "training", lambda: "0" * 12)


@pytest.mark.usefixtures("save_only_when_stopped")
def test_a_high_level_is_taken_over_and_the_run_resumes_without_it(whole, tmp_path):
    straight, broken = tmp_path / "straight", tmp_path / "broken"
    with create(straight, seed=5) as folder:
        small_runs.train(folder, high_level=whole)
    with create(broken, seed=5) as folder, pytest.raises(KeyboardInterrupt):
        small_runs.train(folder, Quiet(("step-2", 2), press_ctrl_c), whole)
    resume(broken)
    assert results(broken) == results(straight)
    taken = [(path / "stages" / "step-1.safetensors").read_bytes() for path in (whole, straight)]
    assert taken[0] == taken[1]
    assert b'"stage": "step-1"' not in (straight / "metrics.jsonl").read_bytes()
    assert results(straight) != results(whole)


def replaced(path):
    """Another run is trained there up to its first checkpoint."""
    shutil.rmtree(path)
    with create(path, seed=5) as folder, pytest.raises(KeyboardInterrupt):
        small_runs.train(folder, Quiet(("step-1", 2), small_runs.stop))
    assert list(folder.checkpoints.glob("*.json"))


@pytest.mark.parametrize("change", [shutil.rmtree, moved, replaced])
def test_a_training_writes_into_no_other_folder_than_its_own(tmp_path, change):
    path, left = tmp_path / "runs" / "run", {}

    def break_in():
        change(path)
        left.update(small_runs.everything(tmp_path))

    with create(path) as folder, pytest.raises(RunError) as caught:
        small_runs.train(folder, Quiet(("step-1", 2), break_in))
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
        small_runs.train(folder, Quiet(("step-1", 3), lambda: moved(path)))
    resume(tmp_path / "elsewhere")
    assert results(tmp_path / "elsewhere") == results(whole)


def newest(path):
    return sorted((path / "checkpoints").glob("*.safetensors"))[-1]


def mark(path, chunk):
    """Bytes of metrics that a checkpoint of step 2 goes with."""
    name = checkpoint.checkpoint_name(1, chunk)
    return checkpoint.read_manifest(path / "checkpoints", name)["meta"]["metrics_bytes"]


def test_a_damaged_newest_checkpoint_falls_back_to_the_older(stopped, whole, monkeypatch):
    """It is none of the two kept: after the next save there are two to go on from again."""
    monkeypatch.setattr(training_loop, "INTERVAL", 1e9)
    file = newest(stopped)
    file.write_bytes(file.read_bytes()[:-100])
    reporter = Quiet(("step-2", 2), press_ctrl_c)
    with pytest.raises(KeyboardInterrupt):
        resume(stopped, reporter)
    assert "truncated or altered" in reporter.notes[0]
    assert "continuing from stage-01-chunk-00000002" in reporter.notes[0]
    assert checkpoint.names(stopped / "checkpoints") == [
        checkpoint.checkpoint_name(1, chunk) for chunk in (2, 4)
    ]
    newest(stopped).write_bytes(b"nothing")
    resume(stopped)
    assert results(stopped) == results(whole)


def test_a_copy_made_while_training_goes_on_from_what_its_metrics_reach(stopped, whole):
    """The metrics were copied first, and a checkpoint was saved before those were."""
    left, reached = mark(stopped, 2) + 10, mark(stopped, 3)
    os.truncate(stopped / "metrics.jsonl", left)
    reporter = Quiet()
    resume(stopped, reporter)
    (note,) = reporter.notes
    assert f"metrics.jsonl is damaged: truncated: {left} of {reached} bytes" in note
    assert "continuing from stage-01-chunk-00000002" in note
    assert results(stopped) == results(whole)


@pytest.mark.parametrize("lost", [("checkpoints",), ("checkpoints", "stages")], ids=len)
def test_metrics_of_lost_checkpoints_are_kept(stopped, whole, lost):
    for name in lost:
        shutil.rmtree(stopped / name)
    before = (stopped / "metrics.jsonl").read_bytes()
    reporter = Quiet()
    resume(stopped, reporter)
    (note,) = reporter.notes
    kept = stopped / "metrics-before-1.jsonl"
    assert note.endswith(f"the stage under way begins anew; metrics so far are kept in {kept}")
    assert kept.read_bytes() == before
    assert results(stopped) == results(whole)


def shortened(stopped):
    """Of the metrics so much is left that no checkpoint goes with them."""
    length, wanted = mark(stopped, 2) - 1, mark(stopped, 3)
    os.truncate(stopped / "metrics.jsonl", length)
    return f"truncated: {length} of {wanted} bytes"


def torn(stopped):
    for file in (stopped / "checkpoints").glob("*.safetensors"):
        file.write_bytes(b"nothing")
    return "no checkpoint can be used"


def robbed_of_a_stage(stopped):
    """It is not trained anew over what came after."""
    (stopped / "stages" / "step-1.json").unlink()
    return "step-1.json is missing, though stage-01"


def exchanged(stopped):
    others = stopped.with_name("others")
    stopped.rename(others)
    create(stopped, seed=5).close()
    for name in ("stages", "checkpoints", "metrics.jsonl"):
        (others / name).rename(stopped / name)
    return "of another run: its seed is not 5"


def linked(stopped):
    """Going on would cut a file short that lies elsewhere."""
    metrics = stopped / "metrics.jsonl"
    metrics.rename(stopped.parent / "precious")
    metrics.symlink_to(stopped.parent / "precious")
    return "a link, not a regular file"


def test_a_controller_of_another_seed_is_refused(whole, tmp_path):
    create(tmp_path / "run", seed=5).close()
    for ending in ("json", "safetensors"):
        shutil.copy(whole / f"controller.{ending}", tmp_path / "run")
    with pytest.raises(CheckpointError, match="of another run: its seed is not 5"):
        trained.load(tmp_path / "run")


@pytest.mark.parametrize("damage", [shortened, torn, robbed_of_a_stage, exchanged, linked])
def test_what_cannot_be_continued_is_refused_and_left_as_it_is(stopped, capsys, damage):
    said = damage(stopped)
    before = small_runs.everything(stopped)
    assert main(["train", "hierarchical", "--out", str(stopped), "--resume"]) == 2
    assert said in capsys.readouterr().err
    assert small_runs.everything(stopped) == before


def test_a_full_disk_leaves_the_run_resumable(stopped, whole, monkeypatch, capsys):
    def full(folder, name, content):
        (folder.path / name).write_bytes(content[: len(content) // 2])
        raise OSError(28, "No space left on device", str(folder.path / name))

    with monkeypatch.context() as patch:
        patch.setattr(folder_io, "_write", full)
        assert main(["train", "hierarchical", "--out", str(stopped), "--resume"]) == 2
    error = capsys.readouterr().err
    assert "No space left on device" in error
    assert "Traceback" not in error
    resume(stopped)
    assert results(stopped) == results(whole)
