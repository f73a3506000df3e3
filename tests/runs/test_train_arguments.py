"""What `lanewise.train` is given besides a stopped run, and where it is to train."""

import re

import pytest

import lanewise
from lanewise import api, config
from lanewise.cli import main
from lanewise.errors import LanewiseError, RunError, SettingsError
from lanewise.runs.folder import RunFolder


@pytest.fixture
def run(tmp_path):
    """Stopped before its first chunk; not of the default preset, trap or seed."""
    settings = config.compose("paper", "trap-10.9", flags={"goals.time_limit": 5})
    RunFolder.create(tmp_path / "run", settings, "hierarchical", 3).close()
    return tmp_path / "run"


MADE_WITH = {"preset": "paper", "trap": "trap-10.9", "goals": {"time_limit": 5}}
SAID = ("--preset", "paper", "--trap", "trap-10.9", "--goals.time-limit", "5")


@pytest.fixture
def trained(monkeypatch):
    """The settings and seeds of the runs that would have been trained."""
    found = []
    monkeypatch.setattr(
        api.training, "train", lambda folder, *_, **__: found.append((folder.settings, folder.seed))
    )
    return found


@pytest.mark.parametrize("given", [{}, {"seed": 3}, MADE_WITH, MADE_WITH | {"seed": 3}], ids=str)
def test_what_a_stopped_run_was_made_with_may_be_given_again(run, trained, given):
    before = RunFolder.open(run)
    assert lanewise.train(run, "hierarchical", resume=True, quiet=True, **given) == run
    assert trained == [(before.settings, 3)]


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ({"seed": 77}, ["--seed", "77"]),
        ({"seed": 0}, ["--seed", "0"]),
        ({"preset": "quick"}, ["--preset", "quick"]),
        ({"trap": "trap-10"}, ["--trap", "trap-10"]),
        ({"goals": {"time_limit": 5}}, ["--goals.time-limit", "5"]),
        (MADE_WITH | {"scenario.lanes": 4}, [*SAID, "--scenario.lanes", "4"]),
    ],
    ids=str,
)
def test_what_differs_is_refused_as_on_the_command_line(run, trained, capsys, given, words):
    with pytest.raises(RunError, match="was made with") as refused:
        lanewise.train(run, "hierarchical", resume=True, quiet=True, **given)
    assert trained == []
    assert main(["train", "hierarchical", "--out", str(run), "--resume", *words]) == 2
    assert capsys.readouterr().err == f"lanewise: error: {refused.value}\n"


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ({"learning_rat": 3}, "did you mean .*learning_rate"),
        ({"preset": "no-such"}, 'unknown preset "no-such"'),
        ({"trap": "trap-11"}, "did you mean trap-10"),
        ({"goals": {"time_limit": -5}}, "goals.time_limit must be .*, got -5"),
        ({"seed": -1}, "seed must be between 0 and 2147483647, got -1"),
        ({"resume": "yes"}, 'resume: expected true or false, got "yes"'),
        ({"tensorboard": "no"}, 'tensorboard: expected true or false, got "no"'),
        ({"quiet": 3}, "quiet: expected true or false, got 3"),
    ],
    ids=str,
)
def test_what_makes_no_sense_is_refused_though_a_run_brings_its_own(run, trained, given, said):
    with pytest.raises(SettingsError, match=said):
        lanewise.train(run, "hierarchical", **{"resume": True} | given)
    assert trained == []


@pytest.mark.parametrize("given", ["a\0b", "a\ud800b", "", None, 3, b"run", ["run"]], ids=ascii)
def test_what_is_no_path_is_refused(tmp_path, monkeypatch, trained, given):
    monkeypatch.chdir(tmp_path)
    said = "{}: expected a path, got"
    with pytest.raises(LanewiseError, match=said.format("out")) as refused:
        lanewise.train(given)
    assert len(str(refused.value).splitlines()) == 1
    if given is not None:
        with pytest.raises(LanewiseError, match=said.format("high_level")):
            lanewise.train("run", high_level=given)
    assert trained == []
    assert list(tmp_path.iterdir()) == []


def test_a_path_may_be_text_or_a_path(tmp_path, trained):
    assert lanewise.train(tmp_path / "a", quiet=True) == tmp_path / "a"
    assert lanewise.train(str(tmp_path / "b"), quiet=True) == tmp_path / "b"
    assert trained == [(config.compose(), 0)] * 2


def test_the_zero_byte_is_spelled_out(trained):
    with pytest.raises(LanewiseError, match=re.escape(r'got "a\x00b"')):
        lanewise.train("a\0b")
