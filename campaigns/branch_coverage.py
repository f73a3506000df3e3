"""Which branches of the package the tests take, the processes they start included.

python campaigns/branch_coverage.py

Runs the tests under coverage.py, by default all of them, the slow ones included, and stores totals
for each room. What a function that JAX compiles does is seen while it is traced: a branch in it is
one of Python's, taken when the program is made. Exits with 1 below 95 % of branches.
"""

import argparse
import json
import os
import subprocess
import sys
from pathlib import Path

import record

ROOT = Path(__file__).parents[1]
PACKAGE = Path("src", "lanewise")
LEAST = 0.95
"""Share of branches that must be taken."""
OURS = "*/lanewise/*"
"""Not workers that tests write, and that run under the name of the package's."""
COUNTS = ("num_statements", "missing_lines", "num_branches", "missing_branches")


def measure(tests, work, processes):
    """Run tests under coverage, and return coverage's report as JSON has it."""
    work.mkdir(parents=True, exist_ok=True)
    for old in (*work.glob(".coverage*"), work / "coverage.json"):
        old.unlink(missing_ok=True)
    environment = os.environ | {
        "COVERAGE_FILE": str(work / ".coverage"),
        "COVERAGE_RCFILE": str(ROOT / "pyproject.toml"),
    }

    def coverage(*words):
        command = [sys.executable, "-m", "coverage", *map(str, words)]
        return subprocess.run(command, cwd=ROOT, env=environment, check=False).returncode

    options = ["-o", "addopts=", "-q", "-p", "no:cacheprovider", "--dist", "loadfile"]
    failed = coverage("run", "-m", "pytest", *options, "-n", processes, *tests)
    if failed:
        raise SystemExit("the tests failed; what they cover says nothing")
    report = ("json", "-q", "--include", OURS, "-o", work / "coverage.json")
    if coverage("combine", "-q") or coverage(*report):
        raise SystemExit("coverage cannot make a report of what it has seen")
    return json.loads((work / "coverage.json").read_text())


def share(counts):
    """Share of branches taken; 1 where there is none."""
    branches = counts["num_branches"]
    return counts["covered_branches"] / branches if branches else 1.0


def judge(report):
    """What to say of a report, and whether it will do."""
    taken = share(report["totals"])
    return f"{100 * taken:.1f} % of branches, at least {100 * LEAST:.0f} wanted", taken >= LEAST


def figures(report):
    """Totals, and the same for each room."""
    rooms = {}
    for name, file in report["files"].items():
        parts = Path(name).parts
        inside = parts[parts.index(PACKAGE.name) + 1 :]
        room = inside[0] if len(inside) > 1 else "lanewise"
        counts = rooms.setdefault(room, dict.fromkeys(COUNTS, 0))
        for count in COUNTS:
            counts[count] += file["summary"][count]
    for counts in rooms.values():
        counts["covered_branches"] = counts["num_branches"] - counts["missing_branches"]
        counts["share_of_branches"] = round(share(counts), 4)
    totals = {count: report["totals"][count] for count in COUNTS}
    missing = {
        name: file["missing_branches"]
        for name, file in sorted(report["files"].items())
        if file["missing_branches"]
    }
    return {
        "share_of_branches": round(share(report["totals"]), 4),
        **totals,
        "rooms": dict(sorted(rooms.items())),
        "branches_not_taken": {name: [list(arc) for arc in arcs] for name, arcs in missing.items()},
    }


def main():
    """Measure, store, judge."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--tests", nargs="*", default=[], help="some tests; nothing is stored then")
    parser.add_argument(
        "--judge", type=Path, help="coverage's own report, instead of running tests"
    )
    parser.add_argument("--processes", type=int, default=2)
    parser.add_argument("--work", type=Path, default=ROOT / "build" / "coverage")
    parser.add_argument("--out", type=Path, default=ROOT / "results" / "trust" / "coverage.json")
    arguments = parser.parse_args()
    if arguments.judge:
        report = json.loads(arguments.judge.read_text())
    else:
        report = measure(arguments.tests, arguments.work.resolve(), arguments.processes)
    said, enough = judge(report)
    if not arguments.judge and not arguments.tests:
        record.store(arguments.out, figures(report), packages=("coverage", "pytest"))
    print(said)
    sys.exit(not enough)


if __name__ == "__main__":
    main()
