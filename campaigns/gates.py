"""See every gate of `.ci/run` red once: break its rule in a copy of the tree and let it look.

python campaigns/gates.py

A gate must be green in the copy as it is, and red with the violation, for the reason expected.
Needs the extras `test` and `docs`.
"""

import argparse
import os
import re
import subprocess
import sys
import time
from dataclasses import dataclass
from pathlib import Path

import record
from faults import copy_tree

from lanewise.system.progress import Progress

ROOT = Path(__file__).parents[1]
PASSING, FAILING = "def test_gate():\n    assert True\n", "    assert False\n"
SLOW = "import pytest\n\n\n@pytest.mark.slow\n"
TESTS, EXAMPLES = "tests/test_gate.py", "examples/test_gate.py"


@dataclass(frozen=True)
class Gate:
    """One command, and one way to break what it guards."""

    name: str
    command: str
    """Of the environment's programs, as in `.ci/run`, perhaps with the one file that matters."""
    file: str
    """Where the violation goes."""
    old: str
    """What stands there; nothing to add at the end."""
    new: str
    says: str
    """What the gate must say of it."""
    good: str | None = None
    """Text of a file that the gate needs and the tree has not."""

    def broken(self, text):
        """The file's text with the violation.

        Raises:
            ValueError: the old text does not stand there exactly once.
        """
        if not self.old:
            return text + self.new
        if text.count(self.old) != 1:
            raise ValueError(f"{self.name}: {self.old!r} does not stand once in {self.file}")
        return text.replace(self.old, self.new)


def wall(name, file, line, says):
    """A wall between rooms, with an import through it."""
    return Gate(f"import walls: {name}", "lint-imports --no-cache", file, "", line, says)


def page(name, test, file, old, new, says):
    """A page that no longer says what the program does."""
    command = f"python -m pytest tests/test_docs.py -k {test}"
    return Gate(f"pages: {name}", command, file, old, new, says)


def locked():
    """The first package of the locked versions, with the hashes of its files."""
    lines = (ROOT / "requirements" / "ci.txt").read_text().splitlines()
    lines = [line for line in lines if not line.startswith("#")]
    last = next(number for number, line in enumerate(lines) if not line.endswith("\\"))
    return "\n".join(lines[: last + 1]) + "\n"


GATES = (
    Gate("tests", f"python -m pytest {TESTS}", TESTS, "    assert True\n", FAILING,
         "1 failed", PASSING),
    Gate("slow tests", f"python -m pytest -m slow {TESTS}", TESTS, "    assert True\n", FAILING,
         "1 failed", SLOW + PASSING),
    Gate("markers", f"python -m pytest {TESTS}", TESTS, "def",
         "import pytest\n\n\n@pytest.mark.slwo\ndef",
         "'slwo' not found in `markers`", PASSING),
    Gate("examples", f"python -m pytest --dist load {EXAMPLES}", EXAMPLES, "    assert True\n",
         FAILING, "1 failed", PASSING),
    Gate("lint", "ruff check .", "src/lanewise/world/idm.py", "", "\nimport os\n", "F401"),
    Gate("lint: docstrings", "ruff check .", "src/lanewise/system/process.py", "",
         "\n\ndef undocumented() -> None:\n    return\n", "D103"),
    Gate("format", "ruff format --check .", "src/lanewise/world/idm.py", "", "\nX  =  1\n",
         "1 file would be reformatted"),
    Gate("types", "mypy", "src/lanewise/system/process.py", "", "\nWRONG: int = 'text'\n",
         "Incompatible types in assignment"),
    Gate("types: annotations", "mypy", "src/lanewise/system/process.py", "",
         "\ndef untyped(value):\n    return value\n", "missing a type annotation"),
    wall("layers", "src/lanewise/world/idm.py", "\nfrom lanewise.runs import folder\n",
         "Imports run one way through the house BROKEN"),
    wall("learning", "src/lanewise/learning/targets.py", "\nfrom lanewise.world import idm\n",
         "Learning knows no roads BROKEN"),
    wall("figures", "src/lanewise/runs/shelf.py", "\nimport matplotlib\n",
         "Figures are drawn in report only BROKEN"),
    wall("highway-env", "src/lanewise/evaluation/grid.py", "\nimport highway_env\n",
         "highway-env is imported in interop only BROKEN"),
    wall("no JAX", "src/lanewise/settings.py", "\nimport jax\n",
         "Settings, config and the reading of commands import no JAX BROKEN"),
    Gate("documentation", "python -m sphinx -q -W --keep-going -b html docs site",
         "docs/world.md", "", "\n[nowhere](no-such-page.md)\n", "no-such-page"),
    page("settings", "settings_page", "src/lanewise/driving/settings.py",
         "accident_penalty: Annotated[float, Between(0.0, 1e6)] = 10.0",
         "accident_penalty: Annotated[float, Between(0.0, 1e6)] = 11.0",
         "test_settings_page_is_up_to_date"),
    page("links", "links_lead", "docs/world.md", "", "\n[nowhere](no-such-page.md)\n",
         "no-such-page.md"),
    page("commands", "commands_are_understood", "docs/usage.md", "",
         "\n```sh\nlanewise train --no-such-flag 3\n```\n", "no-such-flag"),
    page("results", "results_come_from", "README.md", "14.91 (14.72", "15.91 (14.72",
         "run python docs/make_results.py"),
    # Nothing is installed: the file is fetched and held against its hash, and that is all.
    Gate("hashes", "pip install --require-hashes -q --dry-run -I --no-deps -r one.txt",
         "one.txt", locked(), re.sub("sha256:.{8}", "sha256:00000000", locked()),
         "DO NOT MATCH THE HASHES", locked()),
    Gate("requirements of packages", "pip check", "src/gate-1.0.dist-info/METADATA", "",
         "Requires-Dist: no-such-package\n", "gate 1.0 requires no-such-package",
         "Metadata-Version: 2.1\nName: gate\nVersion: 1.0\n"),
    Gate("list of faults", "python -m pytest tests/campaigns/test_faults.py -k whole",
         "src/lanewise/learning/targets.py", "return target - q_values[action]",
         "return -(q_values[action] - target)", "its old text stands 0 times"),
    Gate("branch coverage", "python campaigns/branch_coverage.py --judge coverage.json",
         "coverage.json", '"covered_branches": 97', '"covered_branches": 94',
         "94.0 % of branches", '{"totals": {"covered_branches": 97, "num_branches": 100}}'),
)  # fmt: skip
"""Each gate, with what turns it red."""


