"""Many seeds in one compiled loop train as each alone."""

import jax
import numpy as np
import pytest

from lanewise.bench.parts import gpu
from lanewise.bench.task import Asked
from lanewise.bench.workers import lanewise_seeds
from lanewise.controllers.single_level import SingleLevel
from lanewise.driving.settings import DrivingSettings
from lanewise.learning.settings import LearnerSettings
from lanewise.scenario.settings import TrafficSettings, TrapSettings
from lanewise.training import stage
from lanewise.training.rollout import Course
from lanewise.training.settings import StageSettings

SETTINGS = StageSettings(
    worlds=4,
    duration=20,
    updates_per_step=0.1,
    learner=LearnerSettings(hidden=(8,), batch_size=8, warm_up=50, replay_capacity=150),
)
COURSE = Course(
    TrapSettings(traffic=TrafficSettings(vehicles_ahead=2)),
    DrivingSettings(),
    SingleLevel(),
    SETTINGS,
    (("single_level", SETTINGS),),
)


def test_seeds_together_are_the_seeds_alone():
    keys = jax.random.split(jax.random.key(5), 3)
    states, metrics = lanewise_seeds.together(COURSE)(lanewise_seeds.begin(COURSE, keys))
    rewards = []
    for number, key in enumerate(keys):
        alone, one = stage.advance(COURSE, {}, stage.begin(COURSE, {}, key))
        of_it = jax.tree.map(lambda leaf, number=number: leaf[number], metrics)
        np.testing.assert_array_equal(of_it.finished.done, one.finished.done)
        np.testing.assert_allclose(of_it.finished.reward, one.finished.reward, atol=1e-4)
        updates = states.learners["single_level"].updates
        assert int(updates[number]) == int(alone.learners["single_level"].updates) > 0
        rewards.append(np.asarray(one.finished.reward).tobytes())
    assert len(set(rewards)) == len(keys)
    assert int(states.iteration) == stage.CHUNK


@pytest.mark.skipif(jax.default_backend() == "gpu", reason="there is a GPU")
def test_without_a_gpu_nothing_is_measured():
    assert gpu.tasks(Asked(1.0, 1, 1, None)) == []
