"""The command line: finds the command, and turns every refusal into one or two lines.

Imports no JAX, so that ``--help`` and a refused setting answer at once.
"""

import io
import os
import signal
import sys
from collections.abc import Callable, Sequence
from contextlib import suppress
from typing import Any, TextIO

from lanewise.commands import (
    bench,
    compare,
    doctor,
    evaluate,
    export,
    reproduce,
    sweep,
    train,
    watch,
)
from lanewise.commands.arguments import Parsed, parse, without_settings
from lanewise.errors import LanewiseError, SettingsError, brief, printable, shell_line
from lanewise.names import look_up
from lanewise.system import process
from lanewise.system.version import __version__

COMMANDS: dict[str, type] = {
    "train": train.Train,
    "evaluate": evaluate.Evaluate,
    "compare": compare.Compare,
    "watch": watch.Watch,
    "export": export.Export,
    "sweep": sweep.Sweep,
    "reproduce": reproduce.Reproduce,
    "bench": bench.Bench,
    "doctor": doctor.Doctor,
}

RUNNERS: dict[str, Callable[[Parsed[Any]], int]] = {
    "train": train.run,
    "evaluate": evaluate.run,
    "compare": compare.run,
    "watch": watch.run,
    "export": export.run,
    "sweep": sweep.run,
    "reproduce": reproduce.run,
    "bench": bench.run,
    "doctor": doctor.run,
}

DESCRIPTION = (
    "Teaches a car to get out of slow traffic. "
    "`lanewise COMMAND --help` lists a command's options; `lanewise --version` tells the version."
)

REFUSED = 2
INTERRUPTED = 130


def main(arguments: Sequence[str] | None = None) -> int:
    """Runs ``lanewise`` and returns its exit code.

    0 done, 1 a measurement of ``bench`` failed, ``doctor`` found something broken or ``export`` a
    decision that differs, 2 refused, 130 interrupted, by Ctrl-C or SIGTERM.
    """
    words = list(sys.argv[1:] if arguments is None else arguments)
    for stream in (sys.stdout, sys.stderr):
        _spell_out(stream)
    try:
        with process.handle_signal(signal.SIGTERM, signal.default_int_handler):
            code = _dispatch(words)
        # Written here, where a closed pipe or a full disk can still be caught.
        sys.stdout.flush()
        return code
    except LanewiseError as error:
        return _refuse(str(error))
    except KeyboardInterrupt:
        _tell(f"\nlanewise: interrupted{_how_to_resume(words)}\n")
        _abandon(sys.stdout)
        return INTERRUPTED
    except BrokenPipeError:
        # The reader has gone (`lanewise … | head`): end without a word.
        _abandon(sys.stdout)
        return 0
    except OSError as error:
        _abandon(sys.stdout)
        place = f": {error.filename}" if error.filename else ""
        return _refuse(f"{error.strerror or error}{place}")


def _dispatch(words: list[str]) -> int:
    if not words or words[0] in ("-h", "--help"):
        from lanewise.commands import helptext

        helptext.show_all(COMMANDS, DESCRIPTION)
        return 0
    name, rest = words[0], words[1:]
    if name == "--version":
        sys.stdout.write(f"lanewise {__version__}\n")
        return 0
    if name.startswith("-"):
        raise SettingsError(f'expected a command before "{brief(name)}": ' + ", ".join(COMMANDS))
    command = look_up("command", name, COMMANDS)
    if "-h" in rest or "--help" in rest:
        from lanewise.commands import helptext

        helptext.show_one(name, command)
        return 0
    return RUNNERS[name](parse(command, rest))


def _refuse(message: str) -> int:
    _tell(f"lanewise: error: {printable(message)}\n")
    return REFUSED


def _tell(text: str) -> None:
    """Writes to standard error, if anybody listens: Ctrl-C ends the reader of a pipe as well."""
    with suppress(OSError):
        sys.stderr.write(text)
    _abandon(sys.stderr)


def _spell_out(stream: TextIO) -> None:
    """Lets a stream spell out what its encoding lacks, instead of failing there."""
    if isinstance(stream, io.TextIOWrapper):
        stream.reconfigure(errors="backslashreplace")


def _abandon(stream: TextIO) -> None:
    """Keeps Python from failing a second time when it flushes a stream at exit."""
    try:
        stream.flush()
    except OSError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), stream.fileno())


def _how_to_resume(words: list[str]) -> str:
    """The command that continues an interrupted training."""
    if words[:1] in (["reproduce"], ["sweep"]):
        return "; the same command continues it"
    if words[:1] != ["train"]:
        return ""
    # A file of settings may have been edited since.
    again = train.resuming(without_settings(train.Train, words[1:]))
    return f"; continue with:\n  {shell_line('lanewise', *again)}"
