"""A stage for many seeds at once, in one compiled loop: what a GPU is for."""

from collections.abc import Callable
from functools import partial
from typing import Any

import jax

from lanewise.system import pinned
from lanewise.training import stage
from lanewise.training.rollout import StageConfig
from lanewise.training.stage import ChunkMetrics, StageState

AXES: Any = StageState(key=0, iteration=None, learners=0, replays=0, rollouts=0)  # type: ignore[arg-type]
"""Seeds lie along the first axis of all but the count of iterations, which is one for all of them,
so that updates are due for all or for none."""


def begin(config: StageConfig, keys: jax.Array) -> StageState:
    """`stage.begin` for several random keys [S], of a stage above which nothing is frozen."""
    begun: StageState = jax.vmap(partial(stage.begin, config, {}), out_axes=AXES)(keys)
    return begun


def advance(config: StageConfig) -> Callable[[StageState], tuple[StageState, ChunkMetrics]]:
    """`stage.advance` for several seeds, compiled when first called; it consumes the states."""
    one = partial(stage.advance, config, {})
    return pinned.jit(donate_argnums=0)(jax.vmap(one, in_axes=(AXES,), out_axes=(AXES, 0)))
