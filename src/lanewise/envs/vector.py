"""Thousands of traps as one Gymnasium vector environment: one compiled call a step.

Environment i is the single environment reset with ``seed + i``, step by step, in each of
Gymnasium's three autoreset modes.
"""

import math
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from gymnasium.error import ResetNeeded
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space
from jax import Array
from numpy.typing import NDArray

from lanewise.driving import restarting
from lanewise.driving.actions import checked
from lanewise.envs import functional, single, spaces
from lanewise.envs.control import EnvConfig
from lanewise.envs.functional import State
from lanewise.envs.keywords import plain
from lanewise.envs.starts import Starts, mapping
from lanewise.fields.ranges import Between, FieldType
from lanewise.fields.suggestions import look_up
from lanewise.system import pinned

Booleans = NDArray[np.bool_]
Floats = NDArray[np.float64]
Info = dict[str, Any]
COUNT = FieldType(int, None, Between(1, 2**31 - 1))
"""Of worlds, and of steps."""


class TrapVectorEnv(VectorEnv[NDArray[np.float32], Any, Any]):
    """Many traps with the nine low-level actions: ``gymnasium.make_vec("lanewise/Trap-v0")``.

    ``info`` holds arrays of what `TrapEnv` tells of one. With ``AutoresetMode.SAME_STEP`` the last
    observations of episodes that ended are in ``final_obs``, their info in ``final_info``.
    """

    metadata = {"render_modes": list(single.RENDER_MODES), "render_fps": 2}  # noqa: RUF012
    actions = "low-level"
    """As of `functional.make`."""

    def __init__(
        self,
        num_envs: int = 1,
        *,
        render_mode: str | None = None,
        autoreset_mode: AutoresetMode | str = AutoresetMode.NEXT_STEP,
        max_episode_steps: int | None = None,
        **settings: Any,
    ) -> None:
        """Environments to be reset.

        Args:
            num_envs: how many.
            render_mode: None, or ``rgb_array`` for pictures by `render`.
            autoreset_mode: when an environment whose episode ended restarts itself: with the next
                step, which then ignores its action and gives no reward; in the same; or not at all.
            max_episode_steps: steps after which an episode is truncated, as by ``gymnasium.make``;
                None or -1: its duration alone truncates it.
            settings: as of `lanewise.envs.functional.make`.
        """
        super().__init__()
        num_envs = COUNT.check("num_envs", plain(num_envs))
        limited = max_episode_steps not in (None, -1)
        self._limit = (
            COUNT.check("max_episode_steps", plain(max_episode_steps)) if limited else math.inf
        )
        single.refuse_other(settings, render_mode)
        modes = {mode.value: mode for mode in AutoresetMode}
        given = getattr(autoreset_mode, "value", autoreset_mode)
        self.mode = look_up("autoreset_mode", given, modes)
        self.config = functional.make(self.actions, **settings)
        self.num_envs = num_envs
        self.render_mode = render_mode
        self.metadata = single.metadata(self.config) | {"autoreset_mode": self.mode}
        self.single_action_space = spaces.of_actions(self.config)
        self.single_observation_space = spaces.of_observations(self.config)
        self.action_space = batch_space(self.single_action_space, num_envs)
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self._starts = Starts.none(num_envs)
        self._states: State | None = None
        self._observations = np.zeros(self.observation_space.shape or (), np.float32)
        self._info: Info = {}
        self._over = np.zeros(num_envs, np.bool_)
        self._steps = np.zeros(num_envs, np.int64)

    def reset(
        self, *, seed: Any = None, options: dict[str, Any] | None = None
    ) -> tuple[NDArray[np.float32], Info]:
        """The next starts, or the first of seeds; fails as `TrapEnv.reset`, or without the mask.

        Args:
            seed: environment i takes ``seed + i``, or its own of a list; None: the next starts.
            options: ``{"reset_mask": bool [W]}`` to reset some only, ``{"start": i}`` for start i.
        """
        single.refuse_unusable(self.closed)
        others = mapping(options)
        which = self._mask(others.pop("reset_mask", None))
        if self._states is None and not which.all():
            raise ResetNeeded("the first reset() is of all environments, without a reset_mask")
        starts = self._starts.turned(which, seed, others)
        if self._states is None or which.all():
            states, found = _fresh(self.config, starts.seeds, starts.indices)
        else:
            states, found = _reset_some(
                self.config, self._states, starts.seeds, starts.indices, which
            )
        super().reset(seed=None if seed is None else starts.first[0])
        self._states, self._starts = states, starts
        observations, facts = spaces.unpack(found)
        self._observations = np.where(which[:, None], observations, self._observations)
        self._over = self._over & ~which
        self._steps = np.where(which, 0, self._steps)
        self._info = _info(facts, starts, which)
        return self._observations.copy(), self._info

    def step(self, actions: Any) -> tuple[NDArray[np.float32], Floats, Booleans, Booleans, Info]:
        """One step of every environment; fails as `TrapEnv.step`."""
        single.refuse_unusable(self.closed)
        if self._states is None or (self.mode is AutoresetMode.DISABLED and self._over.any()):
            raise ResetNeeded(
                "an episode is over: call reset() before step(), or "
                'reset(options={"reset_mask": ...}) for some of the environments'
            )
        given = self._checked(actions)
        steps = np.where(self._over, 0, self._steps + 1)
        late = steps >= self._limit
        at_once = self.mode is AutoresetMode.SAME_STEP
        before = self._starts
        self._states, found, last = _step(
            *(self.config, self.mode, self._states, given, before.seeds, before.indices + 1),
            late if at_once else self._over,
        )
        self._observations, facts = spaces.unpack(found)
        facts["truncated"] |= late
        done = facts["terminated"] | facts["truncated"]
        # Without autoreset none is over: the step would have been refused.
        again = done if at_once else self._over
        self._starts = before.following(again)
        self._steps = np.where(again, 0, steps)
        self._over = done & ~again
        self._info = _info(facts, self._starts, np.ones(self.num_envs, np.bool_))
        if at_once and done.any():
            self._info |= _final(last, before, done)
        return (
            self._observations.copy(),
            facts["reward"],
            facts["terminated"],
            facts["truncated"],
            self._info,
        )

    def render(self) -> Any:
        """A picture of each environment, see `TrapEnv.render`; None without a render mode."""
        single.refuse_unusable(self.closed)
        if self.render_mode is None:
            return None
        if self._states is None:
            raise ResetNeeded("nothing to render: call reset() first")
        from lanewise.envs import rendering

        states = jax.device_get(self._states)
        return tuple(
            rendering.picture(self.config, jax.tree.map(lambda leaf, i=place: leaf[i], states))
            for place in range(self.num_envs)
        )

    def _mask(self, given: Any) -> Booleans:
        if given is None:
            return np.ones(self.num_envs, np.bool_)
        mask = np.asarray(given)
        if mask.shape != (self.num_envs,) or mask.dtype != np.bool_ or not mask.any():
            raise ValueError(f"reset_mask must be bool [{self.num_envs}] with at least one true")
        return mask

    def _checked(self, actions: Any) -> NDArray[Any]:
        each = self.single_action_space
        shape = (self.num_envs, *(each.shape or ()))
        wanted = f"actions must be {self.num_envs} of {each}"
        return checked(actions, self.config.control.count, shape, wanted)


