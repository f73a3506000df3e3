"""What every controller is: a few pure functions that training and evaluation compose.

A controller has one *learning network*, from features to the values of its choices. Everything
else about it (goals, a frozen level above, a planner below) stands in its memory and functions.
Exploration belongs to training; `act` is the greedy controller that tests drive.
"""

from dataclasses import dataclass
from typing import Any, Protocol

import jax
import jax.numpy as jnp
from jax import Array

from lanewise.driving.percept import Percept
from lanewise.learning import network

Parameters = dict[str, network.Parameters]
"""Network parameters by level: ``single_level``, ``high_level``, ``low_level``."""
Memory = Any
"""A controller's own pytree, carried from decision to decision."""


class Controller(Protocol):
    """A driver of the ego, written for one world."""

    @property
    def name(self) -> str:
        """Its name in tables and on disk."""

    @property
    def learns(self) -> str:
        """Key of the learning network in `Parameters`."""

    @property
    def feature_count(self) -> int:
        """Inputs of the learning network."""

    @property
    def choice_count(self) -> int:
        """Outputs of the learning network."""

    def start(self, parameters: Parameters, percept: Percept) -> Memory:
        """The memory before the first decision of an episode."""

    def perceive(self, parameters: Parameters, memory: Memory, percept: Percept) -> Memory:
        """Take in what the last decision led to; called once before each decision."""

    def ready(self, memory: Memory) -> Array:
        """Whether the learning network is to choose now; bool []."""

    def features(self, memory: Memory, percept: Percept) -> Array:
        """What the learning network sees, [feature_count]."""

    def decide(self, memory: Memory, percept: Percept, choice: Array) -> tuple[Array, Memory]:
        """Turn the network's choice into a low-level action.

        Where the network was not ready, the choice is ignored.
        """

    def penalty(self, memory: Memory, percept: Percept) -> Array:
        """How far from its goal the ego is after a decision, for the tracking term; []."""


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Trace:
    """Why a controller did what it did."""

    values: Array
    """[choice_count] Q-values of the learning network."""
    choice: Array
    """int32 [] its greedy choice."""
    ready: Array
    """bool [] whether the choice counted."""


def act(
    controller: Controller, parameters: Parameters, memory: Memory, percept: Percept
) -> tuple[Array, Memory, Trace]:
    """The greedy decision: perceive, choose the best value, decide.

    Returns:
        (int32 [] low-level action, the memory afterwards, the trace).
    """
    memory = controller.perceive(parameters, memory, percept)
    values = network.q_values(parameters[controller.learns], controller.features(memory, percept))
    choice = jnp.argmax(values).astype(jnp.int32)
    trace = Trace(values=values, choice=choice, ready=controller.ready(memory))
    action, memory = controller.decide(memory, percept, choice)
    return action, memory, trace