def program(command):
    """A command as `.ci/run` starts it: a program of this environment, and plain words."""
    name, *words = command.split()
    return [str(Path(sys.executable).parent / name), *words]


def look(gate, tree):
    """Let a gate look at the copy: (exit status, what it said)."""
    environment = os.environ | {"PYTHONPATH": str(tree / "src"), "PYTHONDONTWRITEBYTECODE": "1"}
    done = subprocess.run(
        program(gate.command),
        cwd=tree,
        env=environment,
        capture_output=True,
        text=True,
        check=False,
    )
    return done.returncode, done.stdout + done.stderr


def try_gate(gate, tree, seen_green=frozenset()):
    """Both looks at one gate; the copy is afterwards what it was.

    Args:
        gate: which.
        tree: the copy.
        seen_green: commands that were green in the copy as it is; they need not look again.
    """
    path, began = tree / gate.file, time.monotonic()
    before = path.read_text() if path.exists() else None
    good = before if gate.good is None else gate.good
    try:
        path.parent.mkdir(exist_ok=True)
        path.write_text(good)
        green, wrong = gate.good is None and gate.command in seen_green, ""
        if not green:
            status, wrong = look(gate, tree)
            green = status == 0
        path.write_text(gate.broken(good))
        status, said = look(gate, tree)
    finally:
        path.unlink() if before is None else path.write_text(before)
    red = status != 0 and gate.says in said
    return {
        "gate": gate.name,
        "command": gate.command,
        "violation": f"{gate.file}: {gate.new.strip() or 'left out: ' + gate.old.strip()}",
        "green_without": green,
        "red_with": red,
        "says": gate.says,
        "seconds": round(time.monotonic() - began, 1),
    }, (said if green else wrong)


def main():
    """Look at every gate, and store what was seen."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--only", nargs="*", help="names of gates; all without")
    parser.add_argument("--work", type=Path, default=ROOT / "build" / "gates")
    parser.add_argument("--out", type=Path, default=ROOT / "results" / "trust" / "gates.json")
    arguments = parser.parse_args()
    if unknown := set(arguments.only or ()) - {gate.name for gate in GATES}:
        parser.error(f"no gate is called {', '.join(sorted(unknown))}")
    gates = [gate for gate in GATES if not arguments.only or gate.name in arguments.only]
    tree = arguments.work.resolve() / "tree"
    copy_tree(ROOT, tree)
    rows, held, seen_green = [], 0, set()
    with Progress() as reporter:
        reporter.stage("gates", len(gates))
        for number, gate in enumerate(gates, start=1):
            row, said = try_gate(gate, tree, seen_green)
            rows.append(row)
            if row["green_without"] and gate.good is None:
                seen_green.add(gate.command)
            good = row["green_without"] and row["red_with"]
            held += good
            if not good:
                reporter.note(f"{gate.name}: {row}\n{said[-2000:]}")
            reporter.update(number)
    if not arguments.only:
        record.store(arguments.out, {"gates": len(rows), "seen_red": held, "list": rows})
    print(f"{held} of {len(rows)} gates seen red with a violation and green without")
    sys.exit(held != len(rows))


if __name__ == "__main__":
    main()
