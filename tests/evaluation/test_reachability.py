"""Winnable or not: against every sequence of actions, a closed form, and the real highway-env."""

from dataclasses import replace
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from lanewise.controllers.references import RuleBased
from lanewise.driving import actions, episode
from lanewise.driving.settings import DrivingSettings
from lanewise.evaluation import reachability, sweep
from lanewise.evaluation.evaluator import EvaluationConfig
from lanewise.evaluation.grid import Grid
from lanewise.evaluation.reachability import ReachabilityConfig
from lanewise.interop.highway_env import build_env, read_world
from lanewise.scenario.settings import TrafficSettings, TrapSettings
from lanewise.scenario.trap import Start
from lanewise.world import bicycle, tick

DRIVING = DrivingSettings()
COURSE = ReachabilityConfig(TrapSettings(lanes=5), DRIVING, duration=50)
TEST = EvaluationConfig(COURSE.scenario, DRIVING, RuleBased(), 50)


def start(ego, trap, front, side, lanes=3):
    return Start.of(
        TrapSettings(traffic=TrafficSettings(vehicles_ahead=0)),
        lanes=lanes,
        ego_speed=ego,
        trap_speed=trap,
        front_distance=front,
        side_distance=side,
    )


PAPER = start(10.0, 10.0, 15.62, 6.61)
HOPELESS = start(13.0, 8.0, 14.8, 7.43)
THREADED = start(13.0, 8.0, 14.8, 6.61)
"""To be won only between the trap cars, a centimetre from either."""
BLOCK = 128
"""States that are driven together, filled up, so that one program is compiled."""


def stopping_gap(it):
    """Metres left behind trap car 1 after braking straight down to its speed, in closed form.

    Each tick of 0.1 s moves with the old speed and then takes 0.1 m/s off it: with n ticks,
    D1 - 5 m - sum over k < n of (dv - 0.1 k) 0.1, the sum of an arithmetic series.
    """
    faster = max(it.ego_speed - it.trap_speed, 0.0)
    ticks = round(faster / 0.1)
    return it.front_distance - 5.0 - 0.1 * (faster * ticks - 0.05 * ticks * (ticks - 1))


@pytest.fixture(scope="module")
def paper():
    return reachability.judge(COURSE, PAPER)


def test_an_escape_holds_in_the_real_highway_env(paper):
    """Both an easy escape and the narrowest: highway-env itself sees no crash and no way off."""
    assert paper.winnable
    assert paper.decided
    threaded = reachability.judge(COURSE, THREADED)
    for it, chosen in ((PAPER, paper.actions), (THREADED, threaded.actions)):
        assert len(chosen) == 50
        env = build_env(jax.device_get(reachability.begin(COURSE, it)))
        past = False
        for action in chosen:
            env.step(action)
            assert not env.vehicle.crashed
            assert env.vehicle.on_road
            assert env.vehicle.speed > DRIVING.stopped_speed
            cars = read_world(env).vehicles.x
            past |= bool(cars[0] - 2.5 > cars[1:].max() + 2.5)
        assert past
        env.close()


@pytest.mark.slow
def test_a_hopeless_start_ends_in_an_accident_whatever_is_done():
    """Every sequence of actions, one by one, in the world as a test episode drives it."""
    verdict = reachability.judge(COURSE, HOPELESS)
    assert not verdict.winnable
    assert verdict.actions == ()

    @jax.jit
    def step_all(states):
        one = partial(episode.step, DRIVING, duration=50)
        return jax.vmap(lambda s: jax.vmap(lambda a: one(s, a))(jnp.arange(9)))(states)

    def survivors(states):
        count = len(states.start_x)
        padded = jax.tree.map(
            lambda leaf: np.concatenate([leaf, np.repeat(leaf[-1:], BLOCK - count, 0)]), states
        )
        after = jax.device_get(step_all(padded))
        alive = ~after.outcome.terminated[:count]
        return jax.tree.map(lambda leaf: leaf[:count][alive], after)

    state = episode.begin(reachability.begin(COURSE, HOPELESS))
    states = jax.tree.map(lambda leaf: np.asarray(leaf)[None], state)
    driven = decisions = 0
    while len(states.start_x):
        left = [
            survivors(jax.tree.map(lambda leaf, i=first: leaf[i : i + BLOCK], states))
            for first in range(0, len(states.start_x), BLOCK)
        ]
        states = jax.tree.map(lambda *parts: np.concatenate(parts), *left)
        driven += len(states.start_x)
        decisions += 1
        assert not states.stats.escaped.any()
        assert decisions < 50
    # More than the search's, which gives up what is sure to be hit in the next tick.
    assert driven >= verdict.states > 500


