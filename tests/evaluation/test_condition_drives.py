"""A grid of conditions, driven in worlds of one size: the same episodes as one test for each."""

from dataclasses import replace

import jax
import numpy as np
import pytest

from lanewise import config
from lanewise.config.settings import Settings
from lanewise.evaluation import cells as grid_cells
from lanewise.evaluation import condition_drives, conditions, evaluator, sweep
from lanewise.evaluation.conditions import HORIZONS, ConditionGrid, Density
from lanewise.training import recipe

SMALL = ConditionGrid(
    population=("stop-and-go", "highd"),
    density=("empty", "light"),
    speeds=((12.0, 10.0), (10.0, 8.0)),
    lanes=(2, 3),
    noise=(0.05,),
    latency=(0.2,),
)


@pytest.fixture(autouse=True)
def few(monkeypatch):
    """Few episodes at once, little traffic."""
    monkeypatch.setattr(evaluator, "BLOCK", 4)
    monkeypatch.setitem(conditions.DENSITIES, "light", Density(2, 1, 40.0))


def test_of(condition):
    """The test of a driver without networks."""
    values = condition.settings | {"evaluation.duration": HORIZONS[-1]}
    test = recipe.evaluation_config(config.replace(Settings(), values), "rule-based")
    return replace(test, at_once=evaluator.BLOCK)


test_of.__test__ = False


def test_every_cell_begins_with_the_starts_of_its_own_test(monkeypatch):
    driven = []

    def keep(test, parameters, count, worlds):
        driven.append(worlds(np.arange(count)))
        raise StopIteration

    monkeypatch.setattr(sweep, "drive", keep)
    grid = replace(SMALL, population=("highd", "stop-and-go"), density=("light",))
    group = grid.groups()[0]
    room = condition_drives.room_of(test_of, replace(grid, density=("light", "dense")))
    with pytest.raises(StopIteration):
        condition_drives._drive(test_of(group[0]), {}, 7, 3, group, room)
    (worlds,) = driven
    assert worlds.vehicles.x.shape == (12, 3 + 16)
    np.testing.assert_array_equal(worlds.drivers.waves.amplitude, 0.0)
    # The last of four has as many lanes as there is room for, so that roads are alike too.
    own = evaluator.start_block(test_of(group[3]), 7, 0)
    cell = jax.tree.map(lambda leaf: leaf[9:12, :6], worlds)
    waveless = replace(cell, drivers=replace(cell.drivers, waves=None))
    jax.tree.map(
        lambda ours, theirs: np.testing.assert_array_equal(ours, theirs[:3]), waveless, own
    )
    assert not worlds.vehicles.present[:, 6:].any()


@pytest.mark.slow
def test_a_cell_counts_what_a_test_of_its_own_counts():
    cells = [cell for group in SMALL.groups() for cell in group]
    found = [o for part in condition_drives.run(test_of, {}, 3, 6, SMALL) for o in part]
    assert len(found) == len(cells) == 12
    for place in (0, 5, 11):
        episodes = evaluator.evaluate(test_of(cells[place]), {}, 3, 6)
        assert found[place] == grid_cells.outcome(episodes, HORIZONS)
    rest = [o for part in condition_drives.run(test_of, {}, 3, 6, SMALL, done=6) for o in part]
    assert rest == found[6:]
