"""The single-level controller: one network from the 26 features to the nine actions."""

from dataclasses import dataclass, replace
from typing import Any, Self

import jax
import jax.numpy as jnp
from jax import Array

from lanewise.controllers.controller import WithoutGoals
from lanewise.driving import actions, observation
from lanewise.driving.percept import Percept


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class HeldAction:
    """What the single-level controller remembers."""

    action: Array
    """int32 [] the action being held."""
    age: Array
    """int32 [] decisions for which it has been held; 0 when a new one is due."""


@dataclass(frozen=True)
class FlatLevel:
    """The one level, which chooses among the nine actions."""

    name: str = "single_level"
    feature_count: int = observation.SIZE
    choice_count: int = actions.COUNT

    def ready(self, memory: HeldAction) -> Array:
        """When the held action is over."""
        return memory.age == 0

    def features(self, memory: HeldAction, percept: Percept) -> Array:
        """The observation, [26]."""
        return percept.features

    def choose(self, memory: HeldAction, percept: Percept, choice: Array) -> HeldAction:
        """The choice is the low-level action, from now on."""
        return replace(memory, action=jnp.where(memory.age == 0, choice, memory.action))


@dataclass(frozen=True)
class SingleLevel(WithoutGoals):
    """The flat twin of the hierarchical controller."""

    hold: int = 1
    """Decisions for which a choice is held."""
    name: str = "single-level"
    observed: int = observation.SIZE
    """Features observed."""

    @classmethod
    def from_settings(cls, settings: Any, *, name: str, renewal: str, observed: int) -> Self:
        """See `registry.make`."""
        return cls(settings.single_level.hold, observed=observed)

    @property
    def levels(self) -> tuple[FlatLevel]:
        """The one."""
        return (FlatLevel(feature_count=self.observed),)

    def start(self, percept: Percept) -> HeldAction:
        """A choice is due."""
        return HeldAction(action=jnp.int32(0), age=jnp.int32(0))

    def act(self, memory: HeldAction, percept: Percept) -> tuple[Array, HeldAction]:
        """The held action."""
        return memory.action, replace(memory, age=(memory.age + 1) % self.hold)
