"""Tables of tests, experiments and comparisons, read back cell by cell."""

import csv
import dataclasses
import io
import json
import math

import pytest

from fabricate import FLAT, OURS, make_arm, make_episodes
from lanewise.evaluation.comparison import Entry, compare
from lanewise.evaluation.metrics import summarise
from lanewise.report import comparison_page, evaluation_table, experiment_tables
from lanewise.report.comparison_page import ComparisonPage
from lanewise.report.tables import LEFT_OUT

# Tests of controllers.


def make_test(controller, world="lanewise", unlike_paper=""):
    return summarise(make_episodes(), controller=controller, world=world, unlike_paper=unlike_paper)


SUMMARIES = [
    make_test(controller, world)
    for controller in ("hierarchical", "single-level")
    for world in ("lanewise", "highway-env")
]


@pytest.mark.parametrize("make", [evaluation_table.text, evaluation_table.markdown])
def test_published_stands_only_beside_the_papers_own_test(make):
    why = "scenario.lanes is 4, not 3"
    own, other = make_test("hierarchical"), make_test("hierarchical", unlike_paper=why)
    assert "331.6" in make([own])
    assert LEFT_OUT not in make([own])
    for summaries in ([other], [own, other]):
        assert "331.6" not in make(summaries)
        assert f"{LEFT_OUT}\n- hierarchical: {why}\n" in make(summaries)
    # Whoever has not looked claims nothing.
    assert "331.6" not in make([make_test("hierarchical", unlike_paper=None)])
    # A controller without published figures misses none.
    assert LEFT_OUT not in make([make_test("mine", unlike_paper=why)])


def test_a_test_is_a_rectangle_that_fits_a_terminal():
    rows = [line for line in evaluation_table.markdown(SUMMARIES).splitlines() if line[:1] == "|"]
    assert len({row.count("|") for row in rows}) == 1
    assert "| success (paper), % | 0.00 (0.0, 1.2) | 97.67 (95.3, 99.1) |" in rows[3]
    assert any(row.startswith("| success, % | - | 97.67 (95.3, 99.1) |") for row in rows)
    shown = evaluation_table.text(SUMMARIES)
    assert max(map(len, shown.splitlines())) <= 80
    for word, stands in (("331.6", True), ("off road", True), ("[", False)):
        assert (word in shown) is stands
    # Unknown values are dashes.
    unknown, known = make_test("mine"), make_test("mine", "highway-env")
    unknown.values["escape_time"] = math.nan
    lines = evaluation_table.text([unknown, known]).splitlines()
    assert next(line for line in lines if line.startswith("escape")).split()[3] == "-"


# Experiments.


def cells(markdown):
    """Rows of a Markdown table as lists of cells."""
    lines = markdown.replace(r"\|", "¦").strip().splitlines()
    return [
        [cell.strip() for cell in line.strip("|").split("|")] for line in lines if "---" not in line
    ]


def test_the_test_table_has_means_extremes_and_the_published_row_once():
    more = make_arm("more", "hierarchical", [50])
    rows = cells(experiment_tables.tests([OURS, FLAT, more], "lanewise"))
    assert [row[0] for row in rows] == [
        *("arm", "*hierarchical, published*", "two levels"),
        *("*single-level, published*", "flat ¦ one", "more"),
    ]
    papers, column = rows[0].index("success (paper), %"), rows[0].index("success, %")
    assert papers + 1 == column
    assert [rows[1][papers], rows[1][column]] == ["97.67", "-"]
    assert rows[2][papers] == rows[2][column] == "97.40 (90.00 to 100.00)"
    assert rows[5][column] == "50.00"
    for make in (experiment_tables.tests, experiment_tables.text):
        assert "two levels" not in make([OURS], "highway-env")
    assert [row[1] for row in rows[1:]] == ["-", "5", "-", "5", "1"]
    assert len({len(row) for row in rows}) == 1


