"""Run the tests that use randomness, time or files again and again, each time in another order.

python campaigns/shuffled.py

Which tests take part is told by `shuffle_selection.py`. Each run has its own order, hash seed and
time zone. The cheapest files take part in every run; the others take turns, as many as fit into
what a run may cost (`--all`: every file in every run). A first run in the order as written measures
that. A stopped campaign continues.
"""

import argparse
import json
import os
import subprocess
import sys
import time
from pathlib import Path

import record
from shuffle_selection import WORDS, select

from lanewise.system.progress import Progress

ROOT = Path(__file__).parents[1]
ZONES = ("UTC", "Pacific/Kiritimati", "America/St_Johns", "Asia/Kathmandu", "Pacific/Pago_Pago")
PLAIN = ("-o", "addopts=", "-q", "-m", "not slow", "-p", "no:cacheprovider", "-p", "no:xdist")
PLAIN += ("-p", "shuffle_order")
"""Options of pytest: one process, nothing remembered, the plugin."""
EVERY_RUN = 0.6
"""Share of what a run may cost that goes to files which take part in all of them."""


def run(tests, seed, work, root=ROOT):
    """One run in a process of its own: {test with parameters: its outcome}, and seconds."""
    only, report = work / "only.json", work / "report.json"
    only.write_text(json.dumps(sorted(tests)))
    report.unlink(missing_ok=True)
    plugins = str(Path(__file__).parent)
    path = os.pathsep.join(filter(None, [plugins, os.environ.get("PYTHONPATH")]))
    environment = os.environ | {
        "PYTHONPATH": path,
        "PYTHONHASHSEED": str(seed or 0),
        "TZ": ZONES[(seed or 0) % len(ZONES)],
        "JAX_COMPILATION_CACHE_DIR": str(work / "compiled"),
    }
    options = [*PLAIN, "--shuffle-only", only, "--shuffle-report", report]
    if seed is not None:
        options += ["--shuffle-seed", seed]
    files = sorted({test.split("::")[0] for test in tests})
    began = time.monotonic()
    with (work / "tests.log").open("w") as log:
        status = subprocess.run(
            [sys.executable, "-m", "pytest", *map(str, options), *files],
            cwd=root, env=environment, stdout=log, stderr=log, check=False,
        ).returncode  # fmt: skip
    # 0 and 1: all have passed, some have failed. Anything else is no run.
    if status not in (0, 1) or not report.exists():
        raise SystemExit(f"the tests cannot be run; see {work / 'tests.log'}")
    return json.loads(report.read_text()), time.monotonic() - began


def costs(outcomes):
    """{file: CPU time of its tests, s}."""
    found = {}
    for test, outcome in outcomes.items():
        file = test.split("::")[0]
        found[file] = found.get(file, 0.0) + outcome["seconds"]
    return found


def share_out(cost, turn, budget):
    """The files of one run: the cheapest, and of the others those whose turn it is.

    Args:
        cost: by file, s.
        turn: of all turns so far, the number of the next.
        budget: what a run may cost, s.

    Returns:
        (files, the number of the next turn).
    """
    always, spent = [], 0.0
    for file in sorted(cost, key=cost.get):
        if spent + cost[file] > EVERY_RUN * budget:
            break
        always.append(file)
        spent += cost[file]
    others = [file for file in sorted(cost) if file not in always]
    files = list(always)
    for _ in others:
        file = others[turn % len(others)]
        if len(files) > len(always) and spent + cost[file] > budget:
            break
        files.append(file)
        spent += cost[file]
        turn += 1
    return files, turn


class Kept:
    """Runs on disk, one a line, as long as all that they depend on is what it was."""

    def __init__(self, path, state):
        self.path, self.state = path, state
        lines = path.read_text().splitlines() if path.exists() else []
        entries = [entry for entry in map(json.loads, lines) if entry["state"] == state]
        self.runs = {entry["seed"]: entry for entry in entries}

    def get(self, seed, make):
        """The run of a seed, made if there is none yet."""
        if seed not in self.runs:
            outcomes, seconds = make()
            entry = {"state": self.state, "seed": seed, "seconds": round(seconds, 1)}
            entry |= {"tests": len(outcomes), "files": costs(outcomes)}
            entry["failed"] = sorted(t for t, outcome in outcomes.items() if outcome["failed"])
            self.runs[seed] = entry
            with self.path.open("a") as file:
                file.write(json.dumps(entry) + "\n")
        return self.runs[seed]


def figures(tests, first, runs):
    """What is stored."""
    kinds = {kind: sum(kind in found for found in tests.values()) for kind in WORDS}
    often = {file: sum(file in one["files"] for one in runs) for file in first["files"]}
    return {
        "words": {kind: sorted(words) for kind, words in WORDS.items()},
        "selected": {"functions": len(tests), "with_parameters": first["tests"], **kinds},
        "runs": len(runs),
        "tests_run": sum(one["tests"] for one in runs),
        "failures": [{"seed": one["seed"], "test": t} for one in runs for t in one["failed"]],
        "files_in_every_run": sum(count == len(runs) for count in often.values()),
        "runs_of_each_file": often,
        "seconds": {one["seed"]: one["seconds"] for one in runs},
    }


def campaign(tests, kept, work, seeds, budget, reporter):
    """The run in the order as written, then one for each seed.

    Raises:
        SystemExit: a test fails in the order as written.
    """
    reporter.stage(f"{len(tests)} tests in the order as written", 1.0)
    first = kept.get(None, lambda: run(tests, None, work))
    if first["failed"]:
        raise SystemExit(f"in the order as written: {' '.join(first['failed'])}")
    reporter.stage("runs", len(seeds))
    runs, turn, cost = [], 0, dict(first["files"])
    for seed in seeds:
        files, turn = share_out(cost, turn, budget)
        some = [test for test in tests if test.split("::")[0] in files]
        runs.append(kept.get(seed, lambda some=some, seed=seed: run(some, seed, work)))
        # The first run compiled what later ones find.
        cost |= runs[-1]["files"]
        for test in runs[-1]["failed"]:
            reporter.note(f"seed {seed}: {test} failed")
        reporter.update(len(runs))
    return first, runs


def main():
    """Shuffle, and store what came of it."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--runs", type=int, default=50)
    parser.add_argument("--seed", type=int, default=1, help="of the first run; then one more each")
    parser.add_argument("--budget", type=float, default=90.0, help="CPU time of a run, s")
    parser.add_argument("--all", action="store_true", help="every file in every run")
    parser.add_argument("--only", nargs="*", default=[], help="files or folders; nothing is stored")
    parser.add_argument("--work", type=Path, default=ROOT / "build" / "shuffled")
    parser.add_argument("--out", type=Path, default=ROOT / "results" / "trust" / "shuffled.json")
    arguments = parser.parse_args()
    work = arguments.work.resolve()
    work.mkdir(parents=True, exist_ok=True)
    within = tuple(arguments.only) or ("tests",)
    tests = {test: kinds for test, kinds in select().items() if test.startswith(within)}
    budget = float("inf") if arguments.all else arguments.budget
    kept = Kept(work / "runs.jsonl", record.state(within, budget, packages=("pytest",)))
    seeds = range(arguments.seed, arguments.seed + arguments.runs)
    with Progress() as reporter:
        found = figures(tests, *campaign(tests, kept, work, seeds, budget, reporter))
    if not arguments.only:
        record.store(arguments.out, found, arguments.seed)
    print(f"{found['runs']} runs of {found['tests_run']} tests, {len(found['failures'])} failures")
    sys.exit(bool(found["failures"]))


if __name__ == "__main__":
    main()
