"""Time to the paper's level: `lanewise train hierarchical --preset quick`, then its test."""

import json
import os
import re
import subprocess
import sys
import tempfile
import time
from functools import partial
from pathlib import Path
from typing import Any

from lanewise.bench import processes, runner
from lanewise.bench.task import Asked, Figure, Task
from lanewise.errors import LanewiseError
from lanewise.runs import metrics

PART = "level"
CASE = "lanewise train hierarchical --preset quick"
COMPILE = re.compile(
    r"Finished (?:jaxpr to MLIR module conversion|XLA compilation).* in ([0-9.]+) sec"
)
"""What JAX says when it is told to log its compilations. Tracing is left out: it is logged for
functions inside one another, so a sum would count parts of it twice."""


def tasks(asked: Asked) -> list[Task]:
    """A training and a test for each seed, one after the other, each in a process of its own."""
    return [
        Task(f"time to the paper's level: seed {seed}", partial(_measure, seed))
        for seed in range(asked.seeds)
    ]


def _measure(seed: int) -> list[Figure]:
    with tempfile.TemporaryDirectory() as place:
        run, log = Path(place) / "run", Path(place) / "log"
        words = ["train", "hierarchical", "--preset", "quick", "--seed", str(seed)]
        command = [sys.executable, "-m", "lanewise", *words, "--out", str(run)]
        seconds, memory = _timed(command, log)
        compiling = sum(float(found) for found in COMPILE.findall(log.read_text()))
        test = processes.output(["-m", "lanewise", "evaluate", str(run), "--json"])
        chunks = [line for line in metrics.read(run / "metrics.jsonl") if line["kind"] == "chunk"]
    last = {line["stage"]: line for line in chunks}
    detail: dict[str, Any] = {
        "seed": seed,
        "compile_seconds": compiling,
        "peak_memory_bytes": memory,
        "decisions": {stage: line["decisions"] for stage, line in last.items()},
        "updates": {stage: line["updates"] for stage, line in last.items()},
        "test": json.loads(test),
    }
    return [Figure(PART, CASE, f"lanewise, seed {seed}", seconds, "s", detail)]


def _timed(command: list[str], log: Path) -> tuple[float, int]:
    """Run a command, its standard error into ``log``: (seconds, peak memory in bytes)."""
    with log.open("wb") as errors:
        began = time.perf_counter()
        child = subprocess.Popen(command, stderr=errors, env=os.environ | {"JAX_LOG_COMPILES": "1"})
        _, status, usage = os.wait4(child.pid, 0)
        seconds = time.perf_counter() - began
    child.returncode = os.waitstatus_to_exitcode(status)
    if child.returncode:
        said = log.read_text().strip().splitlines()
        raise LanewiseError(f"{CASE} failed: {said[-1] if said else 'no message'}")
    return seconds, runner.peak_memory(usage)
