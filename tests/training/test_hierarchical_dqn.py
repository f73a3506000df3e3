"""The one-file example makes the library's first updates, with the library's random numbers."""

import importlib.util
from pathlib import Path

import jax
import numpy as np
import optax
import pytest

from lanewise import config
from lanewise.evaluation import evaluator
from lanewise.runs.training_loop import STAGE_STREAM
from lanewise.training import recipe, stage

EXAMPLE = Path(__file__).parents[2] / "examples" / "hierarchical_dqn.py"
SEED = 1
UPDATES = 76
"""In a stage's first chunk."""


@pytest.fixture(scope="module")
def example():
    spec = importlib.util.spec_from_file_location(EXAMPLE.stem, EXAMPLE)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def stage_key(number):
    return jax.random.fold_in(jax.random.key(SEED), STAGE_STREAM + number)


def first_chunk(settings, number, frozen):
    """The library's state after the first chunk of a stage of preset ``quick``."""
    course = recipe.stage_config(settings, recipe.RECIPES["hierarchical"][number])
    begun = stage.begin(course, frozen, stage_key(number))
    return stage.advance(course, frozen, begun)[0]


def assert_close(ours, theirs):
    for one, other in zip(jax.tree.leaves(ours), jax.tree.leaves(theirs), strict=True):
        np.testing.assert_allclose(one, other, rtol=0, atol=1e-5)


def test_step_1_makes_the_first_updates_of_the_library(example):
    theirs = first_chunk(config.compose(), 0, {})
    learner, key = theirs.learners["high_level"], stage_key(0)
    optimiser = optax.adam(optax.linear_schedule(*example.LEARNING_RATES, 15_000))
    ours = example.start(example.STEP_1, optimiser, None, key, 32)
    ours, replay, drives = example.advance(example.STEP_1, optimiser, None, key, 0, ours)
    assert learner.updates == UPDATES
    assert_close((ours.online, ours.target), (learner.online, learner.target))
    assert replay.written == theirs.replays["high_level"].position
    assert_close(drives.observation, theirs.rollouts.percept.features)


@pytest.mark.slow
def test_a_short_training_and_its_test_equal_the_library(example, capsys):
    levels, decisions = ("high_level", "low_level"), stage.CHUNK * 32
    decay = {f"{level}.learner.learning_rate_decay": decisions // 8 for level in levels}
    settings, frozen = config.compose(flags=decay), {}
    for number in range(2):
        state = first_chunk(settings, number, frozen)
        assert state.learners[levels[number]].updates == UPDATES
        frozen = frozen | stage.online(state.learners)
    course = recipe.evaluation_config(settings, "hierarchical")
    tested = evaluator.evaluate(course, frozen, SEED, example.TEST_EPISODES)

    ours = example.main(seed=SEED, decisions=(decisions, decisions))

    assert_close(ours, [frozen[level] for level in levels])
    accidents, reward = np.mean(tested.accident > 0), tested.accumulated_reward.mean()
    *_, last = capsys.readouterr().out.splitlines()
    assert last == (
        f"test: {tested.success.mean():.1%} success, {accidents:.1%} accidents, reward {reward:.2f}"
    )


def test_it_is_short_enough_to_be_read():
    assert len(EXAMPLE.read_text("utf-8").splitlines()) <= 350
