"""Conditions as data, and how their episodes are counted at each horizon."""

import itertools
import math
from dataclasses import replace

import numpy as np
import pytest

from lanewise import config
from lanewise.config.settings import Settings
from lanewise.errors import SettingsError
from lanewise.evaluation import conditions
from lanewise.evaluation.conditions import (
    HORIZONS,
    KINDS,
    Condition,
    ConditionCell,
    ConditionGrid,
    pooled,
)
from lanewise.evaluation.episodes import Episodes
from lanewise.scenario.populations import POPULATIONS
from lanewise.scenario.settings import TrapSettings
from lanewise.world.settings import PAPER_DRIVER

GRID = ConditionGrid()


def made_up(count=2000, seed=0):
    """Episodes of 120 s of which half have an accident at some time, escaped from or not."""
    rng = np.random.default_rng(seed)
    kind = rng.integers(1, len(KINDS) + 1, count) * (rng.random(count) < 0.5)
    duration = np.where(kind > 0, rng.integers(1, 241, count) / 2, 120.0)
    escape = rng.integers(1, 241, count) / 2
    zeros = np.zeros(count)
    return Episodes(
        success=(escape <= duration) & (kind == 0),
        accident=np.minimum(kind, 1).astype(np.int8),
        accident_kind=kind.astype(np.int8),
        accumulated_reward=zeros,
        average_speed=zeros,
        travel_distance=zeros,
        duration=duration,
        escape_time=np.where(escape <= duration, escape, np.nan),
        goals=zeros.astype(int),
        goals_timed_out=zeros.astype(int),
    )


def test_counts_at_a_horizon_are_those_of_a_plain_loop():
    episodes = made_up()
    # Times that occur: what happens exactly then has happened by then.
    limits = (25.0, 60.0, 119.5)
    assert {25.0, 60.0} <= set(episodes.duration)
    assert 25.0 in episodes.escape_time
    found = conditions.outcome(episodes, limits)
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
    at = conditions.outcome(episodes, [120.0]).at(0)
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
    found = conditions.outcome(episodes, [25.0, 60.0])
    assert found.escapes == [1, 1]
    assert found.successes == [1, 0]
    assert found.first_accident == [-1, 0]


def test_groups_hold_every_cell_once_and_differ_in_speeds_and_lanes_alone():
    groups = GRID.groups()
    cells = [cell for group in groups for cell in group]
    # Without traffic there is no population to choose.
    assert len(cells) == (len(POPULATIONS) * 3 + 1) * 4 * 3 * 2 * 2 == len(set(cells))
    for group in groups:
        assert len({(c.population, c.density, c.noise, c.latency) for c in group}) == 1
        assert (group[0].density == "empty") == (group[0].population == "nobody")
    programs = [(group[0].noise, group[0].latency) for group in groups]
    changes = [pair for before, pair in itertools.pairwise(programs) if pair != before]
    assert len(changes) == 3


def test_every_condition_is_one_that_a_run_may_be_tested_in():
    for condition in {cell for group in GRID.groups() for cell in (group[0], group[-1])}:
        settings = config.replace(Settings(), condition.settings)
        traffic = settings.scenario.traffic
        crowd = conditions.DENSITIES[condition.density]
        assert (traffic.vehicles_ahead, traffic.vehicles_behind, traffic.spacing) == crowd
        assert traffic.populations in ((), (condition.population,))
        assert settings.scenario.lanes == condition.lanes
        assert settings.driving.latency == condition.latency


def test_a_value_given_twice_is_refused():
    conditions.check(GRID)
    with pytest.raises(SettingsError, match=r"--noise: 0\.0 is given twice"):
        conditions.check(ConditionGrid(noise=(0.0, 0.05, 0.0)))
    with pytest.raises(SettingsError, match="--ego-speed and --trap-speed"):
        conditions.check(ConditionGrid(speeds=((10.0, 8.0), (10.0, 8.0))))


def test_populations_seen_in_training():
    own = TrapSettings()
    assert conditions.seen_in_training(own) == ("paper",)
    tested = replace(own, traffic=replace(own.traffic, populations=("timid",)))
    assert conditions.seen_in_training(tested) == ("timid",)
    trained = replace(tested, training_populations=("highd", "paper"))
    assert conditions.seen_in_training(trained) == ("highd", "paper")
    other = replace(PAPER_DRIVER, politeness=0.7)
    strange = replace(own, traffic=replace(own.traffic, driver=other))
    assert conditions.seen_in_training(strange) == ()


def test_only_starts_with_a_third_lane_may_be_winnable():
    places = ConditionGrid(speeds=((10.0, 8.0),), lanes=(2, 3, 5)).searched()
    assert [place.approach for place in places] == [(10.0, 8.0, 3), (10.0, 8.0, 5)]


def test_pooled_cells_add_up_and_those_that_cannot_be_won_count_for_accidents_alone():
    condition = Condition("paper", "light", 10.0, 8.0, 3, 0.0, 0.0)
    parts = [conditions.outcome(made_up(100, seed), HORIZONS) for seed in range(3)]
    cells = [ConditionCell(condition, n != 1, part) for n, part in enumerate(parts)]
    for horizon in range(len(HORIZONS)):
        everything, won = pooled(cells, horizon), pooled(cells, horizon, winnable=True)
        assert (everything.cells, everything.episodes, won.cells) == (3, 300, 2)
        assert everything.accidents == sum(part.at(horizon).accidents for part in parts)
        assert won.successes == parts[0].successes[horizon] + parts[2].successes[horizon]
    assert math.isnan(pooled([], 0).rate("accidents"))
    assert pooled([], 0).interval("accidents") is None
