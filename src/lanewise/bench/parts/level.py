"""Time to the paper's level: `lanewise train hierarchical --preset quick`, then its test."""

import json
import os
import re
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterable, Mapping
from functools import partial
from pathlib import Path
from statistics import median
from typing import Any

from lanewise.bench import processes, runner
from lanewise.bench.task import Asked, Figure, Task
from lanewise.errors import LanewiseError
from lanewise.runs import metrics_file

PART = "level"
CASE = "lanewise train hierarchical --preset quick"
CACHE = "JAX_COMPILATION_CACHE_DIR"
"""Where JAX keeps compiled programs, if it is set."""
AGAIN = f"{CASE}, {CACHE} set, second time"
COMPILE = re.compile(
    r"Finished (?:jaxpr to MLIR module conversion|XLA compilation|"
    # Tracing is logged for functions inside one another too; these are the outermost.
    r"tracing (?:begin|advance|_start_block|drive_block) for) .*in ([0-9.]+) sec"
)
"""What JAX says when it is told to log its compilations."""


def tasks(asked: Asked) -> list[Task]:
    """A training and a test for each seed, each in a process of its own.

    Then one whose programs an earlier one has compiled.
    """
    found = [
        Task(f"time to the paper's level: seed {seed}", partial(_measure, seed))
        for seed in range(asked.seeds)
    ]
    return [*found, Task("time to the paper's level: compiled before", _measure_again)]


def _measure(seed: int) -> list[Figure]:
    with tempfile.TemporaryDirectory() as place:
        return [_trained(CASE, seed, Path(place) / "run", {})]


def _measure_again() -> list[Figure]:
    with tempfile.TemporaryDirectory() as place:
        cache = {CACHE: str(Path(place) / "cache")}
        _trained(AGAIN, 0, Path(place) / "first", cache)
        return [_trained(AGAIN, 0, Path(place) / "second", cache)]


def _trained(case: str, seed: int, run: Path, environment: Mapping[str, str]) -> Figure:
    log = run.with_suffix(".log")
    words = ["train", "hierarchical", "--preset", "quick", "--seed", str(seed)]
    command = [sys.executable, "-m", "lanewise", *words, "--out", str(run)]
    seconds, memory = _timed(command, log, environment)
    compiling = sum(float(found) for found in COMPILE.findall(log.read_text()))
    test = processes.output(["-m", "lanewise", "evaluate", str(run), "--json"])
    chunks = [line for line in metrics_file.read(run / "metrics.jsonl") if line["kind"] == "chunk"]
    last = {line["stage"]: line for line in chunks}
    detail: dict[str, Any] = {
        "seed": seed,
        "compile_seconds": compiling,
        "seconds_of": breakdown(seconds, compiling, metrics_file.read(run / "timings.jsonl")),
        "peak_memory_bytes": memory,
        "decisions": {stage: line["decisions"] for stage, line in last.items()},
        "updates": {stage: line["updates"] for stage, line in last.items()},
        "test": json.loads(test),
    }
    return Figure(PART, case, f"lanewise, seed {seed}", seconds, "s", detail)


def breakdown(
    whole: float, compiling: float, times: Iterable[Mapping[str, Any]]
) -> dict[str, float]:
    """Where a training's wall time went, adding up to it.

    The first chunk of a stage and its first validation wait for their compilation; they count as
    long as the median of the others.

    Args:
        whole: seconds of the process.
        compiling: seconds of tracing and compilation.
        times: lines of the run's ``timings.jsonl``.
    """
    driving: dict[str, list[float]] = {}
    validation: dict[str, list[float]] = {}
    for line in times:
        driving.setdefault(line["stage"], []).append(line["seconds"] - line["validation"])
        if line["validation"]:
            validation.setdefault(line["stage"], []).append(line["validation"])
    found = {"compilation": compiling}
    for name, stages in (("driving and updates", driving), ("validation", validation)):
        found[name] = sum(
            sum(seconds[1:]) + median(seconds[1:] or seconds) for seconds in stages.values()
        )
    return found | {"start, saving, the rest": whole - sum(found.values())}


def _timed(command: list[str], log: Path, environment: Mapping[str, str]) -> tuple[float, int]:
    """Run a command, its standard error into ``log``: (seconds, peak memory in bytes)."""
    # Without a compilation cache of the user's, so that all is compiled.
    own = {name: value for name, value in os.environ.items() if name != CACHE}
    with log.open("wb") as errors:
        began = time.perf_counter()
        child = subprocess.Popen(
            command, stderr=errors, env={**own, "JAX_LOG_COMPILES": "1", **environment}
        )
        _, status, usage = os.wait4(child.pid, 0)
        seconds = time.perf_counter() - began
    child.returncode = os.waitstatus_to_exitcode(status)
    if child.returncode:
        said = log.read_text().strip().splitlines()
        raise LanewiseError(f"{CASE} failed: {said[-1] if said else 'no message'}")
    return seconds, runner.peak_memory(usage)
