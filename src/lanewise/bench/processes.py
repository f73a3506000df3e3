"""Workers in processes of their own: started together, measured together."""

import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Mapping, Sequence
from contextlib import ExitStack, suppress
from pathlib import Path
from typing import IO, Any

from lanewise.bench import runner
from lanewise.errors import LanewiseError, shell_line
from lanewise.system import process

WORKERS = Path(__file__).parent / "workers"
ONE_THREAD = {"OMP_NUM_THREADS": "1", "MKL_NUM_THREADS": "1"}
"""For libraries that would otherwise start a thread for every core of the machine."""

_SECONDS_TO_END = 10.0
"""For a worker that has answered; then it is killed."""


def one_each(
    worker: str, arguments: Mapping[str, Any], count: int, python: Path | None = None
) -> list[dict[str, Any]]:
    """The same worker in ``count`` processes at once, each on a core and with a seed of its own."""
    each = [
        ({**arguments, "seed": seed}, [core])
        for seed, core in zip(range(count), process.usable_cores(), strict=False)
    ]
    return _together(worker, each, python, ONE_THREAD)


def alone(
    worker: str, arguments: Mapping[str, Any], count: int, python: Path | None = None
) -> dict[str, Any]:
    """A worker in one process that may use ``count`` cores."""
    threads = ONE_THREAD if count == 1 else {}
    return _together(worker, [(dict(arguments), process.usable_cores()[:count])], python, threads)[
        0
    ]


def _together(
    worker: str,
    each: Sequence[tuple[Mapping[str, Any], Sequence[int]]],
    python: Path | None,
    environment: Mapping[str, str],
) -> list[dict[str, Any]]:
    """Results of a worker in several processes that begin at the same moment.

    Args:
        worker: name of a file of `WORKERS`.
        each: arguments and cores of each process.
        python: interpreter; this one if None.
        environment: variables beside those of this process.

    Raises:
        LanewiseError: a worker failed; the message ends with its own last words.
    """
    with ExitStack() as stack:
        children = []
        for arguments, allowed in each:
            errors = stack.enter_context(tempfile.TemporaryFile("w+"))
            child = _start(worker, arguments, allowed, python, environment, errors)
            children.append((stack.enter_context(child), errors))
            # Whatever goes wrong, or Ctrl-C: nothing stays behind.
            stack.callback(child.kill)
        for child, errors in children:
            if _line(child).strip() != runner.READY:
                raise _failed(worker, child, errors)
        for child, errors in children:
            assert child.stdin is not None
            try:
                child.stdin.write("\n")
                child.stdin.flush()
            except BrokenPipeError:
                raise _failed(worker, child, errors) from None
        results = []
        for child, errors in children:
            answer = _line(child)
            if not answer:
                raise _failed(worker, child, errors)
            results.append(json.loads(answer))
        for child, _ in children:
            with suppress(subprocess.TimeoutExpired):
                child.wait(_SECONDS_TO_END)
        return results


def _start(
    worker: str,
    arguments: Mapping[str, Any],
    allowed: Sequence[int],
    python: Path | None,
    environment: Mapping[str, str],
    errors: IO[str],
) -> "subprocess.Popen[str]":
    words = [str(WORKERS / f"{worker}.py"), json.dumps(dict(arguments)), *map(str, allowed)]
    return subprocess.Popen(
        [str(python or sys.executable), runner.__file__, *words],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=errors,
        # Without the filter a failure ends with its reason, not with advice.
        env={**os.environ, "JAX_TRACEBACK_FILTERING": "off", **environment},
        text=True,
    )


def _line(child: "subprocess.Popen[str]") -> str:
    assert child.stdout is not None
    return child.stdout.readline()


def output(words: Sequence[str]) -> str:
    """What a command of this interpreter prints on standard output.

    Raises:
        LanewiseError: it failed; the message ends with its own last words.
    """
    done = subprocess.run([sys.executable, *words], capture_output=True, text=True, check=False)
    if done.returncode:
        said = done.stderr.strip().splitlines()
        raise LanewiseError(f"{shell_line(*words)} failed: {said[-1] if said else 'no message'}")
    return done.stdout


def _failed(worker: str, child: "subprocess.Popen[str]", errors: IO[str]) -> LanewiseError:
    child.kill()
    child.wait()
    errors.seek(0)
    said = errors.read().strip().splitlines()
    return LanewiseError(f"measuring {worker} failed: {said[-1] if said else 'no message'}")
