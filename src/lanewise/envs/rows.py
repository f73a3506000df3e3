"""What a step shows as one row of numbers, so that one fetch brings it to NumPy."""

from typing import Any

import jax.numpy as jnp
import numpy as np
from jax import Array
from numpy.typing import NDArray

from lanewise.envs.functional import Step

FACTS = (
    ("reward", np.float64),
    ("terminated", np.bool_),
    ("truncated", np.bool_),
    ("escaped", np.bool_),
    ("is_success", np.bool_),
    ("accident", np.int64),
    ("speed", np.float64),
    ("timestep_reward", np.float64),
)
"""What stands behind the observation, and as what it is handed on."""
INFO = tuple(name for name, _ in FACTS[3:])
"""Of these, what stands in ``info``."""


def pack(step: Step) -> Array:
    """One row, float32 [n + 8]."""
    facts = (
        *(step.reward, step.terminated, step.truncated),
        *(step.escaped, step.success, step.accident, step.speed, step.timestep_reward),
    )
    return jnp.concatenate([step.observation, jnp.stack([jnp.float32(fact) for fact in facts])])


def unpack(rows: Any) -> tuple[NDArray[np.float32], dict[str, NDArray[Any]]]:
    """(observations [..., n], the facts by name [...]) of rows [..., n + 8]."""
    fetched = np.asarray(rows)
    size = fetched.shape[-1] - len(FACTS)
    facts: dict[str, NDArray[Any]] = {
        name: fetched[..., size + place].astype(dtype) for place, (name, dtype) in enumerate(FACTS)
    }
    # A copy, as the fetched array cannot be written to.
    return fetched[..., :size].copy(), facts
