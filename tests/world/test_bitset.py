"""Sets of vehicles against NumPy."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from lanewise.world import bitset


@pytest.mark.parametrize("count", [32, 70])
def test_sets_across_words(count):
    inside = np.random.default_rng(count).random((20, count)) < 0.1
    limit = jnp.arange(count + 1)

    @jax.jit
    def sets():
        words = bitset.where(count, lambda member: jnp.array(inside[:, member]))
        every, below = bitset.where(count, lambda _: limit >= 0), bitset.below(limit, count)
        last = bitset.single(jnp.maximum(limit - 1, 0), count)
        some = (words, bitset.without(every, below), bitset.both(below, last), last)
        return [bitset.smallest(each) for each in some]

    lowest, left, above, last = jax.device_get(sets())
    firsts = np.where(inside.any(1), inside.argmax(1), -1)
    np.testing.assert_array_equal(lowest, firsts)
    # What is not below a limit begins with it.
    np.testing.assert_array_equal(left, np.where(limit < count, limit, -1))
    np.testing.assert_array_equal(above, limit - 1)
    np.testing.assert_array_equal(last[1:], limit[:-1])
