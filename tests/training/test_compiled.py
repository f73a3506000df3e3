"""What the compiled training must not do, seen in the compiled program and not on a clock."""

import re
from collections import Counter

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from test_stage import COURSE

from lanewise.bench import workloads
from lanewise.evaluation import evaluator
from lanewise.training import stage, trainer
from lanewise.training.trainer import StagePlan

pytestmark = pytest.mark.slow
IN_PLACE = {"parameter", "get-tuple-element", "bitcast", "scatter", "dynamic-update-slice"}
"""Instructions that make no second array; a fusion may be one of the last two."""
TO_HOST = ("infeed", "outfeed", "send", "recv", "callback")


def compiled(function, *arguments):
    return function.lower(*arguments).compile().as_text()


def written(program, shape):
    """How an array of a shape comes about in a compiled program: {instruction: count}.

    A fusion counts as what it ends with.
    """
    ends = r"^%?([\w.\-]+) \(.*?\{\n(?:.*\n)*?\s*ROOT %?[\w.\-]+ = \S+ ([\w\-]+)\("
    roots = dict(re.findall(ends, program, re.MULTILINE))
    found = Counter()
    for operation, rest in re.findall(rf"= {re.escape(shape)}\S* ([\w\-]+)\((.*)", program):
        called = re.search(r"calls=%?([\w.\-]+)", rest)
        found[roots[called.group(1)] if operation == "fusion" else operation] += 1
    return found


def replay_shape(config):
    (_, level_settings), *_ = config.learning
    features = config.controller.levels[0].feature_count
    return f"f32[{level_settings.learner.replay_capacity},{2 * features + 3}]"


@pytest.fixture(scope="module")
def chunk():
    """The compiled program of a chunk."""
    state = jax.eval_shape(lambda: stage.begin(COURSE, {}, jax.random.key(0)))
    return compiled(stage.advance.__wrapped__, COURSE, {}, state)


def test_the_replay_is_never_copied(chunk):
    found = written(chunk, replay_shape(COURSE))
    assert found["scatter"] + found["dynamic-update-slice"] >= 1
    assert set(found) <= IN_PLACE


def test_a_copy_would_be_seen():
    """The same look at a loop that keeps the array it was given: it must copy it."""

    def loop(rows):
        after = jax.lax.fori_loop(0, 5, lambda i, now: now.at[i].set(i * 1.0), rows)
        return rows, after

    found = written(compiled(jax.jit(loop), jnp.zeros((150, 55))), "f32[150,55]")
    assert not set(found) <= IN_PLACE


def test_nothing_passes_between_host_and_device_inside_a_chunk(chunk):
    assert not [word for word in TO_HOST if re.search(rf"\b{word}", chunk)]

    @jax.jit
    def talkative(x):
        jax.debug.callback(lambda value: None, x)
        return x

    assert "callback" in compiled(talkative, jnp.float32(0.0))


def test_each_entry_point_is_compiled_once():
    """Chunk after chunk, with validations: as many programs after the last as after the first."""
    validation = evaluator.EvaluationConfig(
        COURSE.scenario, COURSE.driving, COURSE.controller, 3, "validation"
    )
    plan = StagePlan("one", COURSE, validation, 150, validation_interval=1, fresh_episodes=1)
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