@pytest.mark.parametrize("make", [experiment_tables.tests, experiment_tables.text])
def test_published_rows_stand_only_above_the_papers_own_tests(make):
    four = dataclasses.replace(OURS, title="four lanes", unlike_paper="scenario.lanes is 4, not 3")
    more = dataclasses.replace(four, title="and more")
    found = make([four, FLAT, OURS, more], "lanewise")
    rows = [row for row in found.splitlines() if "97.67" in row or "97.40" in row]
    assert [("published" in row, "four" in row, "two" in row) for row in rows[:3]] == [
        *((False, True, False), (True, False, False), (False, False, True))
    ]
    assert found.endswith(f"{LEFT_OUT}\n- four lanes, and more: scenario.lanes is 4, not 3\n")
    assert "hierarchical, published" not in make([four], "lanewise")
    unknown = dataclasses.replace(OURS, unlike_paper=None)
    assert "published" not in make([unknown], "lanewise")


def test_every_seed_has_its_exact_interval():
    rows = cells(experiment_tables.every_seed([OURS], ["lanewise", "highway-env"]))
    assert [row[1] for row in rows[1:]] == ["0", "1", "2", "3", "4"]
    # Clopper and Pearson for 98 of 100, by scipy's binomtest.
    assert rows[1][rows[0].index("success, %")] == "98.00 (93.0, 99.8)"


def test_over_seeds_by_hand():
    """Of 90, 98, 99, 100, 100 the middle three have the mean 99; every one beats every flat one."""
    rows = cells(experiment_tables.over_seeds([OURS, FLAT], "flat | one"))
    assert [head.split(" of ")[-1] for head in rows[0][1:6:2]] == [
        *("success (paper), %", "success, %", "reward, 1 a second")
    ]
    for column in (1, 3):
        assert rows[1][column].startswith("99.00 (")
        assert rows[1][column + 1] == "1.00"
        assert rows[2][column + 1] == "-"
    for nobody in ("nobody", None):
        alone = cells(experiment_tables.over_seeds([OURS], nobody))
        assert [head.startswith("IQM") for head in alone[0][1:]] == [True, True, True]


def test_the_training_table_takes_the_last_fifty_episodes():
    def lines(late):
        rewards = [100.0] * 30 + [late] * 50
        same = {"speed": 10.0, "escaped": True}
        return [{"reward": r, "timestep_reward": r / 2, "success": r > 3, **same} for r in rewards]

    trained = dataclasses.replace(OURS, training=[lines(2.0), lines(4.0)])
    rows = cells(experiment_tables.training([trained, FLAT]))
    assert rows[0][-2:] == ["success (paper), %", "success, %"]
    assert rows[1] == ["*hierarchical, published*", "5", "47.94", "-", "13.09", "60.0", "-"]
    assert rows[2][2:] == [
        *("3.00 (2.00 to 4.00)", "1.50 (1.00 to 2.00)", "10.00 (10.00 to 10.00)"),
        *("100.0 (100.0 to 100.0)", "50.0 (0.0 to 100.0)"),
    ]
    # A reference driver was never trained.
    assert len(rows) == 3


def test_what_was_run_is_said_arm_by_arm():
    took = [
        {"decisions": 1000, "episodes": 10, "updates": 120, "seconds": 60.0},
        {"decisions": 1000, "episodes": 14, "updates": 130, "seconds": 90.0},
    ]
    _, ours, flat = cells(experiment_tables.effort([dataclasses.replace(OURS, effort=took), FLAT]))
    assert ours[2:] == ["1,000", "12", "125", "0.125", "1.2", "100"]
    # A reference driver was never trained.
    assert flat[2:7] == ["-"] * 5


# Comparisons of runs.

RUNS = [
    Entry(f"runs/{name}{seed}", controller, seed, "x")
    for name, controller in (("a", "hierarchical"), ("b", "single-level"))
    for seed in (0, 1)
]
EPISODES = [make_episodes(successes) for successes in (293, 300, 0, 3)]
SETTINGS = {"scenario.lanes": (3, 3, 4, 4), "goals.reference": ("a", "a", "b", "b")}


@pytest.fixture(scope="module")
def page():
    return ComparisonPage(compare(RUNS, EPISODES, "lanewise"), SETTINGS, 5)


