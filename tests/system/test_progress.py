import io
import sys
from pathlib import Path

import pytest

from lanewise import cli
from lanewise.system.progress import Progress, tell


class Terminal(io.StringIO):
    def isatty(self):
        return True


class Gone:
    """Standard error whose reader has left, as `tee` does at a Ctrl-C."""

    def __init__(self, terminal):
        self.terminal = terminal

    def write(self, text):
        raise BrokenPipeError(32, "Broken pipe")

    flush = lambda self: self.write("")  # noqa: E731

    def isatty(self):
        return self.terminal


def test_plain_lines_off_a_terminal():
    stream, now = io.StringIO(), [0.0]
    with Progress(stream, interval=10.0, clock=lambda: now[0]) as progress:
        progress.stage("high level", 100)
        for done in range(0, 101, 5):
            progress.update(done, success_rate=0.5)
            now[0] += 4.0
        progress.note("a warning [with brackets]")
    lines = stream.getvalue().splitlines()
    assert lines[0] == "high level: starting, compiling first"
    # One line in 10 s, although an update came every 4 s.
    assert lines[1] == "high level: 15%, 1 min left, success rate 0.5"
    assert lines[-2:] == ["high level: 100%, success rate 0.5", "a warning [with brackets]"]
    assert len(lines) == 9
    assert all("\x1b" not in line and "\r" not in line for line in lines)


def test_neither_what_was_done_before_nor_compiling_counts():
    stream, now = io.StringIO(), [0.0]
    with Progress(stream, interval=0.0, clock=lambda: now[0]) as progress:
        progress.stage("low level", 100, done=50)
        now[0] = 1000.0  # Compiled, and the first part done.
        progress.update(60)
        now[0] = 1015.0
        progress.update(75)
    assert stream.getvalue().splitlines() == [
        "low level: continuing, compiling first",
        "low level: 60%",
        "low level: 75%, 25 s left",
    ]


def drive(progress, name="high level"):
    with progress:
        progress.stage(name, 100)
        progress.update(50, success_rate=0.5)
        progress.note(f"a warning of {name}")
        progress.update(100)


@pytest.mark.parametrize("kind", [io.StringIO, Terminal])
def test_what_is_said_does_not_steer_a_terminal(kind, capsys):
    """A policy is called what its author likes, a file what a stranger likes."""
    stream = kind()
    drive(Progress(stream, interval=0.0), "a\x1b[2Jb\nc\u202e")
    assert "\x1b[2J" not in stream.getvalue()
    assert "\u202e" not in stream.getvalue()
    assert "a\\x1b[2Jb\\nc\\u202e" in stream.getvalue()
    tell("wrote a\x1b[2Jb")
    assert capsys.readouterr().err == "wrote a\\x1b[2Jb\n"
    quiet = kind()
    drive(Progress(quiet, quiet=True))
    assert quiet.getvalue() == "a warning of high level\n"


@pytest.mark.parametrize("terminal", [False, True])
def test_nothing_ends_because_its_progress_cannot_be_shown(terminal, monkeypatch):
    """`lanewise watch ... 2>&1 | head` must leave its clip."""
    drive(Progress(Gone(terminal), interval=0.0))
    with monkeypatch.context() as patch:
        patch.setattr(sys, "stderr", Gone(terminal))
        tell("drawing")
    for module in Path(cli.__file__).parent.glob("*_command.py"):
        assert "sys.stderr.write" not in module.read_text(), module.name


def test_nothing_ends_because_a_stream_lacks_a_letter(monkeypatch):
    stream = io.TextIOWrapper(io.BytesIO(), encoding="ascii", errors="strict")
    drive(Progress(stream, interval=0.0), "ε-greedy 日本 größe ∞")
    monkeypatch.setattr(sys, "stderr", stream)
    tell("wrote 日本.gif")
    stream.flush()
    assert b"\\u65e5\\u672c" in stream.buffer.getvalue()
