"""Runs a workload in one or several processes that are pinned to cores and begin together."""

import json
import os
import subprocess
import tempfile
from collections.abc import Mapping, Sequence
from contextlib import ExitStack, suppress
from pathlib import Path
from typing import IO, Any

from lanewise.bench import worker
from lanewise.errors import LanewiseError

SUMMED = ("value", "decisions_per_second", "updates_per_second", "episodes", "peak_memory_bytes")
"""Added up over processes; other numbers are averaged."""
ONE_THREAD = {"OMP_NUM_THREADS": "1", "MKL_NUM_THREADS": "1"}
"""For libraries that would otherwise start a thread for every core of the machine."""
Child = tuple["subprocess.Popen[str]", IO[str]]
"""A worker and the file with its standard error."""


def measure(
    file: Path,
    function: str,
    arguments: Mapping[str, Any],
    groups: Sequence[Sequence[int]],
    python: Path,
) -> dict[str, Any]:
    """Measures a workload in several processes that begin at the same moment.

    Args:
        file: holds the workload's function (see `worker`).
        function: its name.
        arguments: of the function; process i also gets ``seed = i``.
        groups: cores of each process.
        python: interpreter of the processes.

    Raises:
        LanewiseError: a worker failed; the message ends with its last line of standard error.
    """
    with ExitStack() as stack:
        children: list[Child] = []
        for seed, cores in enumerate(groups):
            given = json.dumps({**arguments, "seed": seed})
            errors = stack.enter_context(tempfile.TemporaryFile("w+"))
            child = subprocess.Popen(
                [python, worker.__file__, file, function, given, *map(str, cores)],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=errors,
                # Without the filter a failure ends with its reason, not with advice.
                env=os.environ
                | {"JAX_TRACEBACK_FILTERING": "off"}
                | (ONE_THREAD if len(cores) == 1 else {}),
                text=True,
            )
            children.append((stack.enter_context(child), errors))
            # Whatever goes wrong, or Ctrl-C: no process stays behind.
            stack.callback(child.kill)
        for each in children:
            _line(each, function)
        for child, _ in children:
            assert child.stdin is not None
            with suppress(BrokenPipeError):  # A worker that ended meanwhile has no answer below.
                child.stdin.write("\n")
                child.stdin.flush()
        found: dict[str, Any] = combined([json.loads(_line(each, function)) for each in children])
        return found


def _line(child: Child, function: str) -> str:
    """The next line of a worker's answers."""
    process, errors = child
    assert process.stdout is not None
    found = process.stdout.readline()
    if not found:
        process.wait()
        errors.seek(0)
        said = errors.read().strip().splitlines() or ["no message"]
        raise LanewiseError(f"measuring {function} failed: {said[-1]}")
    return found


def combined(results: Sequence[Any], name: str = "") -> Any:
    """One result of the same workload in several processes."""
    first = results[0]
    if isinstance(first, dict):
        return {each: combined([result[each] for result in results], each) for each in first}
    if name in SUMMED:
        return sum(results)
    return first if all(each == first for each in results) else sum(results) / len(results)
