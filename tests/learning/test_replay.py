"""The ring buffer against a plain Python list."""

from functools import partial

import jax
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
        features=np.stack([number, -number], axis=1),
        action=number.astype(np.int32) % 9,
        reward=number * np.float32(0.5),
        discount=number * np.float32(0.25),
        next_features=np.stack([number + 0.125, -number - 0.125], axis=1).astype(np.float32),
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
        memory = add(memory, numbered(number, len(mask)), np.array(mask))
        written += [number + i for i, kept in enumerate(mask) if kept]
        number += len(mask)
    expected = np.zeros((capacity, 2 * INPUTS + 3), np.float32)
    for i, item in enumerate(written):
        expected[i % capacity] = row(item)
    np.testing.assert_array_equal(memory.rows, expected)
    assert int(memory.position) == len(written)
    assert int(memory.filled) == min(len(written), capacity)


# Few shapes, so that compilation does not dominate: batches that divide the capacity, do not, and
# are larger.
@pytest.mark.parametrize(("capacity", "batch"), [(7, 3), (8, 4), (3, 8)])
@given(data=st.data())
@settings(max_examples=25, deadline=None)
def test_equals_a_list(capacity, batch, data):
    mask = st.lists(st.booleans(), min_size=batch, max_size=batch)
    check_against_list(capacity, data.draw(st.lists(mask, max_size=8)))


def test_sample_returns_whole_transitions_of_the_filled_part_only():
    memory = add(replay.empty(8, INPUTS), numbered(1, 4), np.array([True, False, True, True]))
    drawn = sample(memory, jax.random.key(0), 8000)
    numbers = np.asarray(drawn.features[:, 0])
    assert set(numbers) == {1.0, 3.0, 4.0}
    columns = np.column_stack(
        [drawn.features, drawn.action, drawn.reward, drawn.discount, drawn.next_features]
    )
    np.testing.assert_array_equal(columns, [row(number) for number in numbers])
    assert drawn.action.dtype == np.int32


def test_sample_is_uniform_over_a_wrapped_buffer_and_differs_by_key():
    memory = replay.empty(8, INPUTS)
    for i in range(4):
        memory = add(memory, numbered(4 * i + 1, 4), np.ones(4, bool))
    numbers, again, other = (
        np.asarray(sample(memory, jax.random.key(key), 8000).features)[:, 0] for key in (1, 1, 2)
    )
    np.testing.assert_array_equal(numbers, again)
    assert not np.array_equal(numbers, other)
    values, counts = np.unique(numbers, return_counts=True)
    np.testing.assert_array_equal(values, np.arange(9, 17))
    # 1,000 expected each, standard deviation 30: six of them.
    assert np.abs(counts - 1000).max() < 180


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
