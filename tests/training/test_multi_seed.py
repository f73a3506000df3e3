"""Many seeds in one compiled loop train as each alone."""

import jax
import numpy as np
import pytest
from test_stage import COURSE

from lanewise.training import multi_seed, stage


@pytest.mark.slow
def test_seeds_together_are_the_seeds_alone():
    keys = jax.random.split(jax.random.key(5), 3)
    states, metrics = multi_seed.advance(COURSE)(multi_seed.begin(COURSE, keys))
    rewards = []
    for number, key in enumerate(keys):
        alone, one = stage.advance(COURSE, {}, stage.begin(COURSE, {}, key))
        of_it = jax.tree.map(lambda leaf, number=number: leaf[number], metrics)
        np.testing.assert_array_equal(of_it.episodes.outcome.over, one.episodes.outcome.over)
        np.testing.assert_allclose(of_it.episodes.reward, one.episodes.reward, atol=1e-4)
        updates = states.learners["single_level"].updates
        assert int(updates[number]) == int(alone.learners["single_level"].updates) > 0
        rewards.append(np.asarray(one.episodes.reward).tobytes())
    assert len(set(rewards)) == len(keys)
    assert int(states.iteration) == stage.CHUNK
