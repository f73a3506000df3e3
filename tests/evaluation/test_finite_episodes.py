"""A test in which numbers went wrong is refused, with the first episode of it."""

from dataclasses import replace
from types import SimpleNamespace

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import lanewise
from lanewise.driving import observation
from lanewise.driving.parts import OURS
from lanewise.driving.settings import DrivingSettings
from lanewise.errors import NumbersError
from lanewise.evaluation import drive

BAD = (np.nan, np.inf, -np.inf)


def sums_of(count):
    one = replace(drive.nothing_yet(0.0), decisions=jnp.int32(3))
    return jax.tree.map(lambda leaf: np.repeat(np.asarray(leaf)[None], count, 0), one)


@pytest.mark.parametrize("value", BAD, ids=str)
@pytest.mark.parametrize("name", ["reward", "speed", "distance"])
def test_figures_that_are_not_finite_are_refused(name, value):
    sums = sums_of(5)
    assert len(drive.as_episodes(DrivingSettings(), sums)) == 5
    spoilt = getattr(sums, name).copy()
    spoilt[2:4] = value
    with pytest.raises(NumbersError, match="not finite in 2 of 5 episodes, first in episode 2"):
        drive.as_episodes(DrivingSettings(), replace(sums, **{name: spoilt}))


def test_an_observation_that_was_not_finite_is_refused():
    sound = np.array([True, False, True])
    with pytest.raises(NumbersError, match=r"an observation is not finite in 1 of 3 .* episode 1"):
        drive.as_episodes(DrivingSettings(), replace(sums_of(3), sound=sound))


def observe(settings, world):
    features = observation.features(settings, world)
    return features.at[7].set(jnp.where(world.vehicles.x[0] > 5.0, jnp.inf, features[7]))


@pytest.mark.parametrize("value", BAD, ids=str)
def test_a_users_own_observation_is_looked_at(value):
    own = replace(OURS, observe=lambda settings, world: world * 2.0)
    sound, unsound = (SimpleNamespace(world=jnp.float32([1.0, last])) for last in (2.0, value))
    assert drive.sound(DrivingSettings(), sound, own)
    assert not drive.sound(DrivingSettings(), unsound, own)


@pytest.mark.slow
def test_evaluate_refuses_such_a_test():
    with pytest.raises(NumbersError, match="an observation is not finite in 3 of 3 episodes"):
        lanewise.evaluate(
            lambda seen: 4, episodes=3, duration=3.0, parts=lanewise.Parts(observe=observe)
        )