class TrapGoalVectorEnv(TrapVectorEnv):
    """Many traps with goals as actions, see `single.TrapGoalEnv`."""

    actions = "goal"


class TrapContinuousVectorEnv(TrapVectorEnv):
    """Many traps with acceleration and steering as actions, see `single.TrapContinuousEnv`."""

    actions = "continuous"


def _info(facts: dict[str, Any], starts: Starts, which: Booleans) -> Info:
    """As Gymnasium's vector environments tell it: arrays, and for each which of it counts."""
    told = {name: facts[name] for name in spaces.INFO}
    told |= {"seed": starts.seeds.astype(np.int64), "start": starts.indices.astype(np.int64)}
    found: Info = {}
    for name, values in told.items():
        found[name] = np.where(which, values, np.zeros_like(values))
        found[f"_{name}"] = which.copy()
    return found


def _final(last: Array, starts: Starts, done: Booleans) -> Info:
    """What the episodes that ended showed last."""
    observations, facts = spaces.unpack(last)
    shown = np.full(len(done), None, object)
    for place in np.flatnonzero(done):
        shown[place] = observations[place]
    return {
        "final_obs": shown,
        "_final_obs": done.copy(),
        "final_info": _info(facts, starts, done),
        "_final_info": done.copy(),
    }


@pinned.jit(static_argnums=0)
def _fresh(config: EnvConfig, seeds: Array, indices: Array) -> tuple[State, Array]:
    """([W] states at these starts, [W, n + 11] rows)."""
    found: tuple[State, Array] = jax.vmap(partial(single.reset, config))(seeds, indices)
    return found


def _where(
    config: EnvConfig, which: Array, states: State, found: Array, seeds: Array, indices: Array
) -> tuple[State, Array]:
    """States and rows, fresh ones where ``which``."""
    after: tuple[State, Array] = restarting.restart_finished(
        which, (states, found), lambda over: _fresh(config, seeds[over], indices[over])
    )
    return after


@pinned.jit(static_argnums=0)
def _reset_some(
    config: EnvConfig, states: State, seeds: Array, indices: Array, which: Array
) -> tuple[State, Array]:
    size = jax.eval_shape(partial(_fresh, config), seeds, indices)[1]
    return _where(config, which, states, jnp.zeros(size.shape, size.dtype), seeds, indices)


@pinned.jit(static_argnums=(0, 1))
def _step(
    config: EnvConfig,
    mode: AutoresetMode,
    states: State,
    actions: Array,
    seeds: Array,
    following: Array,
    over: Array,
) -> tuple[State, Array, Array]:
    """(states, rows to be shown, rows of the step itself).

    Those that are ``over``, before the step or in `SAME_STEP` by the number of steps, restart, in
    `SAME_STEP` also those whose episode the step ended. Its reward and ending are still told then.
    """
    states, found = jax.vmap(partial(single.step, config))(states, actions)
    if mode is AutoresetMode.DISABLED:
        return states, found, found
    if mode is AutoresetMode.NEXT_STEP:
        states, shown = _where(config, over, states, found, seeds, following)
        return states, shown, found
    # Reward, terminated and truncated; what stands behind them is the fresh episode's.
    told = slice(-len(spaces.FACTS), -len(spaces.INFO))
    _, terminated, truncated = found[:, told].T
    ended = ((terminated + truncated) > 0) | over
    states, shown = _where(config, ended, states, found, seeds, following)
    return states, shown.at[:, told].set(found[:, told]), found
