"""Put one deliberate fault after another into Lanewise: its default tests must fail.

    python campaigns/faults.py

A fault in `fault_lists/` is a piece of the source, what replaces it, the rule that this breaks,
and the tests that cover it: the cheapest that should notice. Slow tests do not count. The tree is
copied, and a test that fails with a fault must pass without it. A campaign that was stopped
continues: outcomes are kept in `build/faults`, and hold as long as fault, file and tests stay the
same. Tests run in processes forked from this one, which has imported the heavy packages but not
Lanewise: importing JAX would take most of the time.
"""

import argparse
import ast
import hashlib
import importlib
import json
import os
import shutil
import signal
import subprocess
import sys
import time
import tomllib
import warnings
from contextlib import suppress
from dataclasses import dataclass
from functools import cache
from pathlib import Path

ROOT = Path(__file__).parents[1]
LISTS, WORK = ROOT / "campaigns" / "fault_lists", ROOT / "build" / "faults"
HEAVY = (
    "jax", "jax.numpy", "optax", "numpy", "gymnasium", "hypothesis", "safetensors.numpy", "pytest",
    "scipy.stats", "highway_env", "rich.progress",
)  # fmt: skip
OPTIONS = ("-o", "addopts=", "-m", "not slow", "-q", "-x", "--tb=short")
OPTIONS += ("-p", "no:cacheprovider", "-p", "no:xdist", "-p", "no:randomly")
CAUGHT, TIMED_OUT, SURVIVED = "caught", "timed out", "survived"
SECONDS = 600.0
"""For the tests of one fault."""


@dataclass(frozen=True)
class Fault:
    """One deliberate fault."""

    name: str
    file: str
    """Below `src/lanewise`."""
    old: str
    """Must occur exactly once."""
    new: str
    breaks: str
    """The rule that no longer holds."""
    tests: tuple[str, ...]
    """pytest's node identifiers, with or without parameters."""

    @property
    def area(self):
        return self.file.split("/")[0]

    @property
    def path(self):
        return Path("src", "lanewise", self.file)


def load(folder=LISTS):
    """Every fault, area by area."""
    lists = [tomllib.loads(path.read_text())["fault"] for path in sorted(folder.glob("*.toml"))]
    return [Fault(**each | {"tests": tuple(each["tests"])}) for faults in lists for each in faults]


def problems(faults, root):
    """What is wrong with a list, a line each."""
    names = [fault.name for fault in faults]
    found = [f"{name}: two faults have this name" for name in set(names) if names.count(name) > 1]
    for fault in faults:
        path = root / fault.path
        text = path.read_text() if path.exists() else ""
        if text.count(fault.old) != 1:
            found.append(
                f"{fault.name}: {fault.file} has its old text {text.count(fault.old)} times"
            )
            continue
        if fault.old.split() == fault.new.split():
            found.append(f"{fault.name}: changes nothing that runs")
        try:
            ast.parse(text.replace(fault.old, fault.new))
        except SyntaxError as error:
            found.append(f"{fault.name}: with it {fault.file} is no Python: {error}")
        missing = [test for test in fault.tests or ("",) if not _exists(test, root)]
        found += [f'{fault.name}: there is no test "{test}"' for test in missing]
    return found


def _exists(test, root):
    """Whether a node identifier leads to a file, and to a function in it if it names one."""
    file, *names = test.split("::")
    nodes = _nodes(root / file) if file.endswith(".py") else []
    for name in names:
        plain = name.split("[")[0]
        nodes = next((node.body for node in nodes if getattr(node, "name", "") == plain), [])
    return bool(nodes)


@cache
def _nodes(path):
    return ast.parse(path.read_text()).body if path.exists() else []


