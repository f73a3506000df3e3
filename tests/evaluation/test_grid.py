import math

import pytest

from lanewise.errors import SettingsError
from lanewise.evaluation import grid as grids
from lanewise.evaluation.grid import Cell, Grid, Point, PointResult, Reach, pool


def cell(
    ego=10.0, lanes=3, winnable=True, clear=True, successes=8, collision=1, stopped=0, escapes=9
):
    return Cell(
        Point(ego, 10.0, lanes, 15.0, 5.0, 25.0, 0),
        Reach(winnable, True, clear, "", 0),
        PointResult(10, successes, collision, 0, stopped, 12.0, 9.0, escapes),
    )


def test_points_are_every_combination_traffic_fastest():
    grid = Grid(ego_speed=(8.0, 9.0), spacing=(17.0, 25.0), vehicles_behind=(0, 1, 2))
    points = grid.points()
    assert len(points) == 2 * 4 * 3 * 4 * 4 * 6 == len(set(points))
    assert grid.traffics == 6
    # Starts that differ in their traffic alone stand side by side.
    assert [point[:5] for point in points[::6]] == [point[:5] for point in points[5::6]]
    assert points[0] == Point(8.0, 8.0, 3, 14.3, 3.5, 17.0, 0)


def test_axes_and_points_and_settings_name_the_same_things():
    assert tuple(vars(Grid())) == Point._fields == tuple(grids.SETTINGS)


def test_a_value_given_twice_is_refused():
    grids.check(Grid())
    with pytest.raises(SettingsError, match=r"--trap-speed: 9\.0 is given twice"):
        grids.check(Grid(trap_speed=(9.0, 8.0, 9.0)))


def test_denominators_count_the_starts_they_name():
    cells = [
        cell(),
        cell(winnable=False, clear=False, successes=0, collision=10, escapes=0),
        cell(clear=False, successes=2, collision=3, stopped=1, escapes=3),
    ]
    everything, winnable, clear = (pool(cells, name) for name in grids.DENOMINATORS)
    assert (everything.starts, everything.episodes, everything.successes) == (3, 30, 10)
    assert everything.rate("success") == pytest.approx(1 / 3)
    assert (everything.escapes, everything.rate("escape")) == (12, 0.4)
    assert everything.accidents == {"collision": 14, "off_road": 0, "stopped": 1}
    assert everything.rate("accident") == pytest.approx(0.5)
    assert (winnable.starts, winnable.rate("success")) == (2, 0.5)
    assert (clear.starts, clear.rate("success"), clear.rate("accident")) == (1, 0.8, 0.1)
    low, high = clear.to_json()["success_interval"]
    # Clopper and Pearson's for 8 of 10, from tables.
    assert (low, high) == (pytest.approx(0.4439, abs=1e-4), pytest.approx(0.9748, abs=1e-4))


def test_nothing_has_no_rate():
    share = pool([cell(winnable=False)], "winnable")
    assert share.starts == share.episodes == 0
    assert math.isnan(share.rate("success"))
    assert share.to_json()["success_interval"] is None
