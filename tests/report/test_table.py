"""The table says what the summaries say, beside what was published."""

import dataclasses
import math

import pytest

from lanewise.evaluation.metrics import summarise
from lanewise.report import arms, curves, profiles, table


@pytest.fixture
def summaries(episodes):
    pairs = [("hierarchical", "lanewise"), ("hierarchical", "highway-env")]
    pairs += [("single-level", "lanewise"), ("single-level", "highway-env")]
    return [summarise(episodes, controller=c, world=w, unlike_paper="") for c, w in pairs]


def test_published_stands_first_in_the_papers_order(summaries):
    heads = [(c.controller, c.source) for c in table.columns(summaries)]
    sources = ["published", "lanewise", "highway-env"]
    assert heads == [(c, s) for c in ("single-level", "hierarchical") for s in sources]


def test_other_controllers_have_no_published_column(episodes):
    own = [summarise(episodes, controller="mine", world="lanewise")]
    assert [c.source for c in table.columns(own)] == ["lanewise"]


@pytest.mark.parametrize("make", [table.text, table.markdown])
def test_published_stands_only_beside_the_papers_own_test(episodes, make):
    own = summarise(episodes, controller="hierarchical", world="lanewise", unlike_paper="")
    other = dataclasses.replace(own, unlike_paper="scenario.lanes is 4, not 3")
    unknown = dataclasses.replace(own, unlike_paper=None)
    assert "331.6" in make([own])
    assert table.LEFT_OUT not in make([own])
    for summaries in ([other], [own, other]):
        assert "331.6" not in make(summaries)
        assert f"{table.LEFT_OUT}\n- hierarchical: scenario.lanes is 4, not 3\n" in make(summaries)
    # Whoever has not looked claims nothing.
    assert "331.6" not in make([unknown])
    # A controller without published figures misses none.
    assert table.LEFT_OUT not in make([dataclasses.replace(other, controller="mine")])


def test_markdown_is_a_rectangle(summaries):
    lines = [line for line in table.markdown(summaries).splitlines() if line.startswith("|")]
    assert len({line.count("|") for line in lines}) == 1
    for row in (
        "| success (paper), % | 0.00 (0.0, 1.2) | 97.67 (95.3, 99.1) |",
        "| success, % | - | 97.67 (95.3, 99.1) |",
    ):
        assert row in table.markdown(summaries)
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


def test_rewards_and_goals_say_how_they_are_counted(summaries):
    """Training sums one reward a decision, a test one a second; a goal given up is no time-out."""
    for shown in (table.text(summaries), table.markdown(summaries)):
        assert "reward, 1 a second" in shown
        assert "goals given up, %" in shown
        assert "time-outs" not in shown
    assert [title for _, title, *_ in arms.TRAINING[:2]] == [
        "reward, 1 a decision",
        "reward, 1 a second",
    ]
    labels = [label for _, label, *_ in (*curves.PANELS, *profiles.PANELS)]
    assert [label.split("\n")[-1] for label in labels if "reward" in label] == [
        "one a decision",
        "of a decision",
        "one a second",
    ]