@pytest.mark.parametrize(
    "it",
    [
        HOPELESS,
        start(13.0, 8.0, 14.0, 8.2),
        start(13.0, 11.0, 16.44, 4.06),
        start(8.0, 8.0, 14.0, 8.0),
    ],
)
def test_whoever_can_stay_behind_can_get_out(it):
    """Braking straight down to the trap's speed without touching it is enough to escape later."""
    verdict = reachability.judge(COURSE, it)
    assert bool(verdict.actions) or stopping_gap(it) <= 0.0
    assert verdict.decided


def test_clearance_rules_out_what_passes_by_centimetres():
    """In a grid as for each start alone: escapes, but not with 10 cm to spare."""
    wide = replace(COURSE, clearance=0.1)
    grid = Grid((13.0,), (8.0,), (5,), (14.8,), (6.61, 7.43))
    found = list(sweep.reach(TEST, 0.1, grid.places()))
    for point, reach in zip(grid.places(), found, strict=True):
        alone = Start.of(TrapSettings(), **point.start_numbers)
        assert reach.winnable == reachability.judge(COURSE, alone).winnable
        assert reach.decided
        assert not reach.clear
        assert not reachability.judge(wide, alone).winnable
    assert [reach.winnable for reach in found] == [True, False]
    (easy,) = Grid((10.0,), (10.0,), (5,), (15.62,), (6.61,)).places()
    reach = next(sweep.reach(TEST, 0.1, [easy]))
    assert reach.clear
    escape = tuple(map(int, reach.escape))
    assert reachability.replay(COURSE, Start.of(TrapSettings(), **easy.start_numbers), [escape])[0]


def test_a_known_escape_is_enough(paper):
    """It holds with more lanes too, and saves the search; a useless one does no harm."""
    wider = start(10.0, 10.0, 15.62, 6.61, lanes=5)
    idle = (actions.IDLE,) * 50
    assert reachability.replay(COURSE, wider, [idle, paper.actions]).tolist() == [False, True]
    verdict = reachability.judge(COURSE, wider, [idle, paper.actions])
    assert verdict.actions == paper.actions
    assert not reachability.judge(COURSE, HOPELESS, [idle, paper.actions]).winnable


def test_a_search_given_up_does_not_call_a_start_unwinnable(monkeypatch):
    monkeypatch.setattr(reachability, "WIDTHS", (1,))
    monkeypatch.setattr(reachability, "MOST_STATES", 10)
    verdict = reachability.judge(COURSE, HOPELESS)
    assert verdict.winnable
    assert not verdict.decided


def test_the_searchs_ticks_are_the_worlds():
    """Moving and hitting is all a tick does among the trap cars: same bits, crashes included."""
    rng, count = np.random.default_rng(0), 300
    world = reachability.begin(COURSE, start(10.0, 8.0, 15.0, 5.0))
    lowest, highest = np.array([[0.0, -2.5, -0.5, 5.0], [20.0, 7.0, 0.5, 15.0]])
    egos = rng.uniform(lowest, highest, (count, 4)).astype(np.float32)
    chosen = rng.integers(0, 9, count).astype(np.int32)

    # One world at a time: many at once take three times as long to compile.
    @jax.jit
    def theirs(ego, action):
        put = {
            name: getattr(world.vehicles, name).at[0].set(value)
            for name, value in zip(("x", "y", "heading", "speed"), ego, strict=True)
        }
        commands = actions.commands(DRIVING.actions, action, jnp.float32)
        there = replace(world, vehicles=replace(world.vehicles, **put))
        after = tick.run(bicycle.command(there, *commands), 0.1, 5).vehicles
        moved = jnp.stack([after.x[0], after.y[0], after.heading[0], after.speed[0]])
        return moved, after.crashed[0] | after.impacted[0]

    driven = jax.device_get([theirs(*each) for each in zip(egos, chosen, strict=True)])
    moved, hit = map(np.stack, zip(*driven, strict=True))
    ours, alive, _ = jax.device_get(reachability._step_all(DRIVING, world, egos))
    ours, alive = (of[np.arange(count), chosen] for of in (ours, alive))
    np.testing.assert_allclose(ours, moved, rtol=2e-6, atol=1e-6)
    assert 0 < hit.sum() < count
    assert not (alive & hit).any()
    assert alive[(np.abs(moved[:, 1] - 4.0) < 5.9) & ~hit].all()
