"""The ring buffer against a plain Python list."""

from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from lanewise.learning import replay
from lanewise.learning.replay import Replay, Transition

INPUTS = 2
add = jax.jit(replay.add)
sample = jax.jit(replay.sample, static_argnums=2)


def numbered(start: int, count: int) -> Transition:
    """Transitions whose every field tells which number they are."""
    number = np.arange(start, start + count, dtype=np.float32)
    return Transition(
        features=jnp.asarray(np.stack([number, -number], axis=1)),
        action=jnp.asarray(number, jnp.int32) % 9,
        reward=jnp.asarray(number * 0.5),
        discount=jnp.asarray(number * 0.25),
        next_features=jnp.asarray(np.stack([number + 0.125, -number - 0.125], axis=1)),
    )


def row(number: float) -> list[float]:
    return [
        *(number, -number),
        *(number % 9, number * 0.5, number * 0.25),
        *(number + 0.125, -number - 0.125),
    ]


def check_against_list(capacity: int, masks: list[list[bool]]) -> None:
    memory = replay.empty(capacity, INPUTS)
    written: list[int] = []
    number = 1
    for mask in masks:
        memory = add(memory, numbered(number, len(mask)), jnp.array(mask))
        written += [number + i for i, kept in enumerate(mask) if kept]
        number += len(mask)
    expected = np.zeros((capacity, 2 * INPUTS + 3), np.float32)
    for i, item in enumerate(written):
        expected[i % capacity] = row(item)
    np.testing.assert_array_equal(memory.rows, expected)
    assert int(memory.position) == len(written)
    assert int(memory.filled) == min(len(written), capacity)


# Few shapes, so that compilation does not dominate: batches smaller than, equal to, larger than
# and not dividing the capacity.
@pytest.mark.parametrize(("capacity", "batch"), [(7, 3), (8, 4), (5, 5), (3, 8), (1, 4), (6, 1)])
@given(data=st.data())
@settings(max_examples=25, deadline=None)
def test_equals_a_list(capacity, batch, data):
    mask = st.lists(st.booleans(), min_size=batch, max_size=batch)
    check_against_list(capacity, data.draw(st.lists(mask, max_size=8)))


def test_wraps_inside_one_batch():
    check_against_list(5, [[True] * 4, [True, False, True, True]])


def test_equals_a_list_inside_a_compiled_loop():
    masks = np.random.default_rng(0).random((40, 4)) < 0.6
    batches = jax.tree.map(
        lambda *leaves: jnp.stack(leaves), *[numbered(4 * i, 4) for i in range(40)]
    )

    @jax.jit
    def run(memory):
        return jax.lax.scan(lambda m, x: (replay.add(m, *x), None), memory, (batches, masks))[0]

    memory = run(replay.empty(11, INPUTS))
    written = np.flatnonzero(masks.ravel())
    expected = np.zeros((11, 2 * INPUTS + 3), np.float32)
    for i, item in enumerate(written):
        expected[i % 11] = row(float(item))
    np.testing.assert_array_equal(memory.rows, expected)


def test_sample_returns_whole_transitions_of_the_filled_part_only():
    memory = add(replay.empty(10, INPUTS), numbered(1, 4), jnp.array([True, False, True, True]))
    drawn = sample(memory, jax.random.key(0), 200)
    numbers = np.asarray(drawn.features[:, 0])
    assert set(numbers) == {1.0, 3.0, 4.0}
    for got, i in zip(np.asarray(replay._pack(drawn, jnp.float32)), numbers, strict=True):
        np.testing.assert_array_equal(got, row(i))
    assert drawn.action.dtype == jnp.int32


def test_sample_is_uniform_over_a_wrapped_buffer():
    memory = replay.empty(8, INPUTS)
    for i in range(4):
        memory = add(memory, numbered(4 * i + 1, 4), jnp.ones(4, bool))
    numbers = np.asarray(sample(memory, jax.random.key(1), 8000).features[:, 0])
    values, counts = np.unique(numbers, return_counts=True)
    np.testing.assert_array_equal(values, np.arange(9, 17))
    # 1,000 expected each, standard deviation 30: six of them.
    assert np.abs(counts - 1000).max() < 180


def test_sample_differs_by_key_and_repeats_by_key():
    memory = add(replay.empty(64, INPUTS), numbered(0, 64), jnp.ones(64, bool))
    first, again, other = (sample(memory, jax.random.key(k), 32).features for k in (0, 0, 1))
    np.testing.assert_array_equal(first, again)
    assert not np.array_equal(first, other)


@partial(jax.jit, donate_argnums=0)
def _write_and_read(memory: Replay, keys: jax.Array) -> tuple[Replay, jax.Array]:
    def step(memory, key):
        drawn = replay.sample(memory, key, 8)
        memory = replay.add(memory, drawn, drawn.reward > 0.0)
        return memory, replay.sample(memory, key, 8).reward.sum()

    return jax.lax.scan(step, memory, keys)


def test_a_compiled_loop_holds_no_second_copy_of_the_buffer():
    memory = replay.empty(100_000, INPUTS)
    compiled = _write_and_read.lower(memory, jax.random.split(jax.random.key(0), 5)).compile()
    assert compiled.memory_analysis().temp_size_in_bytes < memory.rows.nbytes / 10
