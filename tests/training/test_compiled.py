"""What the compiled training must not do, seen in the compiled program and not on a clock."""

from dataclasses import replace

import jax
import numpy as np
import pytest
from test_stage import COURSE, LEVEL, SETTINGS

from lanewise.bench import workloads
from lanewise.evaluation import evaluator
from lanewise.evaluation.settings import EvaluationSettings
from lanewise.training import stage, trainer
from lanewise.training.trainer import StagePlan

pytestmark = pytest.mark.slow


def test_the_replay_is_never_copied():
    """A chunk has no room for a second one."""
    large = replace(SETTINGS, learner=replace(SETTINGS.learner, replay_capacity=200_000))
    config = replace(COURSE, learning=((LEVEL, large),))
    state = jax.eval_shape(lambda: stage.begin(config, {}, jax.random.key(0)))
    program = stage.advance.__wrapped__.lower(config, {}, state).compile()
    rows = state.replays[LEVEL].rows
    assert program.memory_analysis().temp_size_in_bytes < rows.size * 4 / 10


def test_each_entry_point_is_compiled_once():
    """Chunk after chunk, with validations: as many programs after the last as after the first."""
    validation = evaluator.EvaluationConfig(
        COURSE.scenario, COURSE.driving, COURSE.controller, 3, "validation"
    )
    tests = EvaluationSettings(validation_episodes=150, validation_interval=1)
    plan = StagePlan("one", COURSE, validation, tests)
    entries = (stage.begin, stage.advance, evaluator.drive_block)
    progress = trainer.begin(plan, {}, jax.random.key(3))
    progress, _ = trainer.advance(plan, {}, progress)
    after_one = [entry.__wrapped__._cache_size() for entry in entries]
    for _ in range(2):
        progress, _ = trainer.advance(plan, {}, progress)
    assert [entry.__wrapped__._cache_size() for entry in entries] == after_one
    assert progress.counters.chunks == 3


def test_seeds_together_are_the_seeds_alone():
    """Many seeds in one compiled loop train as each alone."""
    keys = jax.random.split(jax.random.key(5), 3)
    states, advance = workloads.in_one_loop(COURSE, keys)
    states, metrics = advance(states)
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
