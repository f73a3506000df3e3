"""What every controller is: levels that choose one after the other, and the action they lead to.

A *level* is a network with its place in the controller: when it chooses, what it observes, and what
its choice does to the controller's memory. Everything else (goals, the goal critic, a planner)
stands in memory and functions. Which levels learn, and how they explore, belongs to training;
`act` is the greedy controller that tests drive.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Protocol

import jax
import jax.numpy as jnp
from jax import Array

from lanewise.controllers.goal_critic import GoalMemory
from lanewise.driving.percept import Percept
from lanewise.learning import network

Parameters = dict[str, network.Parameters]
"""Network parameters by level: ``single_level``, ``high_level``, ``low_level``."""
Memory = Any
"""A controller's own pytree, carried from decision to decision."""


class Level(Protocol):
    """One network of a controller, written for one world."""

    @property
    def name(self) -> str:
        """Its key in `Parameters`."""

    @property
    def feature_count(self) -> int:
        """Inputs of the network."""

    @property
    def choice_count(self) -> int:
        """Outputs of the network."""

    def ready(self, memory: Memory) -> Array:
        """Whether the network is to choose now; bool []."""

    def features(self, memory: Memory, percept: Percept) -> Array:
        """What the network observes, [feature_count], once the levels above have chosen."""

    def choose(self, memory: Memory, percept: Percept, choice: Array) -> Memory:
        """Take in the network's choice, int32 []; without effect where it was not ready."""


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Feedback:
    """What a decision did for the goal it was made under; zeros for a controller without goals."""

    distance: Array
    """[] |delta_d| / 4 m + |delta_v| / 2 m/s, the tracking term of row 21 of the reading."""
    reached: Array
    """bool [] whether the goal is reached now."""


class Controller(Protocol):
    """A driver of the ego, written for one world."""

    @property
    def name(self) -> str:
        """Its name in tables and on disk."""

    @property
    def levels(self) -> Sequence[Level]:
        """Its levels, in the order in which they choose; none for a driver without networks."""

    def start(self, percept: Percept) -> Memory:
        """The memory before the first decision of an episode."""

    def perceive(self, memory: Memory, percept: Percept) -> Memory:
        """Take in what the last decision led to; called once before each decision."""

    def act(self, memory: Memory, percept: Percept) -> tuple[Array, Memory]:
        """(int32 [] low-level action, the memory afterwards), once every level has chosen."""

    def feedback(self, memory: Memory, percept: Percept) -> Feedback:
        """What the last decision did for the goal, called before `perceive`."""

    def goal(self, memory: Memory) -> GoalMemory | None:
        """The goal under way, None for a controller without goals."""


class WithoutGoals:
    """What controllers without goals have in common."""

    def perceive(self, memory: Memory, percept: Percept) -> Memory:
        """Nothing to take in."""
        return memory

    def feedback(self, memory: Memory, percept: Percept) -> Feedback:
        """No distance from a goal."""
        return Feedback(distance=jnp.zeros_like(percept.speed), reached=jnp.asarray(False))

    def goal(self, memory: Memory) -> None:
        """It has none."""


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Trace:
    """Why a level did what it did."""

    values: Array
    """[choice_count] Q-values."""
    choice: Array
    """int32 [] the greedy choice."""
    ready: Array
    """bool [] whether the choice counted."""


def choose(
    level: Level, parameters: Parameters, memory: Memory, percept: Percept
) -> tuple[Memory, Trace]:
    """The greedy choice of one level: (the memory afterwards, the trace)."""
    values = network.q_values(parameters[level.name], level.features(memory, percept))
    choice = jnp.argmax(values).astype(jnp.int32)
    trace = Trace(values=values, choice=choice, ready=level.ready(memory))
    return level.choose(memory, percept, choice), trace


def act(
    controller: Controller, parameters: Parameters, memory: Memory, percept: Percept
) -> tuple[Array, Memory, dict[str, Trace]]:
    """(int32 [] low-level action, the memory afterwards, a trace by level) of a greedy decision."""
    memory = controller.perceive(memory, percept)
    traces = {}
    for level in controller.levels:
        memory, traces[level.name] = choose(level, parameters, memory, percept)
    action, memory = controller.act(memory, percept)
    return action, memory, traces
