"""Wall time, compile time, peak memory and success of `lanewise train hierarchical`.

Each seed is trained and tested in processes of its own, one after the other.

    python benchmarks/training.py --seeds 0 1 2 --out results/training.json
    python benchmarks/training.py --out tiny.json -- --high-level.decisions 3200
"""

import argparse
import json
import os
import re
import shlex
import subprocess
import sys
import tempfile
import time
from datetime import UTC, datetime
from pathlib import Path

from lanewise.report import provenance
from lanewise.runs import metrics

COMPILE = re.compile(
    r"Finished (?:jaxpr to MLIR module conversion|XLA compilation).* in ([0-9.]+) sec"
)
"""What JAX says when it is told to log its compilations. Tracing is left out: it is logged for
functions inside one another, so a sum would count parts of it twice."""


def timed(command, log):
    """Run a command: (seconds, peak memory in bytes); its standard error goes to ``log``."""
    with log.open("wb") as errors:
        began = time.perf_counter()
        child = subprocess.Popen(command, stderr=errors, env=os.environ | {"JAX_LOG_COMPILES": "1"})
        _, status, usage = os.wait4(child.pid, 0)
        seconds = time.perf_counter() - began
    child.returncode = os.waitstatus_to_exitcode(status)
    if child.returncode:
        sys.exit(f"{shlex.join(command)} failed:\n{log.read_text()[-2000:]}")
    kibibytes = usage.ru_maxrss // 1024 if sys.platform == "darwin" else usage.ru_maxrss
    return seconds, kibibytes * 1024


def measure(controller, preset, seed, run, flags):
    """Train and test one seed."""
    program = [sys.executable, "-m", "lanewise"]
    train = [*program, "train", controller, "--preset", preset, "--seed", str(seed)]
    log = run.with_suffix(".log")
    seconds, memory = timed([*train, "--out", str(run), *flags], log)
    compiling = sum(float(found) for found in COMPILE.findall(log.read_text()))
    test = subprocess.run(
        [*program, "evaluate", str(run), "--json"], check=True, capture_output=True, text=True
    )
    chunks = [line for line in metrics.read(run / "metrics.jsonl") if line["kind"] == "chunk"]
    last = {line["stage"]: line for line in chunks}
    return {
        "seed": seed,
        "seconds": seconds,
        "compile_seconds": compiling,
        "peak_memory_bytes": memory,
        "decisions": {stage: line["decisions"] for stage, line in last.items()},
        "updates": {stage: line["updates"] for stage, line in last.items()},
        "test": json.loads(test.stdout),
    }


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--controller", default="hierarchical")
    parser.add_argument("--preset", default="quick")
    parser.add_argument("--seeds", type=int, nargs="+", default=[0])
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("flags", nargs="*", help="after --: settings for lanewise train")
    options = parser.parse_args()
    rows = []
    with tempfile.TemporaryDirectory() as folder:
        for seed in options.seeds:
            run = Path(folder) / f"seed-{seed}"
            row = measure(options.controller, options.preset, seed, run, options.flags)
            rows.append(row)
            print(
                f"seed {seed}: {row['seconds']:.1f} s, of them {row['compile_seconds']:.1f} s "
                f"compiling, {row['peak_memory_bytes'] / 2**30:.2f} GiB, "
                f"success {row['test']['success_rate']:.1%}, "
                f"accidents {row['test']['accident_rate']:.1%}"
            )
    result = {
        "command": shlex.join(["python", *sys.argv]),
        "date": datetime.now(UTC).isoformat(timespec="seconds"),
        "machine": provenance.machine(),
        "versions": provenance.versions(),
        "controller": options.controller,
        "preset": options.preset,
        "runs": rows,
    }
    options.out.parent.mkdir(parents=True, exist_ok=True)
    options.out.write_text(json.dumps(result, indent=2) + "\n")


if __name__ == "__main__":
    main()
