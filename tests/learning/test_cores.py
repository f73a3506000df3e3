"""Updates are the same to the bit on any number of cores.

Left to XLA, some sizes are not, others on each processor: on an AMD EPYC the weights of the first
two, on an Intel Xeon weights and biases of the others.
"""

import os
import subprocess
import sys

import pytest

UPDATES = """
import hashlib, sys
import jax, jax.numpy as jnp, numpy as np
from lanewise.learning import learner
from lanewise.learning.replay import Transition
from lanewise.learning.settings import LearnerSettings
rng = np.random.default_rng(0)
SIZES = (
    (64, (512, 512)), (128, (128, 128)), (128, (512, 512)), (256, (512, 512)), (64, (1024,))
)
for batch_size, hidden in SIZES:
    settings = LearnerSettings(batch_size=batch_size, hidden=hidden)
    def normal(*shape):
        return jnp.asarray(rng.normal(size=shape), jnp.float32)
    batch = Transition(
        features=normal(batch_size, 28),
        action=jnp.asarray(rng.integers(9, size=batch_size), jnp.int32),
        reward=normal(batch_size),
        discount=jnp.full(batch_size, 0.8, jnp.float32),
        next_features=normal(batch_size, 28),
    )
    state = learner.begin(jax.random.key(0), settings, 28, 9)
    update = jax.jit(learner.update, static_argnums=0)
    for _ in range(3):
        state, metrics = update(settings, state, batch)
    leaves = jax.tree.leaves((state, metrics))
    bits = b"".join(np.asarray(leaf).tobytes() for leaf in leaves)
    print(hashlib.sha256(bits).hexdigest())
"""


def updated(threads):
    """What three updates lead to in a process whose XLA takes the machine to have such cores."""
    environment = os.environ | {"NPROC": str(threads)}
    environment.pop("JAX_COMPILATION_CACHE_DIR", None)
    command = [sys.executable, "-c", UPDATES]
    return subprocess.run(
        command, env=environment, capture_output=True, text=True, check=True
    ).stdout


@pytest.mark.parametrize("threads", [pytest.param(2, marks=pytest.mark.slow), 8])
def test_updates_do_not_depend_on_the_number_of_threads(threads, alone):
    assert updated(threads) == alone


@pytest.fixture(scope="module")
def alone():
    return updated(1)
