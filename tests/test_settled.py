"""Facts about the package that break easily and are noticed late."""

import ast
import re
import subprocess
import sys
import tomllib
from collections import Counter
from importlib.metadata import version
from pathlib import Path

import pytest
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

import lanewise

ROOT = Path(__file__).parents[1]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())


def imported(modules, heavy="jax optax"):
    """The first of these modules that has a heavy one imported, in one process; empty if none."""
    program = (
        "import sys, importlib\n"
        "for name in sys.argv[2:]:\n"
        "    importlib.import_module(name)\n"
        "    if set(sys.argv[1].split()) & set(sys.modules): sys.exit(print(name))"
    )
    command = [sys.executable, "-c", program, heavy, *modules]
    return subprocess.run(command, capture_output=True, text=True, check=True).stdout.strip()


def test_imports_without_jax():
    """What an import contract says of the source holds when it runs, parent packages included."""
    contracts = PROJECT["tool"]["importlinter"]["contracts"]
    (contract,) = (each for each in contracts if "jax" in each.get("forbidden_modules", []))
    settings = sorted((ROOT / "src" / "lanewise").glob("*/settings.py"))
    modules = [f"lanewise.{path.parent.name}.settings" for path in settings]
    modules += [name for name in contract["source_modules"] if "*" not in name]
    assert len(modules) > 25
    assert imported(["lanewise"], "gymnasium jax numpy") == ""
    assert imported(["lanewise", "lanewise.cli", *modules]) == ""
    assert imported(["lanewise", "lanewise.world.tick"]) == "lanewise.world.tick"


def test_no_name_stands_twice():
    """Two modules, or two classes, of one name would be taken for each other."""
    modules = Counter(
        path.name
        for place in ("src/lanewise", "tests")
        for path in (ROOT / place).rglob("*.py")
        if path.name not in ("__init__.py", "settings.py", "conftest.py")
    )
    classes = Counter(
        node.name
        for path in (ROOT / "src" / "lanewise").rglob("*.py")
        # It stands alone, outside the package, and calls what it has as its users do.
        if path.name != "numpy_policy.py"
        for node in ast.walk(ast.parse(path.read_text()))
        if isinstance(node, ast.ClassDef)
    )
    assert [name for name, count in (modules + classes).items() if count > 1] == []


def test_version_is_one():
    citation = re.search(r"^version: (\S+)$", (ROOT / "CITATION.cff").read_text(), re.MULTILINE)
    assert (
        PROJECT["project"]["version"] == citation[1] == lanewise.__version__ == version("lanewise")
    )


def test_types_are_shipped():
    assert (Path(lanewise.__file__).parent / "py.typed").exists()


def test_highway_env_version_is_the_one_we_speak_of():
    assert version("highway-env") == "1.12.1"


KNOWN = "print(gymnasium.spec('lanewise/Trap-v0').entry_point)"
ORDERS = {
    "lanewise first": f"import lanewise, gymnasium; {KNOWN}",
    "gymnasium first": f"import gymnasium, lanewise; {KNOWN}",
    "long after": f"import lanewise.cli, json; import gymnasium as gym; import gymnasium; {KNOWN}",
}


@pytest.mark.parametrize("order", ORDERS)
def test_it_is_known(order):
    words = [sys.executable, "-W", "error::UserWarning", "-c", ORDERS[order]]
    done = subprocess.run(words, capture_output=True, text=True, check=False)
    assert (done.stdout.strip(), done.returncode) == ("lanewise.envs.single:TrapEnv", 0), done


LOCK = (ROOT / "requirements/ci.txt").read_text("utf-8")
PIN = re.compile(
    r"^([a-z0-9-]+)==(\S+)(?: ; [^\\]+)? \\\n((?:    --hash=sha256:[0-9a-f]{64}.*\n)+)", re.M
)


def direct(texts):
    """Requirements, with those of our own extras in their place."""
    found = []
    for text in texts:
        wanted = Requirement(text)
        if wanted.name == PROJECT["project"]["name"]:
            for extra in wanted.extras:
                found += direct(PROJECT["project"]["optional-dependencies"][extra])
        else:
            found.append(wanted)
    return found


WANTED = direct([*PROJECT["project"]["dependencies"], "lanewise[test,docs]"])


def test_the_lock_is_within_the_ranges():
    locked = {}
    for name, pin, _ in PIN.findall(LOCK):
        # Some have a version for each Python.
        locked.setdefault(name, []).append(pin)
    assert len(WANTED) > 25
    for wanted in WANTED:
        versions = locked.get(canonicalize_name(wanted.name), [])
        assert versions, f"{wanted}: run .ci/lock"
        assert all(map(wanted.specifier.contains, versions)), f"{wanted}: run .ci/lock"


def test_the_lock_holds_pins_with_hashes_alone():
    assert PIN.sub("", LOCK).count("\n") == 1
    assert LOCK.startswith("# Made by .ci/lock")
    assert "://" not in LOCK


def test_every_range_says_its_oldest_version():
    for wanted in direct([*PROJECT["project"]["dependencies"], "lanewise[test,docs,examples]"]):
        assert {each.operator for each in wanted.specifier} & {">=", "=="}, wanted
