"""The trap inside the real highway-env, with our observation, reward and endings."""

from copy import deepcopy
from typing import Any, Self

import jax
import jax.numpy as jnp
from jax import Array
from numpy.typing import NDArray

from lanewise.driving import actions, episode
from lanewise.envs import functional, single, spaces
from lanewise.envs.control import EnvConfig
from lanewise.envs.functional import State
from lanewise.interop import evaluation_in_highway_env
from lanewise.system import pinned
from lanewise.world.state import World

highway = evaluation_in_highway_env()


class TrapHighwayEnv(single.TrapEnv):
    """The trap with the nine low-level actions in highway-env: ``lanewise/TrapHighwayEnv-v0``.

    The same starts as in ``lanewise/Trap-v0``, simulated by highway-env; needs the extra
    ``highway``. ``highway_env`` is the environment beneath.
    """

    highway_env: Any = None

    def __copy__(self) -> Self:
        """A copy with an environment beneath of its own, as highway-env changes it in place."""
        other = object.__new__(type(self))
        other.__dict__ |= self.__dict__ | {"highway_env": deepcopy(self.highway_env)}
        return other

    def close(self) -> None:
        """Close the environment beneath too."""
        super().close()
        self._let_go()

    def _let_go(self) -> None:
        if self.highway_env is not None:
            self.highway_env.close()
            self.highway_env = None

    def _begin(self, seed: int, index: int) -> Any:
        ours, _ = single.reset(self.config, jnp.uint32(seed), jnp.int32(index))
        world = jax.device_get(ours.episode.world)
        training = self.config.split != "test"
        fresh = highway.live(self.config.driving, world, self.config.duration, training)
        self._state, row = _begun(self.config, highway.read(fresh))
        self._let_go()
        self.highway_env = fresh
        return row

    def _decide(self, action: NDArray[Any]) -> Any:
        self.highway_env.step(int(action))
        self._state, row = _evaluated(
            self.config, self._state, highway.read(self.highway_env), action
        )
        return row


@pinned.jit(static_argnums=0)
def _begun(config: EnvConfig, world: World) -> tuple[State, Array]:
    """(state, row) at the start."""
    state, shown = functional.start(config, world)
    return state, spaces.pack(shown)


@pinned.jit(static_argnums=0)
def _evaluated(config: EnvConfig, state: State, world: World, action: Array) -> tuple[State, Array]:
    """(state, row) after a decision that highway-env simulated."""
    _, steering = actions.commands(config.driving.actions, action, world.vehicles.x.dtype)
    after = episode.evaluate_step(
        config.driving, state.episode, world, steering, config.duration, config.task
    )
    state, shown = functional.after_step(config, after, state.memory, after.outcome.reward)
    return state, spaces.pack(shown)
