"""Put one deliberate fault after another into Lanewise: the tests that cover it must fail.

python campaigns/faults.py

The tree is copied, so that nothing here is ever altered. A test that fails with a fault must pass
without it. A campaign that was stopped continues: outcomes are kept in `--work`, and hold as
long as fault, file and tests are what they were.
"""

import argparse
import hashlib
import json
import os
import shutil
import subprocess
import sys
from collections import Counter
from pathlib import Path

import record
from fault_list import altered, load, problems

from lanewise.system.progress import Progress

ROOT = Path(__file__).parents[1]
HEAVY = (
    "jax", "jax.numpy", "optax", "numpy", "gymnasium", "hypothesis", "safetensors.numpy", "pytest",
    "scipy.stats", "highway_env", "rich.progress", "tyro",
)  # fmt: skip
"""Imported once for all test processes."""
BASELINE_SECONDS = 3600.0
CAUGHT, TIMED_OUT, SURVIVED = "caught", "timed out", "survived"
OUTCOMES = {"failed": CAUGHT, "timed out": TIMED_OUT, "passed": SURVIVED}


class CampaignError(Exception):
    """The campaign itself is wrong."""


class Runner:
    """The server that runs tests in a copy of the tree; see `fault_runner`."""

    def __init__(self, tree, work, preload=HEAVY):
        self.log = work / "tests.log"
        environment = os.environ | {
            # The copy's own package, and never bytecode of an earlier fault: two faults of one
            # length within a second would look the same to Python.
            "PYTHONPATH": str(tree / "src"),
            "PYTHONDONTWRITEBYTECODE": "1",
            "JAX_COMPILATION_CACHE_DIR": str(work / "compiled"),
            "JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS": "0.1",
        }
        program = [sys.executable, str(Path(__file__).with_name("fault_runner.py")), *preload]
        self.server = subprocess.Popen(
            program, cwd=tree, env=environment, text=True,
            stdin=subprocess.PIPE, stdout=subprocess.PIPE,
        )  # fmt: skip

    def run(self, tests, seconds):
        """(outcome, first test that failed, seconds)."""
        request = {"tests": list(tests), "seconds": seconds, "log": str(self.log)}
        self.server.stdin.write(json.dumps(request) + "\n")
        self.server.stdin.flush()
        line = self.server.stdout.readline()
        if not line:
            raise CampaignError("the process that runs the tests has ended")
        answer = json.loads(line)
        if answer["outcome"] == "broken":
            raise CampaignError(f"{' '.join(tests)} cannot be run; see {self.log}")
        return answer

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.server.stdin.close()
        self.server.wait()


class Record:
    """Outcomes on disk, one a line, by a digest of all that they depend on."""

    def __init__(self, path, root):
        self.path, self.root = path, root
        lines = path.read_text().splitlines() if path.exists() else []
        self.known = {entry["key"]: entry for entry in map(json.loads, lines)}

    def key(self, fault):
        """Digest of a fault, the file it is put into, and the files of its tests."""
        files = {self.root / fault.path}
        for test in fault.tests:
            place = self.root / test.split("::")[0]
            files |= {place} if place.is_file() else set(place.rglob("*.py"))
        parts = [repr(fault), *(path.read_text() for path in sorted(files))]
        return hashlib.sha256("\0".join(parts).encode()).hexdigest()

    def find(self, fault):
        """What is known of a fault, or None."""
        return self.known.get(self.key(fault))

    def knows(self, fault, seconds):
        """Whether there is nothing more to find out: a time-out may be another with more time."""
        entry = self.find(fault)
        return entry is not None and (entry["outcome"] != TIMED_OUT or seconds <= entry["seconds"])

    def add(self, fault, outcome, answer):
        """Remember an outcome at once, so that nothing done is done again."""
        entry = {"key": self.key(fault), "name": fault.name, "outcome": outcome}
        entry |= {"by": answer["failed"], "seconds": answer["seconds"]}
        self.known[entry["key"]] = entry
        with self.path.open("a") as file:
            file.write(json.dumps(entry) + "\n")


