"""What `lanewise.train` is given besides a stopped run, and where it is to train."""

import os

import pytest
import small_runs

import lanewise
from lanewise import TaskFunctions, api, config
from lanewise.cli.main import main
from lanewise.errors import LanewiseError, RunError, SettingsError
from lanewise.runs.run_folder import RunFolder
from lanewise.system import process
from lanewise.training.plan import TrainingPlan


@pytest.fixture
def run(tmp_path):
    """Stopped before its first chunk; not of the default preset, trap or seed."""
    flags = {"goals.time_limit": 5, "high_level.returns": 2}
    settings = config.compose("paper", "trap-10.9", flags=flags)
    RunFolder.create(tmp_path / "run", settings, "hierarchical", 3).close()
    return tmp_path / "run"


MADE_WITH = {
    "preset": "paper",
    "trap": "trap-10.9",
    # As `tomllib` reads a settings file.
    "goals": {"time_limit": 5},
    "high_level": {"returns": 2},
}
SAID = (
    *("--preset", "paper", "--trap", "trap-10.9"),
    *("--goals.time-limit", "5", "--high-level.returns", "2"),
)


@pytest.fixture
def trained(monkeypatch):
    """The settings and seeds of the runs that would have been trained."""
    found = []
    monkeypatch.setattr(
        api.training_loop,
        "train",
        lambda folder, *_, **__: found.append((folder.settings, folder.seed)),
    )
    return found


def test_what_a_stopped_run_was_made_with_may_be_given_again(run, trained):
    made = RunFolder.open(run).settings
    for given in ({}, MADE_WITH | {"seed": 3}):
        assert lanewise.train(run, "hierarchical", resume=True, quiet=True, **given) == run
    assert trained == [(made, 3)] * 2


def test_what_differs_is_refused_as_on_the_command_line(run, trained, capsys):
    for given, words in (
        ({"seed": 77}, ["--seed", "77"]),
        (MADE_WITH | {"scenario.lanes": 4}, [*SAID, "--scenario.lanes", "4"]),
    ):
        with pytest.raises(RunError, match="was made with") as refused:
            lanewise.train(run, "hierarchical", resume=True, quiet=True, **given)
        assert main(["train", "hierarchical", "--out", str(run), "--resume", *words]) == 2
        assert capsys.readouterr().err == f"lanewise: error: {refused.value}\n"
    assert trained == []


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ({"learning_rat": 3}, "did you mean .*learning_rate"),
        ({"warm_up": 3}, "may be single_level.learner.warm_up, .* give it in full"),
        ({"seed": -1}, "seed must be between 0 and 2147483647, got -1"),
        ({"quiet": "yes"}, 'quiet: expected true or false, got "yes"'),
        ({"out": ""}, "out: expected a path, got"),
        ({"high_level_of": ""}, "high_level_of: expected a path, got"),
    ],
)
def test_mistakes_leave_nothing_behind(tmp_path, monkeypatch, trained, given, said):
    """Nor are they let in where a run brings its own."""
    monkeypatch.chdir(tmp_path)
    for resume in (False, True):
        with pytest.raises(LanewiseError, match=said) as refused:
            lanewise.train(**{"out": "run", "resume": resume} | given)
        assert len(str(refused.value).splitlines()) == 1
    assert trained == []
    assert list(tmp_path.iterdir()) == []


def test_memory_is_asked_for_what_is_observed(tmp_path, monkeypatch):
    monkeypatch.setattr(process, "total_memory", lambda: 1 << 25)
    monkeypatch.setattr(TrainingPlan, "trace", lambda plan: 60_000)
    with pytest.raises(SettingsError, match=r"the machine has 0\.0 GiB; 60,000 numbers are"):
        lanewise.train(tmp_path / "run", quiet=True)
    assert list(tmp_path.iterdir()) == []


def reward_of_mine(settings, world, steering, ended):
    return world.vehicles.speed[0]


@pytest.mark.parametrize(
    ("name", "given", "again"),
    [
        ("a\x1b[31mb\nc", {"quiet": True}, "{out}, resume=True"),
        (
            os.fsdecode(b"caf\xe9"),
            {"task": TaskFunctions(reward=reward_of_mine)},
            "{out}, task=..., resume=True",
        ),
    ],
    ids=["quiet", "own-parts"],
)
def test_an_interruption_says_how_to_go_on(tmp_path, monkeypatch, capsys, name, given, again):
    """Also where all else is quiet, and below the traceback that the caller's handler may show."""
    monkeypatch.setattr(api.training_loop, "train", small_runs.stop)
    monkeypatch.setattr(TrainingPlan, "trace", lambda plan: 26)
    monkeypatch.chdir(tmp_path)
    with pytest.raises(KeyboardInterrupt) as caught:
        lanewise.train(name, **given)
    call = f"lanewise.train({again.format(out=repr(name))})"
    assert caught.value.__notes__ == [f"training stopped; continue with: {call}"]
    said = capsys.readouterr().err
    assert said == f"training stopped; continue with: {call}\n"
    # It does go on, and a run of another's parts is not the one that stopped.
    monkeypatch.setattr(api.training_loop, "train", lambda *_, **__: None)
    eval(call.replace("...", "given['task']"), {"lanewise": lanewise, "given": given})


def test_a_step_1_that_was_not_taken_over_yet_is_given_again(tmp_path, run, monkeypatch):
    def stopped(folder, *_, **__):
        if taken_over:
            folder.stages.mkdir()
        raise KeyboardInterrupt

    monkeypatch.setattr(api, "open_high_level", lambda *_: None)
    monkeypatch.setattr(api.training_loop, "train", stopped)
    for taken_over in (False, True):
        out = tmp_path / str(taken_over)
        with pytest.raises(KeyboardInterrupt) as caught:
            lanewise.train(out, high_level_of=run)
        assert (f"high_level_of={str(run)!r}" in caught.value.__notes__[0]) != taken_over
