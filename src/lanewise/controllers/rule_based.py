"""The rule-based driver as ego: IDM along the road and MOBIL across it, as all traffic drives.

A reference that needs no training. The world itself drives it (`TrapSettings.ego_driver`); the
controller only looks on.
"""

from dataclasses import dataclass
from typing import Any

import jax.numpy as jnp
from jax import Array

from lanewise.controllers.controller import Feedback
from lanewise.driving import actions
from lanewise.driving.percept import Percept


@dataclass(frozen=True)
class RuleBased:
    """No network, no goal, nothing to decide."""

    name: str = "rule-based"
    levels: tuple[()] = ()

    @classmethod
    def from_settings(cls, settings: Any, *, name: str, renewal: str, observed: int) -> "RuleBased":
        """Makes it from a run's settings, see `lanewise.controllers.registry.make`."""
        return cls()

    def start(self, percept: Percept) -> tuple[()]:
        """Nothing to remember."""
        return ()

    def perceive(self, memory: tuple[()], percept: Percept) -> tuple[()]:
        """Nothing to take in."""
        return memory

    def act(self, memory: tuple[()], percept: Percept) -> tuple[Array, tuple[()]]:
        """No command; a rule-based vehicle would not heed one."""
        return jnp.int32(actions.IDLE), memory

    def feedback(self, memory: tuple[()], percept: Percept) -> Feedback:
        """No goal, no distance from it."""
        return Feedback(distance=jnp.zeros_like(percept.speed), reached=jnp.asarray(False))

    def goal(self, memory: tuple[()]) -> None:
        """It has none."""
