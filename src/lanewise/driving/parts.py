"""What of the decision process may be replaced by a user's functions."""

from collections.abc import Callable
from dataclasses import dataclass, fields
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
from jax import Array

from lanewise import pinned
from lanewise.driving import observation, reward
from lanewise.driving.settings import DrivingSettings, ObservationSettings, RewardSettings
from lanewise.errors import LanewiseError, SettingsError
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

    @pinned.switches()
    def try_out(self, scenario: TrapSettings, driving: DrivingSettings) -> int:
        """Try the user's own functions, each traced alone: a mistake shows at once, under its name.

        Returns:
            Length of what the controller sees.

        Raises:
            SettingsError: one of them fails, or returns something else than it must.
        """
        if not self.names():
            return observation.SIZE
        world = self._tried(
            "start", lambda key: self.start(scenario, key, "training"), pinned.key(0)
        )
        if not isinstance(world, World):
            raise SettingsError(f"{self._called('start')} must return a World, not {_kind(world)}")
        seen = self._tried("observe", partial(self.observe, driving.observation), world)
        if not (_is_array(seen) and seen.ndim == 1 and seen.dtype == jnp.float32):
            raise SettingsError(
                f"{self._called('observe')} must return a float32 vector, not {_kind(seen)}"
            )
        yes = jax.ShapeDtypeStruct((), jnp.bool_)  # type: ignore[no-untyped-call]
        angle = jax.ShapeDtypeStruct((), world.vehicles.x.dtype)  # type: ignore[no-untyped-call]
        paid = self._tried("reward", partial(self.reward, driving.reward), world, angle, yes)
        if not (_is_array(paid) and paid.ndim == 0 and jnp.issubdtype(paid.dtype, jnp.number)):
            raise SettingsError(
                f"{self._called('reward')} must return one number, not {_kind(paid)}"
            )
        escaped = self._tried("success", self.success, world)
        if not (_is_array(escaped) and escaped.ndim == 0 and escaped.dtype == jnp.bool_):
            raise SettingsError(
                f"{self._called('success')} must return one bool, not {_kind(escaped)}"
            )
        return int(seen.shape[0])

    def _tried(self, part: str, call: Callable[..., Any], *traced: Any) -> Any:
        """What a function returns, as shapes."""
        try:
            return jax.eval_shape(call, *traced)
        except LanewiseError:
            raise
        except Exception as error:
            reason = str(error).strip().partition("\n")[0][:200]
            if isinstance(error, jax.errors.ConcretizationTypeError):
                reason = "it asks for a value while JAX traces it; use jnp.where instead of if"
            raise SettingsError(f"{self._called(part)} fails: {reason}") from error

    def _called(self, part: str) -> str:
        function = getattr(self, part)
        return f"{part}: {getattr(function, '__qualname__', repr(function))}"


def _is_array(value: Any) -> bool:
    return isinstance(value, jax.ShapeDtypeStruct)


def _kind(value: Any) -> str:
    """A value for people: its type, for an array its numbers and shape."""
    if _is_array(value):
        return f"{value.dtype} of shape {tuple(value.shape)}"
    return f"a {type(value).__name__}"


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
