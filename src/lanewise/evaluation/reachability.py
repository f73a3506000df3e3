"""Can a start of the trap be won at all? A search over the nine actions, without other traffic.

Narrow searches find an escape where one is easy to find; where they fail, every sequence of actions
is followed. A start is unwinnable only where none of them is an escape.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from numpy.typing import NDArray

from lanewise.driving import actions, episode
from lanewise.driving.episode import Episode
from lanewise.driving.settings import DrivingSettings
from lanewise.evaluation import escapes
from lanewise.evaluation.escapes import Layer, ReachabilityConfig
from lanewise.scenario.trap import Start
from lanewise.system import pinned
from lanewise.world.state import World

KNOWN = 32
"""Escapes of other starts that are tried before any search."""
Decided = tuple[Episode, Array]
"""An episode, and whether it has failed by now."""


@dataclass(frozen=True)
class Verdict:
    """Whether a start can be won, and how that is known."""

    winnable: bool
    """False only where the whole reachable set holds no escape."""
    actions: tuple[int, ...]
    """An escape, one action a decision, confirmed in the world; empty if none was found."""
    states: int
    """States visited by the exhaustive search; 0 where none was needed."""

    @property
    def decided(self) -> bool:
        """False where the search was given up; the start then counts as winnable."""
        return bool(self.actions) or not self.winnable


def judge(
    config: ReachabilityConfig, start: Start, known: Sequence[tuple[int, ...]] = ()
) -> Verdict:
    """Whether the ego can be past the trap and have no accident within the config's duration.

    Of ``known``, escapes of other starts and the most promising first, the first `KNOWN` are tried.
    The traffic of ``start`` does not matter.
    """
    for escape, holds in zip(known, replay(config, start, known[:KNOWN]), strict=False):
        if holds:
            return Verdict(True, escape, 0)
    world = escapes.begin(config, start)
    for width in escapes.WIDTHS:
        layers, _ = escapes.search(config, world, width)
        if escape := _confirmed(config, start, layers):
            return Verdict(True, escape, 0)
    layers, whole = escapes.search(config, world, None)
    states = sum(len(layer.egos) for layer in layers[1:])
    return Verdict(not whole, () if whole else _confirmed(config, start, layers), states)


def replay(
    config: ReachabilityConfig, start: Start, sequences: Sequence[tuple[int, ...]]
) -> NDArray[np.bool_]:
    """Which of at most `KNOWN` action sequences, each of the config's duration, are escapes.

    They are driven in the world as any test episode is: past the trap at the end of some decision,
    and no accident.
    """
    if not sequences:
        return np.zeros(0, bool)
    padded = np.full((KNOWN, config.duration), actions.IDLE, np.int32)
    padded[: len(sequences)] = sequences
    world = escapes.begin(config, start)
    escaped: NDArray[np.bool_] = np.asarray(_replay(config.driving, world, padded))
    return escaped[: len(sequences)]


@pinned.jit(static_argnums=0)
def _replay(driving: DrivingSettings, world: World, sequences: Array) -> Array:
    """Whether each of [B, T] actions is an escape, [B]."""

    def drive(chosen: Array) -> Array:
        def decide(before: Decided, action: Array) -> tuple[Decided, None]:
            after = episode.step(driving, before[0], action, chosen.size)
            return (after, before[1] | after.outcome.terminated), None

        (after, failed), _ = jax.lax.scan(decide, (episode.begin(world), jnp.bool_(False)), chosen)
        won: Array = after.stats.escaped & ~failed
        return won

    return jax.vmap(drive)(sequences)


def _confirmed(
    config: ReachabilityConfig, start: Start, layers: Sequence[Layer]
) -> tuple[int, ...]:
    """The actions that led to the first escaped state of the last layer, if they hold."""
    won = np.flatnonzero(layers[-1].escaped)
    if len(layers) <= config.duration or not len(won):
        return ()
    state, backwards = int(won[0]), []
    for layer in reversed(layers[1:]):
        backwards.append(int(layer.action[state]))
        state = int(layer.parent[state])
    escape = tuple(reversed(backwards))
    return escape if replay(config, start, [escape])[0] else ()
