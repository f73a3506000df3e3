"""The same seed gives the same bytes whatever JAX's switches say, and leaves them as they were."""

import re
from contextlib import ExitStack, contextmanager
from pathlib import Path

import gymnasium
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import lanewise
from lanewise.envs import functional
from lanewise.scenario import trap
from lanewise.system import pinned

NO_TRAFFIC = {"vehicles_ahead": 0}


@contextmanager
def seed_offset(number):
    jax.config.update("jax_random_seed_offset", number)
    try:
        yield
    finally:
        jax.config.update("jax_random_seed_offset", 0)


SWITCHES = {
    "jax_enable_x64": lambda: jax.enable_x64(True),
    "jax_threefry_partitionable": lambda: jax.threefry_partitionable(False),
    "jax_default_prng_impl": lambda: jax.default_prng_impl("rbg"),
    "jax_random_seed_offset": lambda: seed_offset(7),
    "jax_numpy_dtype_promotion": lambda: jax.numpy_dtype_promotion("strict"),
    "jax_numpy_rank_promotion": lambda: jax.numpy_rank_promotion("raise"),
    "jax_default_matmul_precision": lambda: jax.default_matmul_precision("bfloat16"),
    "jax_debug_key_reuse": lambda: jax.debug_key_reuse(True),
    "jax_disable_jit": lambda: jax.disable_jit(True),
}


@pinned.jit()
def computed(seed):
    """Something of each kind that a switch changes: keys, draws, types, shapes, products."""
    key = pinned.key(seed)
    drawn = jax.random.normal(key, (3, 4)) + jax.random.normal(key, (3, 4))
    assert jnp.zeros(()).dtype == jnp.float32
    return drawn @ drawn.T + jnp.arange(3) * seed


def small():
    return np.asarray(computed(jnp.int32(3)))


def started():
    return np.asarray(jax.random.key_data(trap.start_key(11, "test", 4)))


def single():
    env = gymnasium.make("lanewise:lanewise/TrapContinuous-v0", **NO_TRAFFIC)
    shown = [env.reset(seed=3)[0]]
    for action in ([0.0, 0.3], [1.0, -0.5]):
        observation, reward, *_ = env.step(np.array(action))
        shown += [observation, np.array([reward])]
    return np.concatenate(shown)


def several():
    env = gymnasium.make_vec("lanewise:lanewise/Trap-v0", num_envs=2, **NO_TRAFFIC)
    shown = [env.reset(seed=3)[0].ravel()]
    for action in (4, 8):
        observations, rewards, *_ = env.step(np.array([action, 4]))
        shown += [observations.ravel(), rewards]
    return np.concatenate(shown)


def pure():
    task = functional.make(**NO_TRAFFIC)
    # The caller's own key; an offset is the caller's too.
    state, shown = functional.reset(task, jax.random.key(5 - jax.config.jax_random_seed_offset))
    state, after = functional.step(task, state, jnp.asarray(8))
    looped = jax.jit(lambda state: functional.step(task, state, jnp.asarray(7)))(state)[1]
    return np.concatenate([shown.observation, after.observation, looped.observation])


def check(names, finders):
    """What is found with these switches is what is found without."""
    expected = {find: find() for find in finders}
    with ExitStack() as switched:
        for name in names:
            switched.enter_context(SWITCHES[name]())
        before = dict(jax.config.values)
        found = {find: find() for find in expected}
        assert dict(jax.config.values) == before
        for find, numbers in expected.items():
            assert found[find].dtype == numbers.dtype
            np.testing.assert_array_equal(found[find], numbers, err_msg=find.__name__)


@pytest.mark.parametrize("name", SWITCHES)
def test_a_switch_of_jax_changes_nothing(name):
    check([name], (small, started))


def test_every_program_is_compiled_by_pinned():
    """So that what holds for a small one holds for all; but for benchmarks, and what `pinned`
    code alone calls.
    """
    package = Path(lanewise.__file__).parent
    sources = {path.relative_to(package): path.read_text() for path in package.rglob("*.py")}
    compiling = {str(path) for path, text in sources.items() if re.search(r"\bjax\.jit\b", text)}
    assert sum("pinned.jit" in text for text in sources.values()) > 5
    called = {"driving/task_functions.py", "world/materialize.py"}
    assert compiling == {"system/pinned.py", "bench/workloads.py", *called}


@pytest.mark.slow
def test_all_switches_together_change_nothing_in_what_users_call():
    """Without the one by which nothing is compiled."""
    names = [name for name in SWITCHES if name != "jax_disable_jit"]
    check(names, (single, several, pure))


@pytest.mark.slow
def test_what_users_call_is_the_same_where_nothing_is_compiled():
    check(["jax_disable_jit"], (single, several, pure))
