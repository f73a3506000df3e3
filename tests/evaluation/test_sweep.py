from dataclasses import dataclass, replace

import jax
import jax.numpy as jnp
import pytest

from lanewise.controllers.single_level import SingleLevel
from lanewise.driving.settings import DrivingSettings
from lanewise.evaluation import escapes, evaluator, reachability, sweep
from lanewise.evaluation.evaluator import EvaluationConfig
from lanewise.evaluation.grid import Grid
from lanewise.learning import network
from lanewise.scenario.settings import TrafficSettings, TrapSettings

EPISODES = 3
SCENARIO = TrapSettings(traffic=TrafficSettings(vehicles_ahead=2))


@dataclass(frozen=True)
class Faster(SingleLevel):
    """Speeds up for ever, into whatever stands ahead."""

    def act(self, memory, percept):
        return jnp.int32(7), memory


@pytest.fixture(autouse=True)
def small_blocks(monkeypatch):
    monkeypatch.setattr(evaluator, "BLOCK", 4)


def parameters():
    return {"single_level": network.init(jax.random.key(0), 26, (8,), 9)}


def outcomes(config, grid, first=0):
    found = sweep.run(config, parameters(), 5, EPISODES, grid.points(), first)
    return [outcome for group in found for outcome in group]


@pytest.mark.slow
def test_a_start_of_a_grid_is_the_test_start_with_those_settings():
    """Padded with lanes and vehicles it lacks, it comes to what its own settings give."""
    grid = Grid((9.5,), (8.5,), (3, 5), (15.0,), (6.0,), (20.0, 30.0), (0, 2))
    plain = EvaluationConfig(SCENARIO, DrivingSettings(), Faster(), 24)
    found = outcomes(sweep.config(plain, grid), grid)
    points = grid.points()
    assert len(found) == len(points) == 8
    for number in (0, 3, 6):
        point = points[number]
        traffic = replace(
            SCENARIO.traffic, spacing=point.spacing, vehicles_behind=point.vehicles_behind
        )
        own = replace(
            SCENARIO,
            ego_speed=point.ego_speed,
            trap_speed=point.trap_speed,
            lanes=point.lanes,
            test_front_distance=point.front_distance,
            test_side_distance=point.side_distance,
            traffic=traffic,
        )
        # Start i of a seed is the point's number times the episodes, and on from there.
        many = evaluator.evaluate(
            replace(plain, scenario=own), parameters(), 5, (number + 1) * EPISODES
        )
        assert found[number].successes == many.success[-EPISODES:].sum()
        assert found[number].escapes == many.escaped[-EPISODES:].sum()
        assert found[number].collision == (many.accident[-EPISODES:] == 1).sum() == EPISODES
        assert found[number].speed == pytest.approx(many.average_speed[-EPISODES:].mean())
        assert found[number].reward == pytest.approx(many.accumulated_reward[-EPISODES:].mean())


@pytest.mark.slow
def test_a_grid_compiles_once_and_can_be_taken_up_anywhere():
    grid = Grid((8.0, 12.0), (8.0, 11.0), (3, 4), (15.0,), (5.0,))
    config = sweep.config(EvaluationConfig(SCENARIO, DrivingSettings(), Faster(), 20), grid)
    before = evaluator.drive_block.__wrapped__._cache_size()
    found = outcomes(config, grid)
    assert evaluator.drive_block.__wrapped__._cache_size() == before + 1
    assert outcomes(config, grid, first=5) == found[5:]
    assert len({(outcome.speed, outcome.reward) for outcome in found}) > 3


def test_more_episodes_than_a_block_belong_to_one_start():
    grid = Grid((8.0,), (8.0, 10.0), (3,), (15.0,), (5.0,))
    config = sweep.config(EvaluationConfig(SCENARIO, DrivingSettings(), Faster(), 20), grid)
    found = [o for group in sweep.run(config, parameters(), 5, 6, grid.points()) for o in group]
    assert [outcome.episodes for outcome in found] == [6, 6]


@pytest.mark.slow
def test_reach_agrees_with_judging_each_start_alone():
    driving = DrivingSettings()
    grid = Grid((13.0,), (8.0,), (3, 4), (14.8,), (6.61, 7.43))
    found = list(sweep.reach(SCENARIO, driving, 50, 0.1, grid.points()))
    config = escapes.ReachabilityConfig(SCENARIO, driving, 4, 50)
    for point, reach in zip(grid.points(), found, strict=True):
        alone = reachability.judge(config, sweep.start_of(SCENARIO, point))
        assert reach.winnable == alone.winnable
        assert reach.decided
    # A centimetre's way between the trap cars is an escape, but not one with 10 cm to spare.
    assert [reach.winnable for reach in found] == [True, False, True, False]
    assert not any(reach.clear for reach in found)
    easy = next(sweep.reach(SCENARIO, driving, 50, 0.1, Grid((10.0,), (10.0,), (3,)).points()))
    assert easy.clear
    start = sweep.start_of(SCENARIO, Grid((10.0,), (10.0,), (3,)).points()[0])
    assert reachability.replay(config, start, [tuple(map(int, easy.escape))]).tolist() == [True]
