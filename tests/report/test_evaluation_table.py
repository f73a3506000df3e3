"""The table says what the summaries say, beside what was published."""

import dataclasses
import math

import pytest

from lanewise.evaluation.metrics import summarise
from lanewise.report import evaluation_table, experiment_tables, profiles, tables, training_curves
from lanewise.report.evaluation_table import columns, markdown, text


@pytest.fixture
def summaries(episodes):
    return [
        summarise(episodes, controller=controller, world=world, unlike_paper="")
        for controller in ("hierarchical", "single-level")
        for world in ("lanewise", "highway-env")
    ]


def test_published_stands_first_in_the_papers_order(summaries, episodes):
    sources = ["published", "lanewise", "highway-env"]
    assert [(each.controller, each.world) for each in columns(summaries)] == [
        (controller, source)
        for controller in ("single-level", "hierarchical")
        for source in sources
    ]
    own = [summarise(episodes, controller="mine", world="lanewise")]
    assert columns(own) == own


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


def test_hostile_names_stay_inside_their_cell_and_steer_no_terminal(episodes):
    name = "a|b`<img src=x>\n# c"
    heads = markdown([summarise(episodes, controller=name, world="w|")]).splitlines()[0]
    assert heads == r"|  | a\|b\`\<img src=x\> \# c, w\| |"
    shown = text([summarise(episodes, controller="a\x1b[2J\nb", world="w")]).splitlines()
    assert shown[0].split() == ["a\\x1b[2J", "b", "w"]


def test_unknown_values_are_dashes(episodes):
    summary = summarise(episodes, controller="mine", world="lanewise")
    summary.values["escape_time"] = math.nan
    rest = summarise(episodes, controller="mine", world="highway-env")
    row = next(x for x in text([summary, rest]).splitlines() if x.startswith("escape"))
    assert row.split()[3] == "-"


def test_rewards_and_goals_say_how_they_are_counted(summaries):
    """Training sums one reward a decision, a test one a second; a goal given up is no time-out."""
    for shown in (text(summaries), markdown(summaries)):
        assert "reward, 1 a second" in shown
        assert "goals given up, %" in shown
    titles = [title for _, title, *_ in experiment_tables.TRAINING[:2]]
    assert titles == ["reward, 1 a decision", "reward, 1 a second"]
    labels = [label for _, label, *_ in (*training_curves.PANELS, *profiles.PANELS)]
    counted = [label.split("\n")[-1] for label in labels if "reward" in label]
    assert counted == ["one a decision", "of a decision", "one a second"]
    assert max(map(len, evaluation_table.NOTE)) <= 80
