"""Deliberate faults: every fault fits the source, and the campaign says whether tests catch it."""

import os
import subprocess
import sys
from pathlib import Path

import pytest
from faults import Fault, key, load, problems

ROOT = Path(__file__).parents[2]
SOURCE = """
def total(values):
    result = 0
    for value in values:
        result += value
    return result
"""
TESTS = """
from lanewise.toys.sums import total


def test_total():
    assert total([1, 2]) == 3


def test_nothing():
    assert total([]) == 0
"""


def fault(name, old, new, *tests):
    return Fault(name, "toys/sums.py", old, new, "sums are sums", tests or ("tests/test_sums.py",))


CAUGHT = fault("caught", "+= value", "-= value")
SURVIVES = fault("survives", "+= value", "-= value", "tests/test_sums.py::test_nothing")
ENDLESS = fault("endless", "result = 0", "result = __import__('time').sleep(600)")


@pytest.fixture
def tree(tmp_path):
    """A project of one module."""
    tree = tmp_path / "tree"
    for name, text in {
        "src/lanewise/__init__.py": "",
        "src/lanewise/toys/sums.py": SOURCE,
        "tests/test_sums.py": TESTS,
        "pyproject.toml": "[tool.pytest.ini_options]\nmarkers = ['slow']\n",
    }.items():
        (tree / name).parent.mkdir(parents=True, exist_ok=True)
        (tree / name).write_text(text)
    return tree


def test_the_list_is_whole():
    every = load()
    assert problems(every, ROOT) == []
    assert len(every) >= 100


def test_a_list_that_no_longer_fits_is_noticed(tree):
    assert problems([CAUGHT, SURVIVES, ENDLESS], tree) == []
    for wrong, said in (
        (fault("gone", "+= values", "-= values"), "has its old text 0 times"),
        (fault("twice", "value", "number"), "has its old text 4 times"),
        (fault("same", "+= value", "+=  value"), "changes nothing"),
        (fault("no-python", "+= value", "+= value)"), "is no Python"),
        (fault("no-test", "+= value", "-= value", "tests/test_sums.py::test_sum"), "no test"),
        (fault("no-file", "+= value", "-= value", "tests/test_sum.py"), "no test"),
    ):
        (problem,) = problems([wrong], tree)
        assert said in problem
    assert len(problems([CAUGHT, CAUGHT], tree)) == 1


PROGRAM = f"""
import sys
from pathlib import Path

import pytest

sys.path.insert(0, {str(ROOT / "campaigns")!r})
from faults import Fault, key, try_fault

tree, name, *parts = sys.argv[1:]
fault = Fault(name, "toys/sums.py", *parts[:2], "sums are sums", tuple(parts[2:]))
print(try_fault(fault, Path(tree), Path(tree).parent, set(), seconds=3.0))
"""


def outcome(tree, fault):
    """What the campaign says of a fault. It forks, which threads of JAX do not survive."""
    words = [str(tree), fault.name, fault.old, fault.new, *fault.tests]
    made = subprocess.run(
        [sys.executable, "-c", PROGRAM, *words], capture_output=True, text=True, check=False,
        env=os.environ | {"PYTEST_DISABLE_PLUGIN_AUTOLOAD": "1"},
    )  # fmt: skip
    return made.stdout + made.stderr


def test_a_fault_is_caught_or_survives_or_takes_too_long(tree):
    assert "'caught', 'caught_by': 'tests/test_sums.py::test_total'" in outcome(tree, CAUGHT)
    assert "'outcome': 'survived'" in outcome(tree, SURVIVES)
    assert "'outcome': 'timed out'" in outcome(tree, ENDLESS)
    assert (tree / "src/lanewise/toys/sums.py").read_text() == SOURCE


def test_a_test_that_always_fails_or_is_slow_catches_nothing(tree):
    file = tree / "tests/test_sums.py"
    file.write_text(TESTS.replace("== 3", "== 4"))
    assert "test_total fails without any fault" in outcome(tree, CAUGHT)
    file.write_text(f"import pytest\n\npytestmark = pytest.mark.slow\n{TESTS}")
    assert "no default test" in outcome(tree, CAUGHT)


def test_an_outcome_holds_as_long_as_file_and_tests_are_the_same(tree):
    before = key(CAUGHT, tree)
    assert key(CAUGHT, tree) == before
    (tree / "tests/test_sums.py").write_text(TESTS + "\n")
    assert key(CAUGHT, tree) != before
