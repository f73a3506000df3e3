"""Cells of both grids: what is counted of their episodes, and how they are pooled."""

import math
from dataclasses import replace

import numpy as np
import pytest

from fabricate import make_episodes
from lanewise.errors import SettingsError
from lanewise.evaluation.cells import (
    DENOMINATORS,
    KINDS,
    Cell,
    CellOutcome,
    Reach,
    cells_of,
    check_axes,
    outcome,
    pool,
)
from lanewise.evaluation.conditions import HORIZONS, Condition, ConditionGrid
from lanewise.evaluation.grid import Grid, Point


def made_up(count=2000, seed=0):
    """Episodes of 120 s of which half have an accident at some time, escaped from or not."""
    rng = np.random.default_rng(seed)
    kind = rng.integers(1, len(KINDS) + 1, count) * (rng.random(count) < 0.5)
    duration = np.where(kind > 0, rng.integers(1, 241, count) / 2, 120.0)
    escape = rng.integers(1, 241, count) / 2
    return replace(
        make_episodes(0, count, seed),
        success=(escape <= duration) & (kind == 0),
        accident=np.minimum(kind, 1).astype(np.int8),
        accident_kind=kind.astype(np.int8),
        duration=duration,
        escape_time=np.where(escape <= duration, escape, np.nan),
    )


def test_counts_at_a_horizon_are_those_of_a_plain_loop():
    episodes = made_up()
    # Times that occur: what happens exactly then has happened by then.
    limits = (25.0, 60.0, 119.5)
    assert {25.0, 60.0} <= set(episodes.duration)
    assert 25.0 in episodes.escape_time
    found = outcome(episodes, limits)
    for place, limit in enumerate(limits):
        escapes, successes, first = 0, 0, -1
        kinds = dict.fromkeys(range(1, len(KINDS) + 1), 0)
        for number in range(len(episodes)):
            escaped = crashed = False
            for decision in range(1, round(2 * limit) + 1):
                escaped = escaped or episodes.escape_time[number] == decision / 2
                over = episodes.duration[number] == decision / 2
                crashed = crashed or (over and episodes.accident[number] > 0)
            escapes, successes = escapes + escaped, successes + (escaped and not crashed)
            if crashed:
                kinds[int(episodes.accident_kind[number])] += 1
                first = number if first < 0 else first
        assert found.escapes[place] == escapes
        assert found.successes[place] == successes
        assert found.kinds[place] == list(kinds.values())
        assert found.first_accident[place] == first


def test_at_the_end_the_counts_are_those_of_a_test_as_long():
    episodes = made_up()
    at = outcome(episodes, [120.0]).at(0)
    assert at.escapes == episodes.escaped.sum()
    assert at.successes == episodes.success.sum()
    assert at.accidents == (episodes.accident > 0).sum()


def test_an_accident_after_the_horizon_costs_no_success_before():
    episodes = made_up().some(slice(2))
    episodes = replace(
        episodes,
        accident=np.array([1, 0], np.int8),
        accident_kind=np.array([1, 0], np.int8),
        duration=np.array([30.0, 120.0]),
        escape_time=np.array([20.0, np.nan]),
    )
    # What happens exactly then has happened by then.
    found = outcome(episodes, [10.0, 20.0, 25.0, 30.0, 60.0])
    assert found.escapes == [0, 1, 1, 1, 1]
    assert found.successes == [0, 1, 1, 0, 0]
    assert found.first_accident == [-1, -1, -1, 0, 0]
    assert [kinds[0] for kinds in found.kinds] == [0, 0, 0, 1, 1]
    assert [sum(kinds) for kinds in found.kinds] == [0, 0, 0, 1, 1]


