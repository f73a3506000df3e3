"""How commands end that do not run to their end: interrupted, nowhere to write, nobody to read."""

import os
import signal
import subprocess
import sys
from contextlib import contextmanager

import pytest

from lanewise.cli import sweep_command, train_command
from lanewise.cli.main import main
from lanewise.errors import printable
from lanewise.experiments import evaluate_trained
from lanewise.report import clip
from lanewise.runs import training_loop


@pytest.fixture(autouse=True)
def inside(tmp_path, monkeypatch):
    """Runs every test in a folder of its own."""
    monkeypatch.chdir(tmp_path)
    return tmp_path


def fail_with(error, monkeypatch):
    def run(parsed):
        raise error

    monkeypatch.setattr(train_command, "run", run)


def plain(text):
    """It steers no terminal."""
    assert printable(text) == text
    return text


def test_interruption_says_how_to_go_on(inside, monkeypatch, capsys):
    fail_with(KeyboardInterrupt(), monkeypatch)
    words = ["train", "hierarchical", "--out", "my run", "--seed", "3", "--high-level", "step 1"]
    assert main(words) == 130
    error = capsys.readouterr().err
    expected = "lanewise train hierarchical --out 'my run' --high-level 'step 1' --resume"
    assert error.splitlines()[-1].strip() == expected
    assert "interrupted; continue with:" in error
    # Once its step 1 is taken over, the other run is no longer needed.
    (inside / "my run" / "stages").mkdir(parents=True)
    assert main(words) == 130
    expected = "lanewise train hierarchical --out 'my run' --resume"
    assert capsys.readouterr().err.splitlines()[-1].strip() == expected


def test_what_a_command_prints_steers_no_terminal(monkeypatch, capsys):
    name, shown = "a\x1b[31mb\nc", "'a\\x1b[31mb\\nc'"
    with monkeypatch.context() as patch:
        fail_with(KeyboardInterrupt(), patch)
        assert main(["train", "single-level", "--out", name]) == 130
    resume = f"lanewise train single-level --out {shown} --resume"
    assert plain(capsys.readouterr().err).endswith(f"continue with:\n  {resume}\n")
    monkeypatch.setattr(training_loop, "train", lambda *_, **__: None)
    assert main(["train", "single-level", "--out", name]) == 0
    assert plain(capsys.readouterr().err).endswith(f"test it with: lanewise evaluate {shown}\n")
    monkeypatch.setattr(evaluate_trained, "record", lambda *_: None)
    monkeypatch.setattr(clip, "render", lambda *_: None)
    assert main(["watch", "pretrained/single-level", "-o", f"{name}.gif"]) == 0
    assert plain(capsys.readouterr().err).count("\n") == 3
    # A run that is not finished says how to go on.
    assert main(["evaluate", name]) == 2
    assert plain(capsys.readouterr().err).endswith(f"; {resume} continues it\n")


def test_sigterm_interrupts_only_while_a_command_runs(monkeypatch, capsys):
    def cleared(parsed):
        os.kill(os.getpid(), signal.SIGTERM)
        raise AssertionError("still running")

    monkeypatch.setattr(sweep_command, "run", cleared)
    assert main(["sweep", "run", "--out", "map"]) == 130
    expected = "lanewise: interrupted; the same command continues it"
    assert capsys.readouterr().err.strip() == expected
    assert signal.getsignal(signal.SIGTERM) is signal.SIG_DFL


INTERRUPTED_UNHEARD = """
import sys
from lanewise.cli import train_command
from lanewise.cli.main import main

def stopped(parsed):
    sys.stdout.write("half a line")
    raise KeyboardInterrupt

train_command.run = stopped
sys.exit(main(["train", "single-level", "--out", "run"]))
"""


@contextmanager
def closed_pipe():
    """The writing end of a pipe that nobody reads any more."""
    reading, writing = os.pipe()
    os.close(reading)
    yield writing
    os.close(writing)


def test_an_interruption_that_nobody_hears_of(tmp_path):
    """As of `lanewise train ... 2>&1 | tee log`, where Ctrl-C ends `tee` as well."""
    words = [sys.executable, "-c", INTERRUPTED_UNHEARD]
    # What was not written yet must not fail at the very end either.
    buffered = {name: value for name, value in os.environ.items() if name != "PYTHONUNBUFFERED"}
    with closed_pipe() as out:
        done = subprocess.run(words, stdout=out, stderr=out, env=buffered, check=False)
    assert done.returncode == 130


def test_trouble_with_the_disk_is_one_line(monkeypatch, capsys):
    fail_with(OSError(28, "No space left on device", "run/x"), monkeypatch)
    assert main(["train", "hierarchical", "--out", "run"]) == 2
    assert capsys.readouterr().err == "lanewise: error: No space left on device: run/x\n"


def test_a_full_disk_behind_standard_output_is_an_error_and_a_reader_that_leaves_is_none():
    command = [sys.executable, "-m", "lanewise", "--version"]
    options = {"stderr": subprocess.PIPE, "text": True, "check": False}
    with open("/dev/full", "w") as full:
        done = subprocess.run(command, stdout=full, **options)
    assert (done.returncode, done.stderr) == (2, "lanewise: error: No space left on device\n")
    with closed_pipe() as writing:
        done = subprocess.run(command, stdout=writing, **options)
    assert (done.returncode, done.stderr) == (0, "")
