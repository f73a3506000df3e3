"""The table says what the summaries say, beside what was published."""

import dataclasses
import math

import pytest

from lanewise.evaluation.metrics import summarise
from lanewise.report import tables
from lanewise.report.evaluation_table import markdown, text


@pytest.fixture
def summaries(episodes):
    return [
        summarise(episodes, controller=controller, world=world, unlike_paper="")
        for controller in ("hierarchical", "single-level")
        for world in ("lanewise", "highway-env")
    ]


@pytest.mark.parametrize("make", [text, markdown])
def test_published_stands_only_beside_the_papers_own_test(episodes, make):
    own = summarise(episodes, controller="hierarchical", world="lanewise", unlike_paper="")
    other = dataclasses.replace(own, unlike_paper="scenario.lanes is 4, not 3")
    unknown = dataclasses.replace(own, unlike_paper=None)
    assert "331.6" in make([own])
    assert tables.LEFT_OUT not in make([own])
    for summaries in ([other], [own, other]):
        assert "331.6" not in make(summaries)
        said = f"{tables.LEFT_OUT}\n- hierarchical: scenario.lanes is 4, not 3\n"
        assert said in make(summaries)
    # Whoever has not looked claims nothing.
    assert "331.6" not in make([unknown])
    # A controller without published figures misses none.
    assert tables.LEFT_OUT not in make([dataclasses.replace(other, controller="mine")])


def test_markdown_is_a_rectangle(summaries):
    lines = [line for line in markdown(summaries).splitlines() if line.startswith("|")]
    assert len({line.count("|") for line in lines}) == 1
    assert "| success (paper), % | 0.00 (0.0, 1.2) | 97.67 (95.3, 99.1) |" in lines[3]
    assert any(line.startswith("| success, % | - | 97.67 (95.3, 99.1) |") for line in lines)


def test_text_fits_a_terminal(summaries):
    shown = text(summaries)
    assert max(map(len, shown.splitlines())) <= 80
    assert "331.6" in shown
    assert "off road" in shown
    assert "[" not in shown


def test_unknown_values_are_dashes(episodes):
    summary = summarise(episodes, controller="mine", world="lanewise")
    summary.values["escape_time"] = math.nan
    rest = summarise(episodes, controller="mine", world="highway-env")
    row = next(x for x in text([summary, rest]).splitlines() if x.startswith("escape"))
    assert row.split()[3] == "-"
