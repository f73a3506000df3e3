"""Reproduce the quick experiment over and over, stopped and continued at random: the same results.

    python campaigns/soak.py --minutes 60 --out results/trust/soak.json

The first reproduction runs to its end. The others are stopped again and again, by Ctrl-C, SIGTERM
or SIGKILL of every process or by SIGTERM of the first one alone, and started again by the same
command until they are done. Controllers, metrics, tests and the report without its times must be
the same bytes. Later reproductions must not take more memory than earlier ones; the first, which
compiles what the others reuse, takes most.
"""

import hashlib
import json
import os
import signal
import subprocess
import sys
import tempfile
import time
from collections import Counter
from contextlib import suppress
from pathlib import Path

import numpy as np
import record

from lanewise.system.progress import Progress

RESULTS = ("controller.safetensors", "metrics.jsonl", "episodes.csv", "chunks.csv", "tests/*.csv")
WAYS = {
    "SIGINT": signal.SIGINT,
    "SIGTERM": signal.SIGTERM,
    "SIGTERM to the first": signal.SIGTERM,
    "SIGKILL": signal.SIGKILL,
}
TIMES = {"seconds", "test_seconds", "date", "command", "times"}
"""Fields of a report that may differ."""
MEAN = 90.0
"""Mean time between two stops, s."""
GROWTH = 1.1
"""Largest ratio of memory, later half of the reproductions to earlier half."""


def results(out):
    """Digest by file of everything that must be the same."""
    found = {}
    for pattern in RESULTS:
        for path in sorted((out / "runs").glob(f"*/seed-*/{pattern}")):
            found[str(path.relative_to(out))] = hashlib.sha256(path.read_bytes()).hexdigest()
    report = json.dumps(timeless(json.loads((out / "report.json").read_text())))
    return found | {"report.json": hashlib.sha256(report.encode()).hexdigest()}


def timeless(value):
    """A report without the fields that may differ."""
    if isinstance(value, dict):
        return {name: timeless(part) for name, part in value.items() if name not in TIMES}
    return [timeless(part) for part in value] if isinstance(value, list) else value


def living(group):
    """Processes of a group that are alive."""
    for entry in Path("/proc").glob("[0-9]*"):
        with suppress(OSError):
            state, _, its_group = (entry / "stat").read_text().rpartition(")")[2].split()[:3]
            if int(its_group) == group and state != "Z":
                yield int(entry.name)


def attempt(command, environment, seconds, way):
    """Run a command, and stop it after some seconds.

    Returns (whether it was stopped, its exit status, its last words, the largest memory in MiB).
    """
    # A file and not a pipe, which would fill up and stop the process while nobody reads.
    with tempfile.TemporaryFile("w+") as said:
        process = subprocess.Popen(
            command, env=environment, start_new_session=True, stdout=said, stderr=said
        )
        deadline = time.monotonic() + seconds
        while (ended := os.wait4(process.pid, os.WNOHANG))[0] == 0 and time.monotonic() < deadline:
            time.sleep(0.5)
        stopped = ended[0] == 0
        if stopped:
            only_first = way == "SIGTERM to the first"
            for member in [process.pid] if only_first else list(living(process.pid)):
                with suppress(ProcessLookupError):
                    os.kill(member, WAYS[way])
            ended = os.wait4(process.pid, 0)
            while any(living(process.pid)):
                time.sleep(0.1)
        process.returncode = os.waitstatus_to_exitcode(ended[1])
        said.seek(0)
        return stopped, process.returncode, said.read()[-500:], ended[2].ru_maxrss // 1024


def reproduction(out, environment, rng, stop):
    """One reproduction, stopped at random or not; returns the stops and the memory in MiB."""
    command = [sys.executable, "-m", "lanewise", "reproduce", "--out", str(out)]
    stops, largest = [], 0
    while True:
        way = str(rng.choice(list(WAYS)))
        seconds = 5.0 + rng.exponential(MEAN) if stop else np.inf
        stopped, status, words, memory = attempt(command, environment, seconds, way)
        largest = max(largest, memory)
        if stopped:
            stops.append(way)
            continue
        # The last stop may have come after the report was written.
        if status and not (stops and status == 2 and f"{out} is complete" in words):
            raise SystemExit(f"after {stops} the reproduction failed:\n{words}")
        return stops, largest


def growth(memory):
    """Most memory of the later half over that of the earlier half, without the first."""
    found = memory[1:] or memory
    half = (len(found) + 1) // 2
    return round(max(found[half:] or found) / max(found[:half]), 3)


def main():
    """Run the campaign, store what it found, and exit with 1 on a difference or growing memory."""
    arguments = record.parse(__doc__, "soak", minutes=60.0)
    # A shell's background jobs ignore Ctrl-C, and their children would too.
    signal.signal(signal.SIGINT, signal.default_int_handler)
    rng, began = np.random.default_rng(arguments.seed), time.monotonic()
    rounds, differences, expected = [], [], {}
    with tempfile.TemporaryDirectory() as place, Progress() as progress:
        environment = os.environ | {"JAX_COMPILATION_CACHE_DIR": str(Path(place) / "programs")}
        progress.stage("minutes", arguments.minutes)
        while not rounds or time.monotonic() - began < 60 * arguments.minutes:
            out = Path(place) / f"round-{len(rounds)}"
            stops, memory = reproduction(out, environment, rng, stop=bool(rounds))
            found = results(out)
            expected = expected or found
            for name in sorted(expected.keys() | found.keys()):
                if expected.get(name) != found.get(name):
                    differences.append({"round": len(rounds), "file": name})
            rounds.append({"stops": stops, "largest_memory_mib": memory})
            minutes = round((time.monotonic() - began) / 60, 1)
            progress.update(min(minutes, arguments.minutes), differences=len(differences))
    figures = {
        "minutes": minutes,
        "rounds": rounds,
        "stops": dict(Counter(way for each in rounds for way in each["stops"])),
        "differences": differences,
        "memory_growth": growth([each["largest_memory_mib"] for each in rounds]),
    }
    record.store(arguments.out, figures, arguments.seed)
    print(f"{len(rounds)} reproductions, {len(differences)} differences")
    return 1 if differences or figures["memory_growth"] > GROWTH else 0


if __name__ == "__main__":
    sys.exit(main())
