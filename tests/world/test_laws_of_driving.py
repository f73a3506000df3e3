"""The laws of what the ego observes, of its reward and its accidents, in docs/numerics.md."""

from dataclasses import replace

import jax
import numpy as np
import pytest
from hypothesis import assume

from lanewise.driving import accidents, observation, reward
from lanewise.driving.settings import DrivingSettings, ObservationSettings, RewardSettings
from small_worlds import SIZE, change, check, lane_distances, mirrored, reordered, shifted

SCALINGS = {"fine": 2.0, "highway-env": 1.0}
"""Scalings of the observation, and their limits."""
EGO_X = 1
"""Place of the ego's own x among the features. It is absolute (`absolute-ego-place`)."""
ACROSS = [2, 4, 5, *(8, 10), *(13, 15), *(18, 20), *(23, 25)]
"""Features across the road: y and vy of the ego, the lane offset, y and vy of the others."""
DRIVING, REWARD = DrivingSettings(), RewardSettings()


@jax.jit
def _observe(world, steering):
    code = accidents.ego_accident(world, DRIVING.stopped_speed)
    views = [observation.features(ObservationSettings(scaling=name), world) for name in SCALINGS]
    return views, reward.decision_reward(REWARD, world, steering, code != accidents.NONE), code


def observe(world, steering):
    """Features by each scaling, reward and accident; no ego is exactly between two lanes."""
    world = change(world, present=world.vehicles.present | (np.arange(SIZE) == 0))
    nearest = np.sort(lane_distances(world))
    assume((nearest[:, 0] != nearest[:, 1]).all())
    with jax.enable_x64(True):
        return jax.tree.map(np.array, _observe(world, steering))


def draw_steering(rng):
    return float(rng.choice([-1.0, 0.0, 1.0])) * DRIVING.actions.steering


def bounds(world, rng):
    """Features and reward stay within their bounds; absent neighbours are all zeros."""
    steering = draw_steering(rng)
    views, pay, code = observe(world, steering)
    for view, limit in zip(views, SCALINGS.values(), strict=True):
        assert np.abs(view).max() <= limit
        for neighbour in view[6:].reshape(4, 5):
            assert neighbour[0] == 1 or not neighbour.any()
    weights = REWARD.speed_weight + REWARD.steering_weight + REWARD.centring_weight
    least = -REWARD.steering_weight * abs(np.sin(steering)) / weights
    if code == accidents.NONE:
        assert least - 1e-12 <= pay <= 1 + 1e-12
    else:
        assert pay == -REWARD.accident_penalty


def assert_the_same(world, other, rng, turn=1, without=(), negated=()):
    """What is observed in two worlds is the same, to the bit, but for some features."""
    steering = draw_steering(rng)
    (views, pay, code), (others, theirs, accident) = (
        observe(world, steering),
        observe(other, turn * steering),
    )
    for mine, its in zip(views, others, strict=True):
        its[list(negated)] *= -1
        its[list(without)] = mine[list(without)]
        np.testing.assert_array_equal(mine, its)
    assert (pay, code) == (theirs, accident)


def shift(world, rng):
    """Further along the road it is the same, but for the ego's own x."""
    along = float(np.float32(rng.uniform(-1e4, 1e4)))
    world = shifted(shifted(world, along), -along)
    assert_the_same(world, shifted(world, along), rng, without=[EGO_X])


def mirror(world, rng):
    """Mirrored it is the mirrored observation and the same reward."""
    assert_the_same(world, mirrored(world), rng, turn=-1, negated=ACROSS)


def reorder(world, rng):
    """The order of the others does not matter, unless two are equally far away."""
    world = change(world, x=world.vehicles.x + 1.001e-3 * np.arange(SIZE) ** 2)
    apart = np.abs(world.vehicles.x - world.vehicles.x[0])[1:]
    assume(len(np.unique(apart)) == SIZE - 1)
    order = np.concatenate([[0], 1 + rng.permutation(SIZE - 1)])
    assert_the_same(world, reordered(world, order), rng)


def unseen(world, rng):
    """Vehicles beyond 200 m, or that far behind, do not matter."""
    hidden = (rng.random(SIZE) < 0.5) & (np.arange(SIZE) > 0)
    away = rng.choice([1.0, -1.0], SIZE) * 10 ** rng.uniform(2.4, 5, SIZE)
    x = world.vehicles.x
    world = change(world, x=np.where(hidden, x[0] + away, x))
    gone = replace(world.vehicles, present=world.vehicles.present & ~hidden)
    assert_the_same(world, replace(world, vehicles=gone), rng)


LAWS = {law.__name__: law for law in (bounds, shift, mirror, reorder, unseen)}


@pytest.mark.parametrize("examples", [60, pytest.param(400, marks=pytest.mark.slow)])
@pytest.mark.parametrize("law", LAWS)
def test_law_of_driving(law, examples):
    check(LAWS[law], examples)
