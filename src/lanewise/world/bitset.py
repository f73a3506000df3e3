"""Sets of vehicles as the bits of 32-bit words.

A set of vehicles per vehicle costs one word per 32 vehicles instead of a row of booleans, and the
nearest member is a count of leading zeros: a tick needs no pass that carries the nearest so far.
"""

from collections.abc import Callable
from functools import reduce
from operator import or_

import jax.numpy as jnp
from jax import Array, lax

BITS = 32
Bitset = tuple[Array, ...]
"""uint32 arrays of one shape, the lowest bits first."""


def word_count(count: int) -> int:
    """Words of a set of ``count`` possible members."""
    return -(-count // BITS)


def single(member: Array, count: int) -> Bitset:
    """The set of one member, int of any shape; empty where it is outside [0, count)."""
    words = []
    for word in range(word_count(count)):
        shift = member - BITS * word
        bit = jnp.uint32(1) << jnp.clip(shift, 0, BITS - 1).astype(jnp.uint32)
        words.append(jnp.where((shift >= 0) & (shift < BITS), bit, jnp.uint32(0)))
    return tuple(words)


def below(limit: Array, count: int) -> Bitset:
    """The set of all members smaller than a limit, int of any shape."""
    words = []
    for word in range(word_count(count)):
        shift = limit - BITS * word
        some = (jnp.uint32(1) << jnp.clip(shift, 0, BITS - 1).astype(jnp.uint32)) - 1
        words.append(jnp.where(shift >= BITS, jnp.uint32(0xFFFFFFFF), some))
    return tuple(words)


def where(count: int, holds: Callable[[int], Array]) -> Bitset:
    """The set of members for which something holds: bool of any one shape."""
    words = []
    for word in range(word_count(count)):
        members = range(BITS * word, min(BITS * (word + 1), count))
        bits = (jnp.where(holds(m), jnp.uint32(1 << (m % BITS)), jnp.uint32(0)) for m in members)
        words.append(reduce(or_, bits))
    return tuple(words)


def both(left: Bitset, right: Bitset) -> Bitset:
    """Members of both sets."""
    return tuple(a & b for a, b in zip(left, right, strict=True))


def without(left: Bitset, right: Bitset) -> Bitset:
    """Members of the left set that are not in the right one."""
    return tuple(a & ~b for a, b in zip(left, right, strict=True))


def inhabited(words: Bitset) -> Array:
    """Whether a set has a member, bool."""
    return reduce(or_, words) != 0


def smallest(words: Bitset) -> Array:
    """The smallest member, int32; -1 of an empty set."""
    result = jnp.full(words[0].shape, -1, jnp.int32)
    for word, bits in reversed(list(enumerate(words))):
        lowest = bits & (~bits + 1)
        member = BITS * word + BITS - 1 - lax.clz(lowest).astype(jnp.int32)
        result = jnp.where(bits != 0, member, result)
    return result
