"""The table says what the summaries say, beside what was published."""

import math

import pytest

from lanewise.evaluation.metrics import summarise
from lanewise.report import table


@pytest.fixture
def summaries(episodes):
    pairs = [("hierarchical", "lanewise"), ("hierarchical", "highway-env")]
    pairs += [("single-level", "lanewise"), ("single-level", "highway-env")]
    return [summarise(episodes, controller=c, world=w) for c, w in pairs]


def test_published_stands_first_in_the_papers_order(summaries):
    heads = [(c.controller, c.source) for c in table.columns(summaries)]
    sources = ["published", "lanewise", "highway-env"]
    assert heads == [(c, s) for c in ("single-level", "hierarchical") for s in sources]


def test_other_controllers_have_no_published_column(episodes):
    own = [summarise(episodes, controller="mine", world="lanewise")]
    assert [c.source for c in table.columns(own)] == ["lanewise"]


def test_markdown_is_a_rectangle(summaries):
    lines = [line for line in table.markdown(summaries).splitlines() if line.startswith("|")]
    assert len({line.count("|") for line in lines}) == 1
    assert "| success, % | 0.00 (0.0, 1.2) | 97.67 (95.3, 99.1) |" in table.markdown(summaries)
    assert "13.42" in table.markdown(summaries)


def test_text_fits_a_terminal(summaries):
    text = table.text(summaries)
    assert max(map(len, text.splitlines())) <= 80
    assert "331.6" in text
    assert "off road" in text
    assert "[" not in text


def test_hostile_names_stay_inside_their_cell(episodes):
    name = "a|b`<img src=x>\n# c"
    lines = table.markdown([summarise(episodes, controller=name, world="w|")]).splitlines()
    assert lines[0] == r"| | a\|b\`\<img src=x\> \# c, w\| |"


def test_hostile_names_steer_no_terminal(episodes):
    lines = table.text([summarise(episodes, controller="a\x1b[2J\nb", world="w")]).splitlines()
    assert lines[0].split() == ["a\\x1b[2J", "b", "w"]


def test_unknown_values_are_dashes(episodes):
    summary = summarise(episodes, controller="mine", world="lanewise")
    summary.values["escape_time"] = math.nan
    rest = summarise(episodes, controller="mine", world="highway-env")
    row = next(x for x in table.text([summary, rest]).splitlines() if x.startswith("escape"))
    assert row.split()[3] == "-"
