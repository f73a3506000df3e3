"""Shuffled runs: which tests take part, in which order, and that a flake is seen."""

import ast
import json
import textwrap
from itertools import pairwise

import pytest
import shuffle_selection
import shuffled

FLAKY = """
    import random
    import time

    import pytest

    NOISE = random.Random(1)
    seen = []


    def noise():
        return NOISE.random()


    @pytest.fixture
    def clock():
        return time.monotonic


    def test_plain():
        assert 1 + 1 == 2


    def test_helper():
        seen.append("helper")
        assert noise() < 1.0


    def test_fixture(clock):
        assert not seen or seen[-1] != "never"


    class TestFiles:
        def test_first(self, tmp_path):
            seen.append("first")

        @pytest.mark.parametrize("number", range(3))
        def test_after(self, tmp_path, number):
            assert "first" in seen


    @pytest.mark.slow
    def test_slow(tmp_path):
        assert False
"""

SEED = 1
"""With it a test comes before the one it needs."""


@pytest.fixture
def project(tmp_path):
    """Two files; in one of them a test passes only after another."""
    tests = tmp_path / "project" / "tests"
    tests.mkdir(parents=True)
    (tests / "test_flaky.py").write_text(textwrap.dedent(FLAKY))
    (tests / "test_other.py").write_text("def test_file(tmp_path):\n    pass\n")
    options = '[tool.pytest.ini_options]\nmarkers = ["slow"]\n'
    (tests.parent / "pyproject.toml").write_text(options)
    return tests.parent


def test_what_takes_part(project):
    found = shuffled.select(project)
    flaky = "tests/test_flaky.py::"
    assert found == {
        f"{flaky}test_helper": ["randomness"],
        f"{flaky}test_fixture": ["time"],
        f"{flaky}TestFiles::test_first": ["files"],
        f"{flaky}TestFiles::test_after": ["files"],
        "tests/test_other.py::test_file": ["files"],
    }


def test_orders_differ_and_a_test_that_needs_another_is_seen(project, tmp_path, monkeypatch):
    monkeypatch.setenv("PYTEST_DISABLE_PLUGIN_AUTOLOAD", "1")
    tests = shuffled.select(project)
    written, _ = shuffled.run(tests, None, tmp_path, project)
    assert not any(outcome["failed"] for outcome in written.values())
    assert len(written) == 7
    shuffled_ones, _ = shuffled.run(tests, SEED, tmp_path, project)
    assert shuffled_ones.keys() == written.keys()
    assert tuple(shuffled_ones) != tuple(written)
    failed = [test for test, outcome in shuffled_ones.items() if outcome["failed"]]
    assert failed
    assert all("test_after" in test for test in failed)
    # A file's tests stay together.
    files = [test.split("::")[0] for test in shuffled_ones]
    assert sum(one != other for one, other in pairwise(files)) == 1


def test_every_file_has_its_turn():
    cost = {"a": 1.0, "b": 2.0, "c": 30.0, "d": 50.0, "e": 500.0}
    turn, seen = 0, []
    for _ in range(6):
        files, turn = shuffled.share_out(cost, turn, 100.0)
        assert files[:3] == ["a", "b", "c"]
        seen += files[3:]
    assert seen == ["d", "e"] * 3
    assert shuffled.share_out(cost, 0, float("inf"))[0] == list(cost)


def test_runs_are_kept_as_long_as_nothing_has_changed(tmp_path):
    path, outcomes = tmp_path / "runs.jsonl", {"f::t": {"seconds": 1.5, "failed": True}}
    made = shuffled.Kept(path, "now").get(7, lambda: (outcomes, 2.0))
    assert made["failed"] == ["f::t"]
    assert made["files"] == {"f": 1.5}
    assert shuffled.Kept(path, "now").get(7, None) == made
    assert shuffled.Kept(path, "later").runs == {}
    stored = json.loads(json.dumps(shuffled.figures({"f::t": ["time"]}, made, [made])))
    assert stored["failures"] == [{"seed": 7, "test": "f::t"}]


def test_names_are_those_of_arguments_attributes_and_keywords():
    names = shuffle_selection.names_in(ast.parse("def f(a): return b.c(d=e)"))
    assert names == {"a", "b", "c", "d", "e"}
