"""Reproduce the quick experiment over and over, killed and continued at random: the same results.

python campaigns/soak.py --minutes 60 --out results/trust/soak.json

One reproduction runs to its end undisturbed. The others are stopped again and again, by Ctrl-C or
SIGKILL of every process at once, or by SIGTERM of all or of the first alone, and started again by
the same command until they are done. What each ends with (controllers, metrics, tests, and the
report without its times) must be the same bytes. Meanwhile the memory of every process is watched:
later reproductions must not take more than earlier ones. (The first, which compiles what the others
find, takes most.)
"""

import argparse
import hashlib
import json
import os
import signal
import subprocess
import sys
import tempfile
import time
from collections import Counter
from pathlib import Path

import numpy as np
import record

from lanewise.system.progress import duration

RESULTS = ("controller.safetensors", "metrics.jsonl", "episodes.csv", "chunks.csv", "tests/*.csv")
WAYS = {
    "SIGINT": signal.SIGINT,
    "SIGTERM": signal.SIGTERM,
    "SIGTERM to the first": signal.SIGTERM,
    "SIGKILL": signal.SIGKILL,
}
TIMES = {"seconds", "test_seconds", "date", "command", "times"}
"""Fields of a report that may differ."""
REFUSED = 2
"""Exit code of a command that has nothing to do."""
GROWTH = 1.1
"""Memory of the later half of the reproductions against that of the earlier half."""


def command(out, words):
    """Of a reproduction."""
    return [sys.executable, "-m", "lanewise", "reproduce", "--out", str(out), *words]


def results(out):
    """Digest by file of all that must be the same."""
    found = {}
    for run in sorted((out / "runs").glob("*/seed-*")):
        for pattern in RESULTS:
            for path in sorted(run.glob(pattern)):
                found[str(path.relative_to(out))] = _digest(path.read_bytes())
    report = json.loads((out / "report.json").read_text())
    found["report.json, without times"] = _digest(json.dumps(_timeless(report)).encode())
    return found


def _digest(content):
    return hashlib.sha256(content).hexdigest()


def _timeless(value):
    """A report without what tells the time."""
    if isinstance(value, dict):
        return {name: _timeless(part) for name, part in value.items() if name not in TIMES}
    return [_timeless(part) for part in value] if isinstance(value, list) else value


class Watched:
    """A reproduction under way in a group of processes of its own, and the memory it takes."""

    def __init__(self, out, words, environment):
        # A file and not a pipe, which would fill up and stop it while nobody reads.
        self._said = tempfile.TemporaryFile("w+")  # noqa: SIM115  (closed when it has ended)
        self._process = subprocess.Popen(
            command(out, words),
            env=environment,
            start_new_session=True,
            stdout=subprocess.DEVNULL,
            stderr=self._said,
        )
        self.largest = 0

    def wait(self, seconds):
        """Whether it ended by itself within so many seconds; None for as long as it takes."""
        end = None if seconds is None else time.monotonic() + seconds
        while end is None or time.monotonic() < end:
            try:
                self._process.wait(1.0)
            except subprocess.TimeoutExpired:
                self.largest = max(self.largest, *map(_memory, self._members()), 0)
            else:
                return True
        return False

    def stop(self, way):
        """Send a signal to its processes, and wait until they are gone."""
        members = [self._process.pid] if way == "SIGTERM to the first" else self._members()
        for member in members:
            try:
                os.kill(member, WAYS[way])
            except ProcessLookupError:
                continue
        self._process.wait()
        self._said.close()
        while self._members():
            time.sleep(0.1)

    def outcome(self):
        """Its exit code and what it said at the end."""
        code = self._process.wait()
        with self._said as file:
            file.seek(0)
            return code, file.read()[-500:]

    def _members(self):
        """Its processes that live."""
        found = []
        for entry in Path("/proc").iterdir():
            if entry.name.isdigit():
                try:
                    fields = (entry / "stat").read_text().rpartition(")")[2].split()
                except OSError:
                    continue
                if int(fields[3]) == self._process.pid and fields[0] != "Z":
                    found.append(int(entry.name))
        return found


def _memory(process):
    """Resident memory of a process, MiB."""
    try:
        for line in Path(f"/proc/{process}/status").read_text().splitlines():
            if line.startswith("VmRSS"):
                return int(line.split()[1]) // 1024
    except OSError:
        pass
    return 0


def reproduction(out, words, environment, rng, mean):
    """One reproduction, stopped at random; ``mean`` seconds between stops, None for no stop.

    Returns:
        (the signals it was stopped by, the largest memory of a process in MiB).
    """
    stops, largest = [], 0
    while True:
        running = Watched(out, words, environment)
        seconds = None if mean is None else 5.0 + float(rng.exponential(mean))
        if running.wait(seconds):
            code, said = running.outcome()
            # A stop may have come after the report was written, and before the process had ended.
            complete = stops and code == REFUSED and f"{out} is complete" in said
            if code and not complete:
                raise SystemExit(f"after {stops} the reproduction failed:\n{said}")
            return stops, max(largest, running.largest)
        stops.append(str(rng.choice(list(WAYS))))
        running.stop(stops[-1])
        largest = max(largest, running.largest)


def growth(memory):
    """Most memory of the later half over that of the earlier half, the first left aside."""
    found = memory[1:] or memory
    half = (len(found) + 1) // 2
    return round(max(found[half:] or found) / max(found[:half]), 3)


def main():
    """Run the campaign, store what it found, and tell by the exit code."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--minutes", type=float, default=60.0)
    parser.add_argument("--mean", type=float, default=90.0, help="seconds between stops")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--out", type=Path, default=Path("results/trust/soak.json"))
    parser.add_argument("words", nargs="*", help="of `lanewise reproduce`, after --")
    arguments = parser.parse_args()
    # What runs in a shell's background has Ctrl-C ignored, and its children would too.
    signal.signal(signal.SIGINT, signal.default_int_handler)
    rng = np.random.default_rng(arguments.seed)
    began = time.monotonic()
    rounds, differences, expected = [], [], None
    with tempfile.TemporaryDirectory() as place:
        # Compiled programs are kept, or most of the hour would be compiling.
        environment = os.environ | {"JAX_COMPILATION_CACHE_DIR": str(Path(place) / "programs")}
        while expected is None or time.monotonic() - began < 60 * arguments.minutes:
            out = Path(place) / f"round-{len(rounds)}"
            mean = None if expected is None else arguments.mean
            stops, largest = reproduction(out, arguments.words, environment, rng, mean)
            found = results(out)
            expected = expected or found
            differences += [
                {"round": len(rounds), "file": name}
                for name in sorted(expected.keys() | found.keys())
                if expected.get(name) != found.get(name)
            ]
            rounds.append({"stops": stops, "largest_memory_mib": largest})
            spent = time.monotonic() - began
            print(
                f"round {len(rounds)}: {len(stops)} stops, {largest} MiB, "
                f"{len(differences)} differences, {duration(spent)} of {arguments.minutes:g} min",
                file=sys.stderr,
                flush=True,
            )
    memory = [each["largest_memory_mib"] for each in rounds]
    figures = {
        "minutes": round((time.monotonic() - began) / 60, 1),
        "rounds": rounds,
        "stops": dict(Counter(way for each in rounds for way in each["stops"])),
        "files_compared": len(expected),
        "differences": differences,
        "memory_growth": growth(memory),
    }
    record.store(arguments.out, figures, arguments.seed)
    return 1 if differences or figures["memory_growth"] > GROWTH else 0


if __name__ == "__main__":
    sys.exit(main())
