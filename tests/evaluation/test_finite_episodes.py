"""A test in which numbers went wrong is refused, with the first episode of it."""

from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import lanewise
from lanewise.driving import observation
from lanewise.driving.episode import EpisodeStats, Outcome
from lanewise.driving.settings import DrivingSettings
from lanewise.errors import NumbersError
from lanewise.evaluation import evaluator
from lanewise.evaluation.evaluator import Result

BAD = (np.nan, np.inf, -np.inf)


def sums_of(count):
    stats = EpisodeStats(*[jnp.int32(3)] * 2, *[jnp.float32(1.0)] * 4, Outcome(*[jnp.int32(0)] * 4))
    one = Result(stats, jnp.int32(0), jnp.int32(0), jnp.bool_(True))
    return jax.tree.map(lambda leaf: np.repeat(np.asarray(leaf)[None], count, 0), one)


@pytest.mark.parametrize("value", BAD, ids=str)
@pytest.mark.parametrize("name", ["timestep_reward", "speed_sum", "distance"])
def test_figures_that_are_not_finite_are_refused(name, value):
    sums = sums_of(5)
    assert len(evaluator.as_episodes(DrivingSettings(), sums)) == 5
    spoilt = getattr(sums.stats, name).copy()
    spoilt[2:4] = value
    stats = replace(sums.stats, **{name: spoilt})
    with pytest.raises(NumbersError, match="not finite in 2 of 5 episodes, first in episode 2"):
        evaluator.as_episodes(DrivingSettings(), replace(sums, stats=stats))


def test_an_observation_that_was_not_finite_is_refused():
    sound = np.array([True, False, True])
    with pytest.raises(NumbersError, match=r"an observation is not finite in 1 of 3 .* episode 1"):
        evaluator.as_episodes(DrivingSettings(), replace(sums_of(3), finite=sound))


def observe(settings, world):
    features = observation.features(settings, world)
    return features.at[7].set(jnp.where(world.vehicles.x[0] > 5.0, jnp.inf, features[7]))


def test_evaluate_refuses_such_a_test():
    with pytest.raises(NumbersError, match="an observation is not finite in 3 of 3 episodes"):
        lanewise.evaluate(
            lambda seen: 4, episodes=3, duration=3.0, task=lanewise.TaskFunctions(observe=observe)
        )
