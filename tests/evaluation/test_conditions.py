"""Conditions as data."""

import itertools
from dataclasses import replace

from lanewise import config
from lanewise.config.settings import Settings
from lanewise.evaluation import conditions
from lanewise.evaluation.conditions import ConditionGrid
from lanewise.scenario.populations import POPULATIONS
from lanewise.scenario.settings import TrapSettings
from lanewise.world.settings import PAPER_DRIVER

GRID = ConditionGrid()


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
