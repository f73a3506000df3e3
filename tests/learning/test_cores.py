"""Gradients are the same to the bit on any number of cores.

Left to XLA, some sizes are not, others on each processor: on an AMD EPYC the weights of the first
two, on an Intel Xeon weights and biases of the others.
"""

import os
import subprocess
import sys

GRADIENTS = """
import hashlib, jax, numpy as np
from lanewise.learning import network
rng = np.random.default_rng(0)
SIZES = (
    (64, (512, 512)), (128, (128, 128)), (128, (512, 512)), (256, (512, 512)), (64, (1024,))
)
for batch_size, hidden in SIZES:
    def normal(*shape):
        return rng.normal(size=shape).astype(np.float32)
    widths = (28, *hidden, 9)
    parameters = tuple((normal(i, o), normal(o)) for i, o in zip(widths, widths[1:]))
    def loss(parameters, features, delta):
        return (network.q_values(parameters, features) * delta).sum()
    gradient = jax.jit(jax.grad(loss))(parameters, normal(batch_size, 28), normal(batch_size, 9))
    bits = b"".join(np.asarray(leaf).tobytes() for leaf in jax.tree.leaves(gradient))
    print(hashlib.sha256(bits).hexdigest())
"""


def gradients(threads):
    """Their digests in a process whose XLA takes the machine to have such cores."""
    environment = os.environ | {"NPROC": str(threads)}
    for name in ("JAX_COMPILATION_CACHE_DIR", "JAX_DISABLE_MOST_OPTIMIZATIONS"):
        environment.pop(name, None)
    command = [sys.executable, "-c", GRADIENTS]
    return subprocess.run(
        command, env=environment, capture_output=True, text=True, check=True
    ).stdout


def test_gradients_do_not_depend_on_the_number_of_threads():
    alone = gradients(1)
    assert len(set(alone.split())) == 5
    assert gradients(8) == alone
