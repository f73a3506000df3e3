"""Deliberate faults: the list can be put in, and the campaign tells what the tests made of each."""

from pathlib import Path

import faults
import pytest
from fault_list import Fault, load, problems

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
        "pyproject.toml": "[tool.pytest.ini_options]\n",
    }.items():
        (tree / name).parent.mkdir(parents=True, exist_ok=True)
        (tree / name).write_text(text)
    return tree


class Notes(list):
    """A reporter that remembers its notes."""

    note = list.append

    def stage(self, *_):
        pass

    def update(self, *_, **__):
        pass


def test_the_list_is_whole():
    every = load()
    assert problems(every, ROOT) == []
    assert len(every) >= 100
    counts = {area: sum(fault.area == area for fault in every) for area in {f.area for f in every}}
    assert counts.keys() >= {"world", "scenario", "driving", "learning", "training", "controllers"}
    assert min(counts[area] for area in counts if area != "system") >= 10


def test_a_list_that_has_rotted_is_seen(tree):
    assert problems([CAUGHT, SURVIVES, ENDLESS], tree) == []
    for wrong, said in (
        (fault("gone", "+= values", "-= values"), "stands 0 times"),
        (fault("twice", "value", "number"), "stands 4 times"),
        (fault("same", "+= value", "+=  value"), "changes nothing"),
        (fault("no-python", "+= value", "+= value)"), "is no Python"),
        (fault("no-test", "+= value", "-= value", "tests/test_sums.py::test_sum"), "no test"),
        (fault("no-file", "+= value", "-= value", "tests/test_sum.py"), "no test"),
    ):
        (problem,) = problems([wrong], tree)
        assert said in problem
    assert len(problems([CAUGHT, CAUGHT], tree)) == 1


def test_faults_are_caught_or_not_and_a_campaign_goes_on(tree, tmp_path, monkeypatch):
    monkeypatch.setenv("PYTEST_DISABLE_PLUGIN_AUTOLOAD", "1")
    path = tmp_path / "outcomes.jsonl"
    kept, notes = faults.Record(path, tree), Notes()
    with faults.Runner(tree, tmp_path, ("pytest",)) as runner:
        # A test that always fails catches nothing.
        (tree / "tests/test_sums.py").write_text(TESTS.replace("== 3", "== 4"))
        with pytest.raises(faults.CampaignError, match="test_total fails without any fault"):
            faults.campaign([CAUGHT], tree, runner, kept, notes, 60.0)
        assert not path.exists()
        (tree / "tests/test_sums.py").write_text(TESTS)
        faults.campaign([CAUGHT, SURVIVES], tree, runner, kept, notes, 60.0)
        faults.campaign([ENDLESS], tree, runner, kept, notes, 2.0)
    assert (tree / "src/lanewise/toys/sums.py").read_text() == SOURCE
    assert notes == ["survives: survived", "endless: timed out"]
    # Nothing is left to do: there is nobody to do it.
    again = faults.Record(path, tree)
    faults.campaign([CAUGHT, SURVIVES, ENDLESS], tree, None, again, notes, 2.0)
    # With more time a test that had too little may yet fail or pass.
    assert again.knows(SURVIVES, 60.0)
    assert not again.knows(ENDLESS, 60.0)
    found = faults.figures([CAUGHT, SURVIVES, ENDLESS], again)
    assert [found[name] for name in ("faults", "caught", "timed out", "survived")] == [3, 1, 1, 1]
    assert found["areas"]["toys"]["caught"] == 1
    assert found["list"][0]["caught_by"] == "tests/test_sums.py::test_total"
    # An outcome holds as long as the tests are the same.
    (tree / "tests/test_sums.py").write_text(TESTS + "\n")
    assert again.find(CAUGHT) is None
