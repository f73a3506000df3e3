"""What goes in and out of Gymnasium's environments: spaces, actions, and rows of numbers.

What a step shows is packed into one row, so that one fetch brings it to NumPy.
"""

from dataclasses import fields
from typing import Any

import jax.numpy as jnp
import numpy as np
from gymnasium.spaces import Box, Discrete, Space
from jax import Array
from numpy.typing import NDArray

from lanewise.driving.task_functions import PAPER_TASK
from lanewise.envs.control import EnvConfig
from lanewise.envs.functional import Step
from lanewise.system import pinned

FACTS = (
    ("reward", np.float64),
    ("terminated", np.bool_),
    ("truncated", np.bool_),
    ("escaped", np.bool_),
    ("is_success", np.bool_),
    ("accident", np.int64),
    ("speed", np.float64),
    ("timestep_reward", np.float64),
    ("lane", np.int64),
    ("gap_ahead", np.float64),
    ("time_to_collision", np.float64),
)
"""What stands behind the observation, in the order of `Step`, and as what it is handed on."""
INFO = tuple(name for name, _ in FACTS[3:])
"""Of these, what stands in ``info``."""


def of_actions(config: EnvConfig) -> Discrete | Box:
    """What `functional.step` takes."""
    count = config.control.count
    return Discrete(count) if count else Box(-1.0, 1.0, (2,), np.float32)


@pinned.switches()
def of_observations(config: EnvConfig) -> Space[NDArray[np.float32]]:
    """What `functional.step` shows; under noise, or seen by a user's function, without limits."""
    limit, seen = np.inf, config.driving.observation
    if config.task.observe is PAPER_TASK.observe and not any(
        seen.noise_range(training)[1] for training in (False, True)
    ):
        limit = seen.limit
    size = config.task.validate(config.scenario, config.driving)
    box: Any = Box(-limit, limit, (size,), np.float32)
    return box  # type: ignore[no-any-return]


def pack(step: Step) -> Array:
    """One row, float32 [n + 11]."""
    facts = [jnp.float32(getattr(step, field.name)) for field in fields(step)[1:]]
    return jnp.concatenate([step.observation, jnp.stack(facts)])


def unpack(rows: Any) -> tuple[NDArray[np.float32], dict[str, NDArray[Any]]]:
    """(observations [..., n], the facts by name [...]) of rows [..., n + 11]."""
    fetched = np.asarray(rows)
    size = fetched.shape[-1] - len(FACTS)
    facts: dict[str, NDArray[Any]] = {
        name: fetched[..., size + place].astype(dtype) for place, (name, dtype) in enumerate(FACTS)
    }
    # A copy, as the fetched array cannot be written to.
    return fetched[..., :size].copy(), facts
