"""Settings of tests. Imports no JAX."""

from dataclasses import dataclass
from typing import Annotated

from lanewise.fields.ranges import Between

WORLDS = ("lanewise", "highway-env")
"""Where a controller can be tested: in our world, or in the real highway-env."""


@dataclass(frozen=True)
class EvaluationSettings:
    """How a controller is tested."""

    duration: Annotated[int, Between(1, 100_000, "s")] = 25
    """Length of a test episode, simulated; rounded up to decisions."""
    validation_episodes: Annotated[int, Between(1, 100_000)] = 200
    """Greedy episodes on validation starts by which weights are chosen."""
    validation_interval: Annotated[int, Between(1, 1_000_000)] = 2
    """Chunks of training between validations."""
    fresh_episodes: Annotated[int, Between(1, 100_000)] = 1_000
    """Greedy episodes on validation starts by which no weights were chosen: the kept and the last
    weights of each stage drive them when it is over."""