def copy_tree(root, to):
    """Copy what git tracks or would add, so that nothing left lying around takes part."""
    command = ["git", "ls-files", "-z", "--cached", "--others", "--exclude-standard"]
    listing = subprocess.run(command, cwd=root, capture_output=True, text=True, check=True).stdout
    shutil.rmtree(to, ignore_errors=True)
    for name in filter(None, listing.split("\0")):
        if (root / name).is_file():
            (to / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copyfile(root / name, to / name)


def first_failure(path):
    """A plugin of pytest that writes down the first test that failed."""

    def note(self, report):
        if report.failed and not path.exists():
            path.write_text(report.nodeid)

    hooks = ("pytest_runtest_logreport", "pytest_collectreport")
    return type("FirstFailure", (), dict.fromkeys(hooks, note))()


def run_tests(tests, tree, work, seconds=SECONDS):
    """Run tests in the copy; returns (outcome, first test that failed)."""
    failure, log = work / "failed", work / "tests.log"
    failure.unlink(missing_ok=True)
    child = os.fork()
    if not child:
        try:
            os.setsid()
            os.chdir(tree)
            with log.open("w") as out:
                os.dup2(out.fileno(), 1)
                os.dup2(out.fileno(), 2)
            sys.path.insert(0, str(tree / "src"))
            # Two faults of one length within a second would look the same to Python.
            sys.dont_write_bytecode = True
            os.environ |= {"PYTHONPATH": sys.path[0], "PYTHONDONTWRITEBYTECODE": "1"}
            code = sys.modules["pytest"].main([*OPTIONS, *tests], plugins=[first_failure(failure)])
            sys.stdout.flush()
            os._exit(int(code))
        finally:
            os._exit(70)
    deadline = time.monotonic() + seconds
    while (ended := os.waitpid(child, os.WNOHANG))[0] == 0 and time.monotonic() < deadline:
        time.sleep(0.05)
    with suppress(ProcessLookupError):  # Also what the tests have started.
        os.killpg(child, signal.SIGKILL)
    if ended[0] == 0:
        os.waitpid(child, 0)
        return TIMED_OUT, ""
    code = os.waitstatus_to_exitcode(ended[1])
    if code == 0:
        return SURVIVED, ""
    if code not in (1, 2) or not failure.exists():
        raise SystemExit(f"{' '.join(tests)}: no default test, or it cannot be run; see {log}")
    return CAUGHT, failure.read_text()


def try_fault(fault, tree, work, sound, seconds=SECONDS):
    """Run a fault's tests with it; ``sound`` collects tests that are known to pass without."""
    path, began = tree / fault.path, time.monotonic()
    text = path.read_text()
    path.write_text(text.replace(fault.old, fault.new))
    try:
        outcome, test = run_tests(fault.tests, tree, work, seconds)
    finally:
        path.write_text(text)
    if outcome == CAUGHT and test not in sound:
        if run_tests([test], tree, work)[0] != SURVIVED:
            raise SystemExit(f"{test} fails without any fault; see {work / 'tests.log'}")
        sound.add(test)
    spent = round(time.monotonic() - began, 1)
    return {"outcome": outcome, "caught_by": test or None, "seconds": spent}


def key(fault, root):
    """Digest of everything that an outcome depends on."""
    files = {fault.path, *(Path(test.split("::")[0]) for test in fault.tests)}
    parts = [repr(fault), *((root / file).read_text() for file in sorted(files))]
    return hashlib.sha256("\0".join(parts).encode()).hexdigest()


def figures(faults, outcomes):
    """The counts, and every fault with what caught it."""
    listed = [
        {"name": fault.name, "file": fault.file, "breaks": fault.breaks} | outcome
        for fault, outcome in zip(faults, outcomes, strict=True)
    ]
    kinds = (CAUGHT, TIMED_OUT, SURVIVED)
    counts = {kind: sum(entry["outcome"] == kind for entry in listed) for kind in kinds}
    return {"faults": len(listed), **counts, "seconds_allowed": SECONDS, "list": listed}


def main():
    """Put in every fault whose outcome is not known yet, and store what came of all."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--only", nargs="*", default=[], help="areas or names; nothing is stored")
    parser.add_argument("--out", type=Path, default=ROOT / "results" / "trust" / "faults.json")
    arguments = parser.parse_args()
    faults = load()
    if wrong := problems(faults, ROOT):
        raise SystemExit("\n".join(wrong))
    if unknown := set(arguments.only) - {word for f in faults for word in (f.area, f.name)}:
        parser.error(f"no area and no fault is called {', '.join(sorted(unknown))}")
    faults = [f for f in faults if not arguments.only or {f.area, f.name} & set(arguments.only)]
    copy_tree(ROOT, WORK / "tree")
    # Read when JAX is imported.
    os.environ |= {"JAX_COMPILATION_CACHE_DIR": str(WORK / "compiled")}
    os.environ |= {"JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS": "0.1"}
    for name in HEAVY:
        importlib.import_module(name)
    # JAX warns of forks, as its threads would not follow; it starts none before its first use.
    warnings.filterwarnings("ignore", message=r".*os\.fork\(\)")
    store, sound = WORK / "outcomes.jsonl", set()
    lines = store.read_text().splitlines() if store.exists() else []
    known = {entry.pop("key"): entry for entry in map(json.loads, lines)}
    outcomes = []
    for number, fault in enumerate(faults, start=1):
        digest = key(fault, ROOT)
        if digest not in known:
            known[digest] = try_fault(fault, WORK / "tree", WORK, sound)
            with store.open("a") as file:
                file.write(json.dumps({"key": digest} | known[digest]) + "\n")
        outcomes.append(known[digest])
        print(f"{number}/{len(faults)} {fault.name}: {outcomes[-1]['outcome']}", flush=True)
    found = figures(faults, outcomes)
    if not arguments.only:
        import record  # Imports Lanewise, which the forked processes must not have.

        record.store(arguments.out, found)
    missed = [entry for entry in found["list"] if entry["outcome"] != CAUGHT]
    print(f"{found[CAUGHT]} of {found['faults']} faults caught")
    for entry in missed:
        print(f"{entry['outcome']}: {entry['name']} ({entry['file']}): {entry['breaks']}")
    sys.exit(bool(missed))


if __name__ == "__main__":
    main()