def cell(winnable=True, clear=True, successes=8, kinds=(1, 0), escapes=9):
    return Cell(
        Point(10.0, 10.0, 3, 15.0, 5.0, 25.0, 0),
        Reach(winnable, True, clear, "", 0),
        CellOutcome(
            *(10, 12.0, 9.0, [escapes], [successes]),
            [[kinds[0], *[0] * (len(KINDS) - 2), kinds[1]]],
            [-1],
        ),
    )


def test_denominators_count_the_starts_they_name():
    cells = [
        cell(),
        cell(winnable=False, clear=False, successes=0, kinds=(10, 0), escapes=0),
        cell(clear=False, successes=2, kinds=(3, 1), escapes=3),
    ]
    everything, winnable, clear = (pool(cells, 0, name) for name in DENOMINATORS)
    assert (everything.cells, everything.episodes, everything.successes) == (3, 30, 10)
    assert everything.rate("successes") == pytest.approx(1 / 3)
    assert (everything.escapes, everything.rate("escapes")) == (12, 0.4)
    assert (everything.kinds[0], everything.kinds[-1], everything.accidents) == (14, 1, 15)
    assert everything.rate("accidents") == pytest.approx(0.5)
    assert (winnable.cells, winnable.rate("successes")) == (2, 0.5)
    assert (clear.cells, clear.rate("successes"), clear.rate("accidents")) == (1, 0.8, 0.1)
    low, high = clear.to_json()["successes_interval"]
    # Clopper and Pearson's for 8 of 10, from tables.
    assert (low, high) == (pytest.approx(0.4439, abs=1e-4), pytest.approx(0.9748, abs=1e-4))


def test_nothing_has_no_rate():
    counts = pool([cell(winnable=False)], 0, "winnable")
    assert counts.cells == counts.episodes == 0
    assert math.isnan(counts.rate("successes"))
    assert counts.to_json()["successes_interval"] is None


def test_pooled_cells_add_up_and_those_that_cannot_be_won_count_for_accidents_alone():
    condition = Condition("paper", "light", 10.0, 8.0, 3, 0.0, 0.0)
    parts = [outcome(made_up(100, seed), HORIZONS) for seed in range(3)]
    won = Reach(True, True, True, "4", 0)
    cells = [Cell(condition, None if n == 1 else won, part) for n, part in enumerate(parts)]
    for horizon in range(len(HORIZONS)):
        everything, winnable = pool(cells, horizon), pool(cells, horizon, "winnable")
        assert (everything.cells, everything.episodes, winnable.cells) == (3, 300, 2)
        assert everything.accidents == sum(part.at(horizon).accidents for part in parts)
        assert winnable.successes == parts[0].successes[horizon] + parts[2].successes[horizon]


def test_cells_of_an_approach_share_what_was_found_of_it():
    grid = ConditionGrid(("paper",), ("light",), lanes=(2, 3), noise=(0.0, 0.05), latency=(0.0,))
    reached = [Reach(n > 0, True, False, "", n) for n in range(4)]
    found = cells_of(grid, reached, [outcome(made_up(2), HORIZONS)] * 16)
    assert [each.place for each in found] == grid.places()
    for each in found:
        if each.place.lanes == 2:
            assert (each.reach, each.winnable) == (None, False)
        else:
            speeds = (each.place.ego_speed, each.place.trap_speed)
            assert each.reach.states == grid.speeds.index(speeds)
            assert each.winnable == (each.reach.states > 0)


def test_a_value_given_twice_is_refused():
    check_axes(vars(Grid()))
    check_axes(vars(ConditionGrid()))
    for grid, words in (
        (Grid(trap_speed=(9.0, 8.0, 9.0)), r"--trap-speed: 9\.0 is given twice"),
        (ConditionGrid(noise=(0.0, 0.05, 0.0)), r"--noise: 0\.0 is given twice"),
        (ConditionGrid(speeds=((10.0, 8.0), (10.0, 8.0))), "--ego-speed and --trap-speed"),
    ):
        with pytest.raises(SettingsError, match=words):
            check_axes(vars(grid))
