"""A comparison's pages say what its figures say, in a terminal's width and in every format."""

import csv
import io
import json

import pytest
from fabricate import make_episodes

from lanewise.evaluation.comparison import Entry, compare
from lanewise.report.comparison_page import ComparisonPage, markdown, text, to_csv, to_json

RUNS = [
    Entry("runs/a0", "hierarchical", 0, "x"),
    Entry("runs/a1", "hierarchical", 1, "x"),
    Entry("runs/b0", "single-level", 0, "x"),
    Entry("runs/b1", "single-level", 1, "x"),
]
EPISODES = [make_episodes(successes) for successes in (293, 300, 0, 3)]
SETTINGS = {"scenario.lanes": (3, 3, 4, 4), "goals.reference": ("a", "a", "b", "b")}


def make_page(runs=RUNS, episodes=EPISODES, **rest):
    return ComparisonPage(compare(runs, episodes, "lanewise"), SETTINGS, 5, **rest)


@pytest.fixture(scope="module")
def page():
    return make_page()


def blocks(page, title):
    """The two tables below a title of the text, shares and means: (heads, rows) as words."""
    lines = text(page).split(f"\n\n{title}\n")[1].split("\n\n")[0].splitlines()
    first, second = (place for place, line in enumerate(lines) if line.startswith("---"))
    heads = [lines[place - 2].split() for place in (first, second)]
    return heads, [line.split() for line in lines[first + 1 : second - 2]]


def test_text_fits_a_terminal(page):
    shown = text(page)
    assert max(map(len, shown.splitlines())) <= 80
    assert "A  runs/a0  hierarchical, seed 0\n" in shown
    assert "300 test episodes each in lanewise, starts of seed 5.\n" in shown
    assert "arm 1: A B\narm 2: C D\n" in shown
    assert 'scenario.lanes: 3 (A B), 4 (C D)\ngoals.reference: "a" (A B), "b" (C D)\n' in shown
    assert "[" not in shown
    other = ComparisonPage(page.comparison, {}, 5, scenario_of="runs/b0")
    assert "Settings that differ\nnone\n" in text(other)
    assert "starts of seed 5, scenario of runs/b0." in text(other)
    assert to_json(other)["scenario_of"] == "runs/b0"


def test_runs_stand_with_their_intervals_shares_before_means(page):
    heads, rows = blocks(page, "Runs")
    assert heads == [
        ["success", "(paper)", "success", "accidents"],
        ["reward", "speed", "distance"],
    ]
    assert rows[0] == ["A", "97.67", "97.67", "2.33"]
    assert rows[1][:2] == ["(95.3,", "99.1)"]
    assert [row[0] for row in rows[::2]] == ["A", "B", "C", "D"]


def test_differences_stand_with_discordant_pairs_and_p(page):
    _, rows = blocks(page, "Minus A, start by start")
    assert rows[0] == ["B", "+2.33", "+2.33", "-2.33"]
    assert rows[1] == ["+7", "-0", "+7", "-0", "+0", "-7"]
    assert rows[2] == ["p", "0.016"] * 3
    assert rows[5] == ["p", "<0.001"] * 3


def test_arms_and_chances(page):
    _, means = blocks(page, "Interquartile mean over the seeds of an arm")
    assert means[0] == ["1", "98.83", "98.83", "1.17"]
    assert means[1][:2] == ["(97.7,", "100.0)"]
    _, chances = blocks(page, "P(better than arm 1)")
    assert chances[0] == ["2", "0.00", "0.00", "0.00"]
    single = text(make_page(RUNS[1:3], EPISODES[1:3]))
    assert "arm " not in single
    assert "Interquartile" not in single
    assert "P(better" not in single


def test_json_is_json_and_names_every_run(page):
    stored = json.loads(json.dumps(to_json(page), allow_nan=False))
    assert [run["run"] for run in stored["runs"]] == [run.name for run in RUNS]
    assert stored["runs"][0]["success_rate"] == pytest.approx(293 / 300)
    assert stored["settings"]["scenario.lanes"] == [3, 3, 4, 4]
    assert [found["run"] for found in stored["differences"]] == [1, 2, 3]
    assert stored["differences"][0]["success_rate"]["only_this"] == 7
    assert stored["arms"][0]["values"]["success_rate"] == pytest.approx([293 / 300, 1.0])
    assert stored["arms"][0]["interquartile_mean"]["success_rate"]["interval"] is not None
    # Both seeds of the one lie below both of the other: no spread, hence no interval.
    chance = stored["improvements"][0]["probability"]["success_rate"]
    assert chance == {"value": 0.0, "interval": None}


def test_csv_has_one_row_a_run_and_metric(page):
    table = list(csv.DictReader(io.StringIO(to_csv(page))))
    assert len(table) == 4 * 9
    first = table[0]
    assert (first["run"], first["arm"], first["metric"]) == ("runs/a0", "0", "escape_rate")
    assert float(first["value"]) == 293 / 300
    assert float(first["low"]) == pytest.approx(0.9525, abs=1e-4)
    wanted = ("runs/b0", "escape_time")
    unknown = next(row for row in table if (row["run"], row["metric"]) == wanted)
    assert unknown["value"] == unknown["low"] == ""


def test_hostile_names_do_no_harm():
    name = "a|b`\x1b[31m\n# c,d"
    page = make_page([Entry(name, "hierarchical", 9, "z"), *RUNS[1:]])
    assert text(page).startswith("A  a|b`\\x1b[31m\\n# c,d  hierarchical")
    assert "\x1b" not in text(page)
    assert "\n# c" not in markdown(page)
    assert next(csv.DictReader(io.StringIO(to_csv(page))))["run"] == name
