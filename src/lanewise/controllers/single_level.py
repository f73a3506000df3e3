"""The single-level controller: one network from the 26 features to the nine actions."""

from dataclasses import dataclass

import jax.numpy as jnp
from jax import Array

from lanewise.controllers.controller import Parameters
from lanewise.driving import actions, observation
from lanewise.driving.percept import Percept


@dataclass(frozen=True)
class SingleLevel:
    """The flat twin of the hierarchical controller; it remembers nothing."""

    name: str = "single-level"
    learns: str = "single_level"
    feature_count: int = observation.SIZE
    choice_count: int = actions.COUNT

    def start(self, parameters: Parameters, percept: Percept) -> tuple[()]:
        """Nothing to remember."""
        return ()

    def perceive(self, parameters: Parameters, memory: tuple[()], percept: Percept) -> tuple[()]:
        """Nothing to take in."""
        return memory

    def ready(self, memory: tuple[()]) -> Array:
        """The network chooses at every decision."""
        return jnp.asarray(True)

    def features(self, memory: tuple[()], percept: Percept) -> Array:
        """The observation, [26]."""
        return percept.features

    def decide(self, memory: tuple[()], percept: Percept, choice: Array) -> tuple[Array, tuple[()]]:
        """The choice is the low-level action."""
        return choice, memory

    def penalty(self, memory: tuple[()], percept: Percept) -> Array:
        """No goal, no distance from it."""
        return jnp.zeros_like(percept.speed)