def copy_tree(root, to):
    """What git knows or would add, so that nothing left lying around takes part."""
    listing = subprocess.run(
        ["git", "ls-files", "-z", "--cached", "--others", "--exclude-standard"],
        cwd=root, capture_output=True, text=True, check=True,
    ).stdout  # fmt: skip
    shutil.rmtree(to, ignore_errors=True)
    for name in filter(None, listing.split("\0")):
        if (root / name).is_file():
            (to / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copyfile(root / name, to / name)


def put_in(fault, tree, runner, seconds):
    """Run a fault's tests with the fault, and take it out again: (outcome, answer)."""
    path = tree / fault.path
    before, after = path.read_text(), altered(fault, tree)
    path.write_text(after)
    try:
        answer = runner.run(fault.tests, seconds)
    finally:
        path.write_text(before)
    return OUTCOMES[answer["outcome"]], answer


def in_turn(faults):
    """Faults of all areas in turn, so that a part of the campaign says something of each."""
    counts = Counter()
    places = []
    for fault in faults:
        places.append(counts[fault.area])
        counts[fault.area] += 1
    return [fault for _, fault in sorted(zip(places, faults, strict=True), key=lambda one: one[0])]


def campaign(faults, tree, runner, kept, reporter, seconds):
    """Put in every fault whose outcome is not known yet.

    A fault is caught by a test that fails with it, and passes without: each such test is run in
    the copy as it is, once.

    Raises:
        CampaignError: a test fails without any fault.
    """
    left = [fault for fault in in_turn(faults) if not kept.knows(fault, seconds)]
    # Anew each time: a test may have begun to fail since for another reason.
    sound = set()
    reporter.stage("faults", len(faults), len(faults) - len(left))
    tally = Counter()
    for number, fault in enumerate(left, start=1):
        outcome, answer = put_in(fault, tree, runner, seconds)
        test = answer["failed"]
        if outcome == CAUGHT and test not in sound:
            if runner.run([test], BASELINE_SECONDS)["outcome"] != "passed":
                raise CampaignError(f"{test} fails without any fault; see {runner.log}")
            sound.add(test)
        kept.add(fault, outcome, answer)
        tally[outcome] += 1
        if outcome != CAUGHT:
            reporter.note(f"{fault.name}: {outcome}")
        reporter.update(len(faults) - len(left) + number, **dict(tally))


def figures(faults, kept):
    """Counts by area and in all, and every fault with what caught it."""
    known = [(fault, kept.find(fault)) for fault in faults]
    known = [(fault, entry) for fault, entry in known if entry is not None]
    areas = {}
    for fault, entry in known:
        counts = areas.setdefault(fault.area, {"faults": 0, CAUGHT: 0, TIMED_OUT: 0, SURVIVED: 0})
        counts["faults"] += 1
        counts[entry["outcome"]] += 1
    total = {
        name: sum(area[name] for area in areas.values()) for name in next(iter(areas.values()))
    }
    return {
        **total,
        "share_caught": total[CAUGHT] / total["faults"],
        "areas": areas,
        "list": [
            {
                "name": fault.name,
                "file": fault.file,
                "breaks": fault.breaks,
                "outcome": entry["outcome"],
                "caught_by": entry["by"] if entry["outcome"] == CAUGHT else None,
                "seconds": entry["seconds"],
            }
            for fault, entry in known
        ],
    }


def main():
    """Put them all in, and store what came of it."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--only", nargs="*", help="areas or names of faults; all without")
    parser.add_argument("--seconds", type=float, default=600.0, help="for the tests of one fault")
    parser.add_argument("--work", type=Path, default=ROOT / "build" / "faults")
    parser.add_argument("--out", type=Path, default=ROOT / "results" / "trust" / "faults.json")
    arguments = parser.parse_args()
    faults = load()
    wrong = problems(faults, ROOT)
    if wrong:
        raise SystemExit("\n".join(wrong))
    if arguments.only:
        if unknown := set(arguments.only) - {word for f in faults for word in (f.area, f.name)}:
            parser.error(f"no area and no fault is called {', '.join(sorted(unknown))}")
        faults = [f for f in faults if {f.area, f.name} & set(arguments.only)]
    # As an absolute path, as the tests run in another folder, the copy.
    work = arguments.work.resolve()
    work.mkdir(parents=True, exist_ok=True)
    tree = work / "tree"
    copy_tree(ROOT, tree)
    kept = Record(work / "outcomes.jsonl", tree)
    try:
        with Progress() as reporter, Runner(tree, work) as runner:
            campaign(faults, tree, runner, kept, reporter, arguments.seconds)
    except CampaignError as error:
        raise SystemExit(f"the campaign stopped: {error}") from error
    found = figures(faults, kept)
    if not arguments.only:
        record.store(arguments.out, found | {"seconds_allowed": arguments.seconds})
    print(f"{found[CAUGHT]} of {found['faults']} faults caught")
    missed = [entry for entry in found["list"] if entry["outcome"] != CAUGHT]
    for entry in missed:
        print(f"{entry['outcome']}: {entry['name']} ({entry['file']}): {entry['breaks']}")
    sys.exit(bool(missed))


if __name__ == "__main__":
    main()
