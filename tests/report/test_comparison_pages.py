"""A comparison's pages say what its figures say, in a terminal's width and in every format."""

import csv
import io
import json

import pytest
from fabricate import make_episodes

from lanewise.evaluation.comparison import Entry, compare
from lanewise.report import comparison
from lanewise.report.comparison import Page
from lanewise.report.sections import letter

RUNS = [
    Entry("runs/a0", "hierarchical", 0, "x"),
    Entry("runs/a1", "hierarchical", 1, "x"),
    Entry("runs/b0", "single-level", 0, "x"),
    Entry("runs/b1", "single-level", 1, "x"),
]
EPISODES = [make_episodes(successes) for successes in (293, 300, 0, 3)]
SETTINGS = {"scenario.lanes": (3, 3, 4, 4), "goals.reference": ("a", "a", "b", "b")}


def make_page(runs=RUNS, episodes=EPISODES, **rest):
    return Page(compare(runs, episodes, "lanewise"), SETTINGS, 5, **rest)


@pytest.fixture
def page():
    return make_page()


def rows(text, title):
    """The lines of a table of the text, below the rule of its first columns."""
    lines = text.split(f"\n\n{title}\n")[1].split("\n\n")[0].splitlines()
    rules = [place for place, line in enumerate(lines) if line.startswith("---")]
    return lines[rules[0] + 1 : rules[1] - 2]


def test_text_fits_a_terminal(page):
    text = comparison.text(page)
    assert max(map(len, text.splitlines())) <= 80
    assert "A  runs/a0  hierarchical, seed 0\n" in text
    assert "300 test episodes each in lanewise, starts of seed 5.\n" in text
    assert "arm 1: A B\narm 2: C D\n" in text
    assert "[" not in text


def test_what_is_wider_stands_in_two_blocks_shares_before_means(page):
    lines = comparison.text(page).split("\n\nRuns\n")[1].split("\n\n")[0].splitlines()
    heads = [lines[place - 2].split() for place, line in enumerate(lines) if line[0] == "-"]
    assert heads == [
        ["success", "(paper)", "success", "accidents"],
        ["reward", "speed", "distance"],
    ]
    assert [line[0] for line in lines if line[:1].isalpha()] == list("ABCDABCD")


def test_runs_stand_with_their_intervals(page):
    table = rows(comparison.text(page), "Runs")
    assert table[0].split() == ["A", "97.67", "97.67", "2.33"]
    assert "(95.3, 99.1)" in table[1]
    assert [line[0] for line in table[::2]] == ["A", "B", "C", "D"]


def test_differences_stand_with_discordant_pairs_and_p(page):
    table = rows(comparison.text(page), "Minus A, start by start")
    assert table[0].split() == ["B", "+2.33", "+2.33", "-2.33"]
    assert table[1].split() == ["+7", "-0", "+7", "-0", "+0", "-7"]
    assert table[2].split() == ["p", "0.016"] * 3
    assert table[5].split() == ["p", "<0.001"] * 3


def test_arms_and_chances(page):
    text = comparison.text(page)
    means = rows(text, "Interquartile mean over the seeds of an arm")
    assert means[0].split() == ["1", "98.83", "98.83", "1.17"]
    assert "(97.7, 100.0)" in means[1]
    chances = rows(text, "P(better than arm 1)")
    assert chances[0].split() == ["2", "0.00", "0.00", "0.00"]


def test_columns_are_aligned_across_tables(page):
    lines = [line for line in comparison.text(page).splitlines() if "distance" in line]
    assert len(lines) == 4
    assert len({line.index("distance") + len("distance") for line in lines}) == 1


def test_single_seeds_have_no_arms():
    text = comparison.text(make_page(RUNS[1:3], EPISODES[1:3]))
    assert "arm " not in text
    assert "Interquartile" not in text
    assert "P(better" not in text


def test_settings_are_listed_by_value(page):
    text = comparison.text(page)
    assert 'scenario.lanes: 3 (A B), 4 (C D)\ngoals.reference: "a" (A B), "b" (C D)\n' in text
    same = Page(page.comparison, {}, 5)
    assert "Settings that differ\nnone\n" in comparison.text(same)


def test_the_scenario_asked_for_is_named():
    page = make_page(scenario_of="runs/b0")
    assert "starts of seed 5, scenario of runs/b0." in comparison.text(page)
    assert comparison.to_json(page)["scenario_of"] == "runs/b0"


def test_json_is_json_and_names_every_run(page):
    stored = json.loads(json.dumps(comparison.to_json(page), allow_nan=False))
    assert [run["run"] for run in stored["runs"]] == [run.name for run in RUNS]
    assert stored["runs"][0]["success_rate"] == pytest.approx(293 / 300)
    assert stored["settings"]["scenario.lanes"] == [3, 3, 4, 4]
    assert [found["run"] for found in stored["differences"]] == [1, 2, 3]
    assert stored["differences"][0]["success_rate"]["only_this"] == 7
    assert stored["arms"][0]["values"]["success_rate"] == pytest.approx([293 / 300, 1.0])
    assert stored["arms"][0]["interquartile_mean"]["success_rate"]["interval"] is not None
    # Both seeds of the one lie below both of the other: no spread, hence no interval.
    assert stored["improvements"][0]["probability"]["success_rate"] == {
        "value": 0.0,
        "interval": None,
    }


def test_markdown_tables_are_rectangles(page):
    text = comparison.markdown(page)
    blocks = [part for part in text.split("\n\n") if part.startswith("|")]
    assert len(blocks) == 4
    for block in blocks:
        assert len({line.count("|") for line in block.splitlines()}) == 1
    assert "| A | 97.67 (95.3, 99.1) | 97.67 (95.3, 99.1) | 2.33 (0.9, 4.7) |" in text
    assert "| B | +2.33 (+7 -0, p 0.016) | +2.33 (+7 -0, p 0.016) |" in text
    assert "lanewise 0." in text


def test_csv_has_one_row_a_run_and_metric(page):
    table = list(csv.DictReader(io.StringIO(comparison.to_csv(page))))
    assert len(table) == 4 * 9
    first = table[0]
    assert (first["run"], first["arm"], first["metric"]) == ("runs/a0", "0", "escape_rate")
    assert float(first["value"]) == 293 / 300
    assert float(first["low"]) == pytest.approx(0.9525, abs=1e-4)
    unknown = next(
        row for row in table if row["run"] == "runs/b0" and row["metric"] == "escape_time"
    )
    assert unknown["value"] == unknown["low"] == ""


def test_hostile_names_do_no_harm():
    name = "a|b`\x1b[31m\n# c,d"
    page = make_page([Entry(name, "hierarchical", 9, "z"), *RUNS[1:]])
    assert "\x1b" not in comparison.text(page)
    assert comparison.text(page).startswith("A  a|b`\\x1b[31m\\n# c,d  hierarchical")
    assert "\n# c" not in comparison.markdown(page)
    assert next(csv.DictReader(io.StringIO(comparison.to_csv(page))))["run"] == name


def test_letters_go_on_after_z():
    assert [letter(i) for i in (0, 25, 26, 51, 52, 701, 702)] == [
        "A", "Z", "AA", "AZ", "BA", "ZZ", "AAA",
    ]  # fmt: skip
