"""Training computes what it computed when its results were stored (`first_updates.py` says more).

So does the one-file example, with the library's random numbers.
"""

import importlib.util
import json
from functools import partial
from pathlib import Path

import first_updates
import jax
import numpy as np
import pytest

from lanewise import config
from lanewise.controllers.registry import CONTROLLERS
from lanewise.evaluation import evaluator
from lanewise.runs.training_loop import STAGE_STREAM
from lanewise.system import version
from lanewise.training import recipe, stage

TOLERANCE = 0.02
"""Relative. Code for a processor without fused multiply-add stays within half of it."""
EXAMPLE = Path(__file__).parents[2] / "examples" / "hierarchical_dqn.py"
SEED = 1
UPDATES = 76
"""In a stage's first chunk."""


@pytest.mark.parametrize(
    "arm",
    [
        pytest.param(arm, marks=() if arm == "step-1" else pytest.mark.slow)
        for arm in first_updates.ARMS
    ],
)
def test_first_updates_of(arm):
    stored = json.loads(version.FIRST_UPDATES.read_text("utf-8"))
    close = partial(np.testing.assert_allclose, rtol=TOLERANCE)
    jax.tree.map(close, first_updates.first_updates(arm), stored[arm])


@pytest.mark.slow
def test_a_short_training_of_the_example_and_its_test_equal_the_library(capsys):
    """One chunk of both steps."""
    spec = importlib.util.spec_from_file_location(EXAMPLE.stem, EXAMPLE)
    example = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(example)
    levels, decisions = ("high_level", "low_level"), stage.CHUNK * 32
    decay = {f"{level}.learner.learning_rate_decay": decisions // 8 for level in levels}
    settings, frozen = config.compose(flags=decay), {}
    for number, level in enumerate(levels):
        course = recipe.stage_config(settings, CONTROLLERS["hierarchical"].stages[number])
        key = jax.random.fold_in(jax.random.key(SEED), STAGE_STREAM + number)
        state, _ = stage.advance(course, frozen, stage.begin(course, frozen, key))
        assert state.learners[level].updates == UPDATES
        frozen = frozen | stage.online(state.learners)
    course = recipe.evaluation_config(settings, "hierarchical")
    tested = evaluator.evaluate(course, frozen, SEED, example.TEST_EPISODES)

    ours = example.main(seed=SEED, decisions=(decisions, decisions))

    for one, other in zip(
        jax.tree.leaves(ours), jax.tree.leaves([frozen[level] for level in levels]), strict=True
    ):
        np.testing.assert_allclose(one, other, rtol=0, atol=1e-5)
    accidents, reward = np.mean(tested.accident > 0), tested.accumulated_reward.mean()
    *_, last = capsys.readouterr().out.splitlines()
    assert last == (
        f"test: {tested.success.mean():.1%} success, {accidents:.1%} accidents, reward {reward:.2f}"
    )


def test_the_example_is_short_enough_to_be_read():
    assert len(EXAMPLE.read_text("utf-8").splitlines()) <= 350
