"""Random driving in the trap: the work that the world is measured by, and its starts for others.

World w begins with start w of a seed; its next ones are w + worlds, w + 2 worlds and so on. An
action depends on the seed, the start and the decision alone, so that the same start meets the same
actions in any world, in any batch, in ours and in highway-env.
"""

from dataclasses import dataclass, field
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from lanewise.driving import episode, percept, restart
from lanewise.driving.episode import Episode
from lanewise.driving.settings import DrivingSettings
from lanewise.scenario import trap
from lanewise.scenario.settings import TrafficSettings, TrapSettings
from lanewise.world.state import World

CHUNK = 50
"""Decisions in a compiled call."""
ACTION_STREAM = 3
"""Random stream of the actions; the splits of the starts have 0 to 2."""
TRAPPERS = 3
"""The ego and the two trap cars; all others are traffic."""
ENDINGS = ("collision", "off_road", "stopped", "truncated")
"""How an episode ends, by code from 1; the accidents' are those of `driving.accidents`."""
TRUNCATED = len(ENDINGS)

Batch = tuple[Episode, Array, Array]
"""Worlds under way: their episodes, the number of the start of each, what each observes."""


@dataclass(frozen=True)
class Drive:
    """What is driven. Static."""

    vehicles: int = 12
    """In each world, with the ego."""
    lanes: int = 3
    duration: int = 50
    """Decisions after which an episode is truncated: 25 s."""
    driving: DrivingSettings = field(default_factory=DrivingSettings)

    @property
    def scenario(self) -> TrapSettings:
        """The trap with that many vehicles, all traffic ahead."""
        traffic = TrafficSettings(vehicles_ahead=self.vehicles - TRAPPERS)
        return TrapSettings(lanes=self.lanes, traffic=traffic)


def begin(drive: Drive, seed: int, worlds: int) -> Batch:
    """Every world at its first start."""
    return jax.vmap(partial(fresh, drive, seed))(jnp.arange(worlds))


def chunk(drive: Drive, seed: int, batch: Batch) -> tuple[Batch, Array]:
    """`CHUNK` decisions in every world: (batch, [5] episodes by code of their ending).

    Observations and fresh starts are part of it.
    """
    worlds = batch[1].shape[0]

    def one(before: Batch, _: None) -> tuple[Batch, Array]:
        after, ended = jax.vmap(partial(decide, drive, seed))(*before)
        index = after[1]

        def anew(over: Array) -> Batch:
            return jax.vmap(partial(fresh, drive, seed))(index[over] + worlds)

        return restart.where(ended.any(1), after, anew), ended.sum(0)

    batch, ended = jax.lax.scan(one, batch, length=CHUNK)
    return batch, ended.sum(0)


def decide(
    drive: Drive, seed: int, before: Episode, index: Array, _features: Array
) -> tuple[Batch, Array]:
    """One decision in one world: (the world, bool [5] whether and how its episode ended)."""
    action = action_of(seed, index, before.decisions)
    after, outcome = episode.step(drive.driving, before, action, drive.duration)
    features = percept.of(drive.driving.observation, after.world).features
    code = jnp.where(outcome.truncated, TRUNCATED, outcome.accident)
    done = outcome.terminated | outcome.truncated
    return (after, index, features), (jnp.arange(TRUNCATED + 1) == code) & done


def endings(drive: Drive, seed: int, count: int) -> Any:
    """[count] codes of the endings of starts 0 to ``count - 1``."""

    def ending(index: Array) -> Array:
        def one(carry: tuple[Episode, Array], _: None) -> tuple[tuple[Episode, Array], None]:
            state, code = carry
            action = action_of(seed, index, state.decisions)
            state, outcome = episode.step(drive.driving, state, action, drive.duration)
            return (state, jnp.where(code == 0, outcome.accident, code)), None

        first = (_start(drive, seed, index), jnp.int32(0))
        code = jax.lax.scan(one, first, length=drive.duration)[0][1]
        return jnp.where(code == 0, TRUNCATED, code)

    return np.asarray(jax.jit(jax.vmap(ending))(jnp.arange(count)))


def prepared(drive: Drive, seed: int, count: int) -> list[tuple[World, Any]]:
    """Starts 0 to ``count - 1`` with their actions, for a world that is not ours."""
    index = jnp.arange(count)
    begun = jax.device_get(jax.jit(jax.vmap(partial(_start, drive, seed)))(index))
    each = jax.vmap(jax.vmap(partial(action_of, seed), (None, 0)), (0, None))
    actions = np.asarray(jax.jit(each)(index, jnp.arange(drive.duration)))
    worlds = [jax.tree.map(lambda leaf, i=i: leaf[i], begun.world) for i in range(count)]
    return list(zip(worlds, actions, strict=True))


def action_of(seed: int, index: Array, decision: Array) -> Array:
    """The action of a decision of a start."""
    stream = jax.random.fold_in(jax.random.key(seed), ACTION_STREAM)
    key = jax.random.fold_in(jax.random.fold_in(stream, index), decision)
    return jax.random.randint(key, (), 0, 9)


def _start(drive: Drive, seed: int, index: Array) -> Episode:
    key = trap.start_key(seed, "training", index)
    return episode.begin(trap.sample(drive.scenario, key, "training"))


def fresh(drive: Drive, seed: int, index: Array) -> Batch:
    """A world at its start."""
    begun = _start(drive, seed, index)
    return begun, index, percept.of(drive.driving.observation, begun.world).features
