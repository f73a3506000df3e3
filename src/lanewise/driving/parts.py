"""What of the decision process may be replaced by a user's functions."""

from collections.abc import Callable
from dataclasses import dataclass, fields
from typing import Any

import jax
import jax.numpy as jnp
from jax import Array

from lanewise.driving import observation, reward
from lanewise.driving.settings import ObservationSettings, RewardSettings
from lanewise.errors import SettingsError
from lanewise.scenario import trap
from lanewise.scenario.settings import TrapSettings
from lanewise.world.state import World


@dataclass(frozen=True)
class Parts:
    """How an episode starts, and what is seen, paid and counted as success. Static.

    Each is a pure function written for one world, to be traced by JAX. Functions are compared by
    identity: name them once, at a module's top, and programs compiled with them are found again.
    """

    start: Callable[[TrapSettings, Array, str], World] = trap.sample
    """(scenario, random key, split) to the world at the start; the number of vehicles and lanes
    must be the same for every key. Vehicle 0 is the ego, 1 and 2 are the trap cars."""
    observe: Callable[[ObservationSettings, World], Array] = observation.features
    """(settings, world) to what the controller sees, float32 [n]."""
    reward: Callable[[RewardSettings, World, Array, Array], Array] = reward.of_decision
    """(settings, world after a decision, steering angle in rad, bool [] whether an accident ended
    it) to the reward of the decision, []."""
    success: Callable[[World], Array] = trap.escaped
    """World after a decision to whether the episode has succeeded by now, bool []; once true it
    stays so, and an accident takes it away."""

    def names(self) -> tuple[str, ...]:
        """Which are a user's own, and what they are called there: ``reward: mine.hurry``."""
        return tuple(
            f"{part.name}: {own.__module__}.{own.__qualname__}"
            for part in fields(self)
            if (own := getattr(self, part.name)) is not part.default
        )

    def feature_count(self, scenario: TrapSettings, settings: ObservationSettings) -> int:
        """Length of what the controller sees.

        Raises:
            SettingsError: a user's own observation is no float32 vector.
        """
        if self.observe is observation.features:
            return observation.SIZE
        seen = jax.eval_shape(
            lambda key: self.observe(settings, self.start(scenario, key, "training")),
            jax.random.key(0),
        )
        if seen.ndim != 1 or seen.dtype != jnp.float32:
            raise SettingsError(
                f"an observation must be a float32 vector; {self.observe.__qualname__} returns "
                f"{seen.dtype} of shape {seen.shape}"
            )
        return int(seen.shape[0])


OURS = Parts()
"""The paper's."""


def checked(parts: Any) -> Parts:
    """Parts that a user gave.

    Raises:
        SettingsError: they are something else.
    """
    if not isinstance(parts, Parts):
        raise SettingsError(f"parts: expected lanewise.Parts(...), got {str(parts)[:80]}")
    return parts
