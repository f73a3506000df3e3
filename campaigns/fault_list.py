"""The list of deliberate faults: one file an area in `fault_lists/`, read and checked.

A fault is a piece of the source, what stands there instead, the rule that this breaks, and the
tests that cover it: the cheapest that should see it.
"""

import ast
import tomllib
from dataclasses import dataclass
from functools import cache
from pathlib import Path

LISTS = Path(__file__).parent / "fault_lists"
SOURCE = Path("src", "lanewise")


@dataclass(frozen=True)
class Fault:
    """One deliberate fault."""

    name: str
    file: str
    """Below `SOURCE`."""
    old: str
    """Stands there exactly once."""
    new: str
    breaks: str
    """The rule."""
    tests: tuple[str, ...]
    """pytest's node identifiers, parameters left out or given."""

    @property
    def area(self):
        """The room of the house."""
        return self.file.split("/")[0]

    @property
    def path(self):
        """Of the file, from the root."""
        return SOURCE / self.file


def load(folder=LISTS):
    """Every fault, area by area."""
    faults = []
    for path in sorted(folder.glob("*.toml")):
        for entry in tomllib.loads(path.read_text())["fault"]:
            faults.append(Fault(**entry | {"tests": tuple(entry["tests"])}))
    return faults


def altered(fault, root):
    """The text of the file with the fault.

    Raises:
        ValueError: the old text does not stand there exactly once.
    """
    text = (root / fault.path).read_text()
    count = text.count(fault.old)
    if count != 1:
        raise ValueError(f"{fault.name}: its old text stands {count} times in {fault.file}")
    return text.replace(fault.old, fault.new)


def problems(faults, root):
    """What is wrong with a list, a line each."""
    found = []
    names = [fault.name for fault in faults]
    found += [f"{name}: two faults have this name" for name in set(names) if names.count(name) > 1]
    for fault in faults:
        try:
            after = altered(fault, root)
        except (OSError, ValueError) as error:
            found.append(str(error))
            continue
        if fault.old.split() == fault.new.split():
            found.append(f"{fault.name}: changes nothing that runs")
        try:
            ast.parse(after)
        except SyntaxError as error:
            found.append(f"{fault.name}: with it {fault.file} is no Python, {error}")
        if not fault.tests:
            found.append(f"{fault.name}: no test covers it")
        for test in fault.tests:
            if not _exists(test, root):
                found.append(f"{fault.name}: there is no test {test}")
    return found


@cache
def _exists(test, root):
    """Whether a node identifier leads to a file, and to a function in it if it names one."""
    file, *names = test.split("::")
    path = root / file
    if not path.exists():
        return False
    body = _body(path) if path.is_file() else []
    for name in names:
        plain = name.split("[")[0]
        body = next((node.body for node in body if getattr(node, "name", None) == plain), None)
        if body is None:
            return False
    return True


@cache
def _body(path):
    return ast.parse(path.read_text()).body
