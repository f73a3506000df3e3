"""Test episodes compiled in blocks.

Nearly all share one shape of world and one static test, so that each program is compiled once.
"""

from dataclasses import replace

import jax
import numpy as np
import pytest

from lanewise import config
from lanewise.errors import NumbersError
from lanewise.evaluation import evaluator, metrics, sweep
from lanewise.evaluation.grid import SETTINGS as SETTING_OF
from lanewise.evaluation.grid import Grid
from lanewise.learning import network
from lanewise.training import recipe

pytestmark = pytest.mark.usefixtures("small_blocks")
FEW = {"scenario.traffic.vehicles_ahead": 2}
SETTINGS = config.compose(flags=FEW)
TEST = recipe.evaluation_config(SETTINGS, "single-level")
WEIGHTS = {"single_level": network.init(jax.random.key(36), 26, (8,), 9)}
COUNT = 6
"""More than a block."""
RTOL = {"accumulated_reward": 1e-4, "average_speed": 1e-4, "travel_distance": 1e-4}


def constant(action):
    """A network that always chooses one action."""
    zeros = jax.tree.map(np.zeros_like, jax.device_get(WEIGHTS["single_level"]))
    zeros[-1][1][action] = 1.0
    return {"single_level": zeros}


def placed(x, speed):
    """Starts in which the ego and the trap cars stand elsewhere, far from all traffic."""
    worlds = jax.device_get(evaluator.start_block(TEST, 0, 0))
    vehicles = worlds.vehicles
    places, speeds = vehicles.x + 1000.0, vehicles.speed.copy()
    places[:, :3], speeds[:, :3] = x, speed
    return replace(worlds, vehicles=replace(vehicles, x=places, speed=speeds))


def drive(action, worlds):
    found = evaluator.drive_block(evaluator.of_any_start(TEST), constant(action), worlds)
    return evaluator.as_episodes(TEST.driving, [found], 4)


def alike(found, expected):
    """The same outcomes, and sums that differ by rounding alone."""
    for name, values in vars(found).items():
        other, rtol = getattr(expected, name), RTOL.get(name, 0.0)
        np.testing.assert_allclose(values, other, rtol=rtol, atol=10 * rtol, err_msg=name)


def test_an_idle_ego_on_an_empty_road_in_closed_form():
    """Wherever it begins: the distance counts from there."""
    here = np.array([[0.0], [500.0], [-2000.0], [0.0]])
    found = drive(4, placed(here + np.array([0.0, 200.0, 60.0]), 10.0))
    reward = (1.5 * (2 / 75 * 10 - 2 / 15) + 0.05) / 1.6
    np.testing.assert_allclose(found.accumulated_reward, 25 * reward, rtol=1e-5)
    np.testing.assert_allclose(found.travel_distance, 250.0, rtol=1e-5)
    np.testing.assert_allclose(found.average_speed, 10.0)
    np.testing.assert_array_equal(found.duration, 25.0)
    assert np.isnan(found.escape_time).all()
    assert not (found.success | found.accident | found.goals).any()


def test_an_accident_adds_its_penalty_once_and_ends_the_sums():
    """Braking from 2.25 m/s at 1 m/s^2 the ego is below 0.1 m/s after five decisions."""
    found = drive(1, placed([0.0, 200.0, 150.0], [2.25, 0.5, 0.5]))
    assert found.accident.tolist() == [3] * 4
    assert found.duration.tolist() == [2.5] * 4
    # Rewards at 1 s and 2 s, each of a centred slow car, and the penalty at 2.5 s.
    assert found.accumulated_reward[0] == pytest.approx(2 * 0.05 / 1.6 - 10.0, rel=1e-4)
    assert found.average_speed[0] == pytest.approx(
        np.mean([1.75, 1.25, 0.75, 0.25, -0.25]), abs=1e-4
    )
    assert not found.success[0]


def test_a_drive_past_the_trap_that_then_stops_has_the_papers_success_and_not_ours():
    """Both trap cars start behind an ego that brakes to a stop."""
    found = drive(1, placed([0.0, -60.0, -50.0], [2.25, 0.5, 0.5]))
    assert (found.accident[0], found.escape_time[0]) == (3, 0.5)
    summary = metrics.summarise(found, controller="single-level", world="lanewise")
    assert (summary.values["escape_rate"], summary.values["success_rate"]) == (1.0, 0.0)


def test_episodes_do_not_depend_on_how_many_are_driven_with_them(ours):
    few = evaluator.evaluate(TEST, WEIGHTS, 0, COUNT - 1)
    assert len(few) == COUNT - 1
    for name in vars(few):
        np.testing.assert_array_equal(getattr(few, name), getattr(ours, name)[:-1])
    assert len(np.unique(ours.accumulated_reward)) > 1


def test_more_episodes_than_a_block_belong_to_one_start_of_a_grid():
    grid = Grid((8.0,), (8.0, 10.0), (3,), (15.0,), (5.0,))
    given = sweep.config(TEST, grid)
    found = [o for some in sweep.run(given, constant(7), 5, COUNT, grid.places()) for o in some]
    assert [outcome.episodes for outcome in found] == [COUNT, COUNT]
    assert [outcome.at(0).accidents for outcome in found] == [COUNT, COUNT]
    assert found[0].speed < found[1].speed


@pytest.mark.slow
def test_a_start_of_a_grid_is_the_test_start_with_those_settings():
    """Padded with lanes and vehicles it lacks, it comes to what its own settings give."""
    episodes = 3
    grid = Grid((9.5,), (8.5,), (3, 5), (15.0,), (6.0,), (20.0, 30.0), (0, 2))
    given, points, number = sweep.config(TEST, grid), grid.places(), 2

    def outcomes(first=0):
        groups = sweep.run(given, constant(7), 5, episodes, points, first)
        return [outcome for group in groups for outcome in group]

    before = evaluator.drive_block.__wrapped__._cache_size()
    found = outcomes()
    assert evaluator.drive_block.__wrapped__._cache_size() == before + 1
    assert outcomes(first=5) == found[5:]
    assert len(found) == len(points) == 8
    own = dict(zip(SETTING_OF.values(), points[number], strict=True))
    # Start i of a seed is the point's number times the episodes, and on from there.
    alone = recipe.evaluation_config(config.compose(flags=FEW | own), "single-level")
    many = evaluator.evaluate(alone, constant(7), 5, (number + 1) * episodes)
    assert found[number].at(0).accidents == (many.accident[-episodes:] == 1).sum() == episodes
    assert found[number].speed == pytest.approx(many.average_speed[-episodes:].mean())
    assert found[number].reward == pytest.approx(many.accumulated_reward[-episodes:].mean())


@pytest.mark.parametrize("value", [np.nan, -np.inf], ids=str)
def test_figures_that_are_not_finite_are_refused(value):
    worlds = evaluator.start_block(TEST, 0, 0)
    sound = jax.device_get(evaluator.drive_block(evaluator.of_any_start(TEST), WEIGHTS, worlds))
    for name in ("timestep_reward", "speed_sum", "distance"):
        spoilt = getattr(sound.stats, name).copy()
        spoilt[2:4] = value
        block = replace(sound, stats=replace(sound.stats, **{name: spoilt}))
        with pytest.raises(NumbersError, match="not finite in 2 of 4 episodes, first in episode 2"):
            evaluator.as_episodes(TEST.driving, [block], 4)
