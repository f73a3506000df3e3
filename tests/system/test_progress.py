import io
import sys
from pathlib import Path

import pytest

from lanewise import cli
from lanewise.system.progress import Progress, tell


class Clock:
    def __init__(self):
        self.now = 0.0

    def __call__(self):
        return self.now


class Terminal(io.StringIO):
    def isatty(self):
        return True


def test_plain_lines_off_a_terminal():
    stream, clock = io.StringIO(), Clock()
    with Progress(stream, interval=10.0, clock=clock) as progress:
        progress.stage("high level", 100)
        for done in range(0, 101, 5):
            progress.update(done, success_rate=0.5)
            clock.now += 4.0
        progress.note("a warning [with brackets]")
    lines = stream.getvalue().splitlines()
    assert lines[0] == "high level: starting, compiling first"
    # One line in 10 s, although an update came every 4 s.
    assert lines[1] == "high level: 15%, 1 min left, success rate 0.5"
    assert lines[-2:] == ["high level: 100%, success rate 0.5", "a warning [with brackets]"]
    assert len(lines) == 9
    assert all("\x1b" not in line and "\r" not in line for line in lines)


def test_neither_what_was_done_before_nor_compiling_counts():
    stream, clock = io.StringIO(), Clock()
    with Progress(stream, interval=0.0, clock=clock) as progress:
        progress.stage("low level", 100, done=50)
        clock.now = 1000.0  # Compiled, and the first part done.
        progress.update(60)
        clock.now = 1015.0
        progress.update(75)
    assert stream.getvalue().splitlines() == [
        "low level: continuing, compiling first",
        "low level: 60%",
        "low level: 75%, 25 s left",
    ]


@pytest.mark.parametrize("kind", [io.StringIO, Terminal])
def test_quiet_says_warnings_alone(kind):
    stream = kind()
    with Progress(stream, interval=0.0, quiet=True) as progress:
        progress.stage("high level", 100)
        progress.update(50, success_rate=0.5)
        progress.note("a warning")
        progress.update(100)
    assert stream.getvalue() == "a warning\n"


class Gone:
    """Standard error whose reader has left, as `tee` does at a Ctrl-C."""

    def __init__(self, terminal):
        self.terminal = terminal

    def write(self, text):
        raise BrokenPipeError(32, "Broken pipe")

    flush = lambda self: self.write("")  # noqa: E731

    def isatty(self):
        return self.terminal


@pytest.mark.parametrize("terminal", [False, True])
def test_nothing_ends_because_its_progress_cannot_be_shown(terminal, monkeypatch):
    """`lanewise watch ... 2>&1 | head` must leave its clip."""
    with Progress(Gone(terminal), interval=0.0) as progress:
        progress.stage("high level", 100)
        progress.update(50, success_rate=0.5)
        progress.note("a warning")
        progress.update(100)
    monkeypatch.setattr(sys, "stderr", Gone(terminal))
    tell("drawing")
    monkeypatch.undo()
    for module in Path(cli.__file__).parent.glob("*_command.py"):
        assert "sys.stderr.write" not in module.read_text(), module.name


@pytest.mark.parametrize("kind", [io.StringIO, Terminal])
def test_what_is_said_does_not_steer_a_terminal(kind, capsys):
    """A policy is called what its author likes, a file what a stranger likes."""
    stream, plain = kind(), kind()
    for each, name in ((stream, "a\x1b[2Jb\nc\u202e"), (plain, "name")):
        with Progress(each, interval=0.0) as progress:
            progress.stage(name, 2)
            progress.update(1)
            progress.note(name)
    assert "\x1b[2J" not in stream.getvalue()
    assert "\u202e" not in stream.getvalue()
    assert "a\\x1b[2Jb\\nc\\u202e" in stream.getvalue()
    tell("wrote a\x1b[2Jb")
    assert capsys.readouterr().err == "wrote a\\x1b[2Jb\n"


@pytest.mark.parametrize("encoding", ["ascii"])
def test_nothing_ends_because_a_stream_lacks_a_letter(encoding, monkeypatch):
    stream = io.TextIOWrapper(io.BytesIO(), encoding=encoding, errors="strict")
    with Progress(stream, interval=0.0) as progress:
        progress.stage("ε-greedy 日本", 1)
        progress.note("größe ∞")
    monkeypatch.setattr(sys, "stderr", stream)
    tell("wrote 日本.gif")
    stream.flush()
    assert b"\\u65e5\\u672c" in stream.buffer.getvalue()
