"""Entry point: dispatches to a command, and turns every refusal into one or two lines.

Imports no JAX, so that ``--help`` and a refused setting answer at once.
"""

import io
import os
import signal
import sys
from collections.abc import Sequence
from contextlib import suppress
from importlib import import_module  # noqa: TID251, names from COMMANDS
from typing import Any, TextIO

from lanewise.cli import command_line
from lanewise.errors import LanewiseError, SettingsError, brief, printable
from lanewise.fields.suggestions import look_up
from lanewise.system import process
from lanewise.system.version import __version__

COMMANDS = {
    "train": "Train a controller into a run folder, or continue a run that was stopped.",
    "evaluate": "Test a trained controller: greedy episodes of 25 s from the test start.",
    "compare": "Test several trained controllers on the same starts and show them side by side.",
    "watch": "Draw one test episode from above, with goal, speed and reward.",
    "export": "Write a controller as an ONNX model or for NumPy alone.",
    "sweep": "Test a trained controller over a grid and draw a map of the results.",
    "reproduce": "Run an experiment of the paper: train its arms, test them, report.",
    "bench": "Measure the speed of Lanewise on this machine.",
    "doctor": "Show what is installed, what is missing for which feature, and what to do.",
}
"""The commands. Each is a dataclass and a function ``run`` in its own module of this room, which is
imported when the command is called."""

HELP = """\
usage: lanewise COMMAND [OPTIONS]

Teaches a car to get out of slow traffic.

commands:
{commands}

`lanewise COMMAND --help` lists a command's options; `lanewise --version` shows the version.
"""
REFUSED, INTERRUPTED = 2, 130


def main(arguments: Sequence[str] | None = None) -> int:
    """Runs ``lanewise`` and returns its exit code.

    0 done; 1 a measurement of ``bench`` failed, ``doctor`` found something broken, or ``export`` a
    decision that differs; 2 refused; 130 interrupted by Ctrl-C or SIGTERM.
    """
    words = list(sys.argv[1:] if arguments is None else arguments)
    for stream in (sys.stdout, sys.stderr):
        _escape_unencodable(stream)
    try:
        with process.handle_signal(signal.SIGTERM, signal.default_int_handler):
            code = _dispatch(words)
        # Written here, where a closed pipe or a full disk can still be caught.
        sys.stdout.flush()
        return code
    except LanewiseError as error:
        return _refuse(str(error))
    except KeyboardInterrupt as stop:
        _tell(f"\nlanewise: interrupted{stop}\n")
        _flush_or_discard(sys.stdout)
        return INTERRUPTED
    except BrokenPipeError:
        # The reader has gone (`lanewise … | head`): end without a word.
        _flush_or_discard(sys.stdout)
        return 0
    except OSError as error:
        _flush_or_discard(sys.stdout)
        place = f": {error.filename}" if error.filename else ""
        return _refuse(f"{error.strerror or error}{place}")


def command_module(name: str) -> Any:
    """The module of a command: its dataclass, called as the command, and ``run``."""
    return import_module(f"lanewise.cli.{name}_command")


def command_class(name: str) -> Any:
    """The dataclass of a command."""
    return getattr(command_module(name), name.capitalize())


def _dispatch(words: list[str]) -> int:
    if not words or words[0] in ("-h", "--help"):
        listed = (f"  {name:<11}{summary}" for name, summary in COMMANDS.items())
        sys.stdout.write(HELP.format(commands="\n".join(listed)))
        return 0
    name, rest = words[0], words[1:]
    if name == "--version":
        sys.stdout.write(f"lanewise {__version__}\n")
        return 0
    if name.startswith("-"):
        raise SettingsError(f'expected a command before "{brief(name)}": ' + ", ".join(COMMANDS))
    look_up("command", name, COMMANDS)
    if "-h" in rest or "--help" in rest:
        sys.stdout.write(command_line.help_text(command_class(name)))
        return 0
    module, parsed = command_module(name), command_line.parse(command_class(name), rest)
    try:
        code: int = module.run(parsed)
    except KeyboardInterrupt:
        if name == "train":
            raise KeyboardInterrupt(f"; {module.how_to_continue(parsed.command)}") from None
        hint = "; the same command continues it" if name in ("sweep", "reproduce") else ""
        raise KeyboardInterrupt(hint) from None
    return code


def _refuse(message: str) -> int:
    _tell(f"lanewise: error: {printable(message)}\n")
    return REFUSED


def _tell(text: str) -> None:
    """Writes to standard error, if anybody reads it: Ctrl-C ends the reader of a pipe as well."""
    with suppress(OSError):
        sys.stderr.write(text)
    _flush_or_discard(sys.stderr)


def _escape_unencodable(stream: TextIO) -> None:
    """Lets a stream escape characters that its encoding lacks, instead of failing."""
    if isinstance(stream, io.TextIOWrapper):
        stream.reconfigure(errors="backslashreplace")


def _flush_or_discard(stream: TextIO) -> None:
    """Keeps Python from failing a second time when it flushes a stream at exit."""
    try:
        stream.flush()
    except OSError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), stream.fileno())
