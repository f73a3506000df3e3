"""Run the tests that use randomness, time or files again and again, each time in another order.

python campaigns/shuffled.py

Which tests: those not marked slow whose text, or that of a helper or fixture in their file, has one
of the names below. Each run has its own order, hash seed and time zone. The cheapest files take
part in every run; the others take turns, as many as fit into what a run may cost (`--all`: every
file in every run). A first run in the order as written measures that. A stopped campaign continues.
"""

import argparse
import ast
import hashlib
import json
import os
import subprocess
import sys
import time
from pathlib import Path

import record

from lanewise.progress import Progress

ROOT = Path(__file__).parents[1]
WORDS = {
    "randomness": {"random", "given", "seed"},
    "time": {"time", "monotonic", "perf_counter", "sleep", "datetime", "clock", "signal"},
    "files": {
        "tmp_path", "tmp_path_factory", "open", "mkdir", "read_text", "write_text", "read_bytes",
        "write_bytes", "Path", "chdir", "subprocess",
    },
}  # fmt: skip
ZONES = ("UTC", "Pacific/Kiritimati", "America/St_Johns", "Asia/Kathmandu", "Pacific/Pago_Pago")
EVERY_RUN = 0.6
"""Share of what a run may cost that goes to files which take part in all of them."""


def names_in(node):
    """Every name that a piece of a program mentions."""
    found = set()
    for part in ast.walk(node):
        match part:
            case ast.Name(id=name) | ast.Attribute(attr=name) | ast.arg(arg=name):
                found.add(name)
            case ast.keyword(arg=str(name)):
                found.add(name)
    return found


def is_slow(node, marks):
    """Whether a function, or its whole file, is marked slow."""
    decorators = [ast.unparse(decorator) for decorator in node.decorator_list]
    return any(text.startswith("pytest.mark.slow") for text in [*decorators, *marks])


def reasons_of(path):
    """{test: kinds of words it has}, of one file; tests without any are left out."""
    body = ast.parse(path.read_text()).body
    tops = {node.name: node for node in body if hasattr(node, "name")}
    for node in body:
        if isinstance(node, ast.Assign):
            tops |= {target.id: node for target in node.targets if isinstance(target, ast.Name)}
    mentions = {name: names_in(node) for name, node in tops.items()}
    marks = [ast.unparse(tops["pytestmark"].value)] if "pytestmark" in tops else []

    def reached(names):
        seen, left = set(), set(names)
        while left:
            name = left.pop()
            seen.add(name)
            left |= mentions.get(name, set()) - seen
        return seen

    tests = [(node.name, node) for node in body if getattr(node, "name", "").startswith("test_")]
    for node in body:
        if isinstance(node, ast.ClassDef) and node.name.startswith("Test"):
            inner = [part for part in node.body if getattr(part, "name", "").startswith("test_")]
            tests += [(f"{node.name}::{part.name}", part) for part in inner]
    found = {}
    for name, node in tests:
        used = reached(names_in(node) | mentions.get("pytestmark", set()))
        kinds = [kind for kind, words in WORDS.items() if words & used]
        if kinds and not is_slow(node, marks):
            found[name] = kinds
    return found


def select(root=ROOT):
    """{test: kinds of words it has}, of the whole suite."""
    return {
        f"{path.relative_to(root)}::{name}": kinds
        for path in sorted((root / "tests").rglob("test_*.py"))
        for name, kinds in reasons_of(path).items()
    }


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
    options = ["-p", "shuffle_order", "--shuffle-only", only, "--shuffle-report", report]
    options += [
        "-o",
        "addopts=",
        "-q",
        "-m",
        "not slow",
        "-p",
        "no:cacheprovider",
        "-p",
        "no:xdist",
    ]
    if seed is not None:
        options += ["--shuffle-seed", seed]
    files = sorted({test.split("::")[0] for test in tests})
    began = time.monotonic()
    with (work / "tests.log").open("w") as log:
        subprocess.run(
            [sys.executable, "-m", "pytest", *map(str, options), *files],
            cwd=root, env=environment, stdout=log, stderr=log, check=False,
        )  # fmt: skip
    if not report.exists():
        raise SystemExit(f"the tests cannot be run; see {work / 'tests.log'}")
    return json.loads(report.read_text()), time.monotonic() - began


def costs(outcomes):
    """{file: CPU time of its tests, s}."""
    found = {}
    for test, outcome in outcomes.items():
        file = test.split("::")[0]
        found[file] = found.get(file, 0.0) + outcome["seconds"]
    return found


def plan(cost, runs, budget):
    """The files of each run: the cheapest in all of them, the others in turn."""
    always, spent = [], 0.0
    for file in sorted(cost, key=cost.get):
        if spent + cost[file] > EVERY_RUN * budget:
            break
        always.append(file)
        spent += cost[file]
    turns = [file for file in sorted(cost) if file not in always]
    chosen, next_turn = [], 0
    for _ in range(runs):
        files, left = list(always), budget - spent
        for _ in turns:
            file = turns[next_turn % len(turns)]
            if len(files) > len(always) and cost[file] > left:
                break
            files.append(file)
            left -= cost[file]
            next_turn += 1
        chosen.append(files)
    return chosen


def digest(root=ROOT):
    """Of all that the outcomes depend on."""
    total = hashlib.sha256()
    for folder in ("src", "tests"):
        for path in sorted((root / folder).rglob("*.py")):
            total.update(path.read_bytes())
    return total.hexdigest()


class Kept:
    """Runs on disk, one a line, as long as sources and tests are what they were."""

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


def main():
    """Shuffle, and store what came of it."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--runs", type=int, default=50)
    parser.add_argument("--seed", type=int, default=1, help="of the first run; then one more each")
    parser.add_argument("--budget", type=float, default=90.0, help="CPU time of a run, s")
    parser.add_argument("--only", nargs="*", help="files or folders of tests; nothing is stored")
    parser.add_argument("--all", action="store_true", help="every file in every run")
    parser.add_argument("--work", type=Path, default=ROOT / "build" / "shuffled")
    parser.add_argument("--out", type=Path, default=ROOT / "results" / "trust" / "shuffled.json")
    arguments = parser.parse_args()
    work = arguments.work.resolve()
    work.mkdir(parents=True, exist_ok=True)
    tests = select()
    if arguments.only:
        within = tuple(arguments.only)
        tests = {test: kinds for test, kinds in tests.items() if test.startswith(within)}
    kept = Kept(work / "runs.jsonl", digest())
    with Progress() as reporter:
        reporter.stage(f"{len(tests)} tests in the order as written", 1.0)
        first = kept.get(None, lambda: run(tests, None, work))
        if first["failed"]:
            raise SystemExit(f"in the order as written: {' '.join(first['failed'])}")
        budget = float("inf") if arguments.all else arguments.budget
        turns = plan(first["files"], arguments.runs, budget)
        reporter.stage("runs", arguments.runs)
        runs = []
        for number, files in enumerate(turns):
            some = [test for test in tests if test.split("::")[0] in files]
            seed = arguments.seed + number
            runs.append(kept.get(seed, lambda some=some, seed=seed: run(some, seed, work)))
            for test in runs[-1]["failed"]:
                reporter.note(f"seed {seed}: {test} failed")
            reporter.update(number + 1)
    found = figures(tests, first, runs)
    if not arguments.only:
        record.store(arguments.out, found, arguments.seed)
    print(f"{found['runs']} runs of {found['tests_run']} tests, {len(found['failures'])} failures")
    sys.exit(bool(found["failures"]))


if __name__ == "__main__":
    main()
