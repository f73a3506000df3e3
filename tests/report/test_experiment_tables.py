"""Tables of an experiment, read back cell by cell."""

import dataclasses

import numpy as np
import pytest

from lanewise.evaluation.episodes import Episodes
from lanewise.evaluation.metrics import summarise
from lanewise.report import experiment_tables as tables
from lanewise.report.experiment_tables import ArmFigures
from lanewise.report.tables import LEFT_OUT


def summary(controller, success, crashed_later=0, count=100, reward=1.0):
    zero, number = np.zeros(count), np.arange(count)
    escaped = number < success + crashed_later
    episodes = Episodes(
        success=number < success,
        accident=(escaped & (number >= success)).astype(np.int8),
        accumulated_reward=zero + reward,
        average_speed=zero + 13.0,
        travel_distance=zero + 325.0,
        duration=zero + 25.0,
        escape_time=np.where(escaped, 9.0, np.nan),
        goals=zero.astype(int),
        goals_timed_out=zero.astype(int),
    )
    return summarise(episodes, controller=controller, world="lanewise")


def arm(title, controller, successes, **more):
    tests = {"lanewise": [summary(controller, s, reward=s / 10) for s in successes]}
    likely = {"unlike_paper": "", "unlike_papers_training": ""}
    return ArmFigures(title, controller, range(len(successes)), tests, **likely | more)


OURS = arm("two levels", "hierarchical", [98, 99, 100, 100, 90])
FLAT = arm("flat | one", "single-level", [0, 0, 1, 0, 0])


def cells(markdown):
    """Rows of a Markdown table as lists of cells."""
    lines = markdown.replace(r"\|", "¦").strip().splitlines()
    return [
        [cell.strip() for cell in line.strip("|").split("|")] for line in lines if "---" not in line
    ]


def test_the_test_table_has_means_extremes_and_the_published_row_once():
    again = arm("more", "hierarchical", [50])
    rows = cells(tables.tests([OURS, FLAT, again], "lanewise"))
    assert [row[0] for row in rows] == [
        *("arm", "*hierarchical, published*", "two levels"),
        *("*single-level, published*", "flat ¦ one", "more"),
    ]
    papers, column = rows[0].index("success (paper), %"), rows[0].index("success, %")
    assert papers + 1 == column
    assert [rows[1][papers], rows[1][column]] == ["97.67", "-"]
    assert rows[2][papers] == rows[2][column] == "97.40 (90.00 to 100.00)"
    assert rows[5][column] == "50.00"
    assert "two levels" not in tables.tests([OURS], "highway-env")
    assert "two levels" not in tables.text([OURS], "highway-env")
    assert [row[1] for row in rows[1:]] == ["-", "5", "-", "5", "1"]
    assert len({len(row) for row in rows}) == 1


@pytest.mark.parametrize("make", [tables.tests, tables.text])
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
    rows = cells(tables.every_seed([OURS], ["lanewise", "highway-env"]))
    assert [row[1] for row in rows[1:]] == ["0", "1", "2", "3", "4"]
    # Clopper and Pearson for 98 of 100, by scipy's binomtest.
    assert rows[1][rows[0].index("success, %")] == "98.00 (93.0, 99.8)"


def test_over_seeds_by_hand():
    """Of 90, 98, 99, 100, 100 the middle three have the mean 99; every one beats every flat one."""
    rows = cells(tables.over_seeds([OURS, FLAT], "flat | one"))
    assert [head.split(" of ")[-1] for head in rows[0][1:6:2]] == [
        *("success (paper), %", "success, %", "reward, 1 a second")
    ]
    for column in (1, 3):
        assert rows[1][column].startswith("99.00 (")
        assert rows[1][column + 1] == "1.00"
        assert rows[2][column + 1] == "-"
    for nobody in ("nobody", None):
        alone = cells(tables.over_seeds([OURS], nobody))
        assert [head.startswith("IQM") for head in alone[0][1:]] == [True, True, True]


def test_the_training_table_takes_the_last_fifty_episodes():
    def lines(late):
        rewards = [100.0] * 30 + [late] * 50
        same = {"speed": 10.0, "escaped": True}
        return [{"reward": r, "timestep_reward": r / 2, "success": r > 3, **same} for r in rewards]

    trained = arm("two levels", "hierarchical", [1, 2], training=[lines(2.0), lines(4.0)])
    rows = cells(tables.training([trained, FLAT]))
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
    trained = dataclasses.replace(OURS, effort=took)
    rows = cells(tables.effort([trained, FLAT]))
    assert rows[1][2:7] == ["1,000", "12", "125", "0.125", "1.2"]
    # A reference driver was never trained.
    assert rows[2][2:7] == ["-"] * 5
    assert rows[1][-1] == "100"