def blocks(page, title):
    """The two tables below a title of the text, shares and means: (heads, rows) as words."""
    lines = comparison_page.text(page).split(f"\n\n{title}\n")[1].split("\n\n")[0].splitlines()
    first, second = (place for place, line in enumerate(lines) if line.startswith("---"))
    heads = [lines[place - 2].split() for place in (first, second)]
    return heads, [line.split() for line in lines[first + 1 : second - 2]]


def test_a_comparison_as_text_fits_a_terminal(page):
    shown = comparison_page.text(page)
    assert max(map(len, shown.splitlines())) <= 80
    assert "A  runs/a0  hierarchical, seed 0\n" in shown
    assert "300 test episodes each in lanewise, starts of seed 5.\n" in shown
    assert "arm 1: A B\narm 2: C D\n" in shown
    assert 'scenario.lanes: 3 (A B), 4 (C D)\ngoals.reference: "a" (A B), "b" (C D)\n' in shown
    assert "[" not in shown
    other = ComparisonPage(page.comparison, {}, 5, scenario_of="runs/b0")
    assert "Settings of the runs that differ\nnone\n" in comparison_page.text(other)
    assert "starts of seed 5, scenario of runs/b0." in comparison_page.text(other)
    assert comparison_page.to_json(other)["scenario_of"] == "runs/b0"


def test_blocks_of_a_comparison(page):
    heads, runs = blocks(page, "Runs")
    assert heads == [
        ["success", "(paper)", "success", "accidents"],
        ["reward", "speed", "distance"],
    ]
    assert runs[0] == ["A", "97.67", "97.67", "2.33"]
    assert runs[1][:2] == ["(95.3,", "99.1)"]
    assert [row[0] for row in runs[::2]] == ["A", "B", "C", "D"]
    _, differences = blocks(page, "Minus A, start by start")
    assert differences[0] == ["B", "+2.33", "+2.33", "-2.33"]
    assert " ".join(differences[1]) == "(+7 -0, p 0.016) (+7 -0, p 0.016) (+0 -7, p 0.016)"
    assert differences[3][2:4] == ["p", "<0.001)"]
    _, means = blocks(page, "Interquartile mean over the seeds of an arm")
    assert means[0] == ["1", "98.83", "98.83", "1.17"]
    assert means[1][:2] == ["(97.7,", "100.0)"]
    _, chances = blocks(page, "P(better than arm 1)")
    assert chances[0] == ["2", "0.00", "0.00", "0.00"]
    single = ComparisonPage(compare(RUNS[1:3], EPISODES[1:3], "lanewise"), SETTINGS, 5)
    for word in ("arm ", "Interquartile", "P(better"):
        assert word not in comparison_page.text(single)


def test_a_comparison_as_json_names_every_run(page):
    stored = json.loads(json.dumps(comparison_page.to_json(page), allow_nan=False))
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


def test_a_comparison_as_csv_has_one_row_a_run_and_metric(page):
    table = list(csv.DictReader(io.StringIO(comparison_page.to_csv(page))))
    assert len(table) == 4 * 9
    first = table[0]
    assert (first["run"], first["arm"], first["metric"]) == ("runs/a0", "0", "escape_rate")
    assert float(first["value"]) == 293 / 300
    assert float(first["low"]) == pytest.approx(0.9525, abs=1e-4)
    wanted = ("runs/b0", "escape_time")
    unknown = next(row for row in table if (row["run"], row["metric"]) == wanted)
    assert unknown["value"] == unknown["low"] == ""


def test_hostile_names_of_runs_do_no_harm(page):
    name = "a|b`\x1b[31m\n# c,d"
    runs = (Entry(name, "hierarchical", 9, "z"), *RUNS[1:])
    page = ComparisonPage(dataclasses.replace(page.comparison, runs=runs), SETTINGS, 5)
    text = comparison_page.text(page)
    assert text.startswith("A  a|b`\\x1b[31m\\n# c,d  hierarchical")
    assert "\x1b" not in text
    assert "\n# c" not in comparison_page.markdown(page)
    assert next(csv.DictReader(io.StringIO(comparison_page.to_csv(page))))["run"] == name
