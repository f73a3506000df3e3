"""Facts about the package that break easily and are noticed late."""

import ast
import re
import subprocess
import sys
import tomllib
from collections import Counter
from importlib.metadata import version
from pathlib import Path

import lanewise

ROOT = Path(__file__).parents[1]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())


def imported(modules):
    """The first of these modules that has JAX imported, in one process; empty if none has."""
    program = (
        "import sys, importlib\n"
        "for name in sys.argv[1:]:\n"
        "    importlib.import_module(name)\n"
        "    if {'jax', 'optax'} & set(sys.modules): sys.exit(print(name))"
    )
    command = [sys.executable, "-c", program, *modules]
    return subprocess.run(command, capture_output=True, text=True, check=True).stdout.strip()


def test_imports_without_jax():
    """What an import contract says of the source holds when it runs, parent packages included."""
    contracts = PROJECT["tool"]["importlinter"]["contracts"]
    (contract,) = (each for each in contracts if "jax" in each.get("forbidden_modules", []))
    settings = sorted((ROOT / "src" / "lanewise").glob("*/settings.py"))
    modules = [f"lanewise.{path.parent.name}.settings" for path in settings]
    modules += [name for name in contract["source_modules"] if "*" not in name]
    assert len(modules) > 25
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
