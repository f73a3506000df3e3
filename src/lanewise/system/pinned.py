"""JAX as our programs expect it, whatever its switches say around them.

The same seed gives the same bytes. Some switches of JAX (``jax.config``, or variables such as
``JAX_ENABLE_X64``) would change the numbers without a word, or keep our programs from running. Our
programs are therefore traced and called with JAX's defaults for these. The caller's own JAX stays
as it is.
"""

from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager, nullcontext
from functools import wraps
from typing import Any, TypeVar

import jax
import jax.numpy as jnp
from jax import Array

GENERATOR = "threefry2x32"
"""Of all random keys."""
SWITCHES: dict[str, tuple[Any, Callable[[Any], Any]]] = {
    "jax_enable_x64": (False, jax.enable_x64),
    "jax_threefry_partitionable": (True, jax.threefry_partitionable),
    "jax_default_prng_impl": (GENERATOR, jax.default_prng_impl),
    "jax_default_matmul_precision": (None, jax.default_matmul_precision),
    "jax_numpy_dtype_promotion": ("standard", jax.numpy_dtype_promotion),
    "jax_numpy_rank_promotion": ("allow", jax.numpy_rank_promotion),
    "jax_debug_key_reuse": (False, jax.debug_key_reuse),
    "jax_disable_jit": (False, jax.disable_jit),
}
"""By name in ``jax.config``: the value that our programs need, and what sets it in a ``with``."""

R = TypeVar("R")


@contextmanager
def switches() -> Iterator[None]:
    """Within it, and in this thread, JAX's switches are as our programs need them."""
    with ExitStack() as stack:
        for name, (value, switch) in SWITCHES.items():
            if getattr(jax.config, name) != value:
                stack.enter_context(switch(value))
        yield


def jit(**options: Any) -> Callable[[Callable[..., R]], Callable[..., R]]:
    """A decorator as `jax.jit`, whose programs are traced and called within `switches`.

    What `jax.jit` made of a function is the ``__wrapped__`` of the decorated one.
    """

    def compiled(function: Callable[..., R]) -> Callable[..., R]:
        program = jax.jit(function, **options)

        @wraps(program)
        def call(*args: Any, **kwargs: Any) -> R:
            # Looked at first: to enter a context takes as long as to call a small program.
            same = (getattr(jax.config, name) == value for name, (value, _) in SWITCHES.items())
            with nullcontext() if all(same) else switches():
                found: R = program(*args, **kwargs)
            return found

        return call

    return compiled


def key(seed: int | Array) -> Array:
    """The random key of a seed below 2^32, bit for bit ``jax.random.key(seed)`` by JAX's defaults.

    Not by that function, which adds ``jax_random_seed_offset``.
    """
    words = jnp.stack([jnp.uint32(0), jnp.asarray(seed, jnp.uint32)])
    made: Array = jax.random.wrap_key_data(words, impl=GENERATOR)
    return made


def own(given: Array) -> Array:
    """A user's random key as one of Lanewise's; of another generator the first 64 bits count."""
    if not jnp.issubdtype(given.dtype, jax.dtypes.prng_key):
        words = given
    elif str(jax.random.key_impl(given)) == GENERATOR:
        return given
    else:
        words = jax.random.key_data(given)
    made: Array = jax.random.wrap_key_data(words[..., :2], impl=GENERATOR)
    return made
