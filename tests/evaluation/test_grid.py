from lanewise.evaluation import grid as grids
from lanewise.evaluation.grid import Grid, Point


def test_points_are_every_combination_traffic_fastest():
    grid = Grid(ego_speed=(8.0, 9.0), spacing=(17.0, 25.0), vehicles_behind=(0, 1, 2))
    points = grid.places()
    assert len(points) == 2 * 4 * 3 * 4 * 4 * 6 == len(set(points))
    # Starts that differ in their traffic alone stand side by side.
    assert [p.approach for p in points[::6]] == [p.approach for p in points[5::6]]
    assert grid.searched() == points[::6]
    assert points[0] == Point(8.0, 8.0, 3, 14.3, 3.5, 17.0, 0)


def test_axes_and_points_and_settings_name_the_same_things():
    assert tuple(vars(Grid())) == Point._fields == tuple(grids.SETTINGS)
