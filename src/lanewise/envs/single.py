"""The trap as Gymnasium environments, one world each.

Start i after ``reset(seed=s)`` is start i of seed s: the same in every environment, vectorised or
not, whatever happened before.
"""

from collections.abc import Mapping
from math import isclose
from typing import Any

import gymnasium
import jax.numpy as jnp
import numpy as np
from gymnasium.error import ClosedEnvironmentError, ResetNeeded
from jax import Array
from numpy.typing import NDArray

from lanewise.driving import actions
from lanewise.envs import functional, spaces
from lanewise.envs.control import EnvConfig
from lanewise.envs.functional import State
from lanewise.envs.starts import Starts
from lanewise.errors import SettingsError
from lanewise.fields.suggestions import look_up
from lanewise.scenario import trap
from lanewise.system import pinned, process

Info = dict[str, Any]
RENDER_MODES = ("rgb_array",)


class TrapEnv(gymnasium.Env[NDArray[np.float32], Any]):
    """The trap with the nine low-level actions, two decisions a second: ``lanewise/Trap-v0``.

    Observations are the 26 features of `lanewise.driving.observation`, float32. ``info`` holds
    ``escaped`` (the paper's success: past the trap by now), ``is_success`` (and no accident),
    ``accident`` (0 none, 1 collision, 2 off the road, 3 come to a stop), ``speed`` (m/s),
    ``timestep_reward`` (the paper's sum: one reward a second), ``lane`` (the ego's, from 0 at the
    left), ``gap_ahead`` (m, bumper to bumper, to the nearest vehicle ahead in that lane; inf
    without one), ``time_to_collision`` (s, at the speeds of the moment; inf where the gap does not
    shrink), and which start it was: ``seed`` and ``start``.
    """

    metadata = {"render_modes": list(RENDER_MODES), "render_fps": 2}  # noqa: RUF012
    actions = "low-level"
    """As of `functional.make`."""
    closed = False
    """Whether `close` was called."""

    def __init__(self, *, render_mode: str | None = None, **settings: Any) -> None:
        """An environment to be reset.

        With render mode ``rgb_array`` it has pictures. Settings are those of `functional.make`.
        """
        refuse_other(settings, render_mode)
        self.config = functional.make(self.actions, **settings)
        self.render_mode = render_mode
        self.metadata = metadata(self.config)
        self.action_space = spaces.of_actions(self.config)
        self.observation_space = spaces.of_observations(self.config)
        self._starts = Starts.none(1)
        self._state: State | None = None
        self._info: Info = {}
        self._over = False

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[NDArray[np.float32], Info]:
        """The next start, or the first of a seed.

        Args:
            seed: whose starts follow from now on; at first, without one, a random one's.
            options: ``{"start": i}`` for start i of the seed.

        Raises:
            LanewiseError: an option or a seed makes no sense; nothing has changed then.
            ClosedEnvironmentError: after `close`.
        """
        refuse_unusable(self.closed)
        starts = self._starts.turned(np.array([True]), [seed], options)
        observation, facts = spaces.unpack(self._begin(*starts.first))
        super().reset(seed=None if seed is None else starts.first[0])
        self._starts = starts
        self._over = False
        self._info = info(facts, starts)
        return observation, self._info

    def step(self, action: Any) -> tuple[NDArray[np.float32], float, bool, bool, Info]:
        """One step.

        Raises:
            ResetNeeded: there is no episode under way.
            ActionError: there is no such action; it is a ValueError too.
            ClosedEnvironmentError: after `close`.
        """
        refuse_unusable(self.closed)
        if self._state is None or self._over:
            raise ResetNeeded("the episode is over: call reset() before step()")
        observation, facts = spaces.unpack(self._decide(self._checked(action)))
        self._info = info(facts, self._starts)
        terminated, truncated = bool(facts["terminated"]), bool(facts["truncated"])
        self._over = terminated or truncated
        return observation, float(facts["reward"]), terminated, truncated, self._info

    def render(self) -> Any:
        """The road from above, uint8 [240, 960, 3]; None without a render mode."""
        refuse_unusable(self.closed)
        if self.render_mode is None:
            return None
        if self._state is None:
            raise ResetNeeded("nothing to render: call reset() first")
        from lanewise.envs import rendering

        return rendering.picture(self.config, self._state)

    def close(self) -> None:
        """End the use of the environment: afterwards only `close` may be called."""
        self.closed = True

    def _checked(self, action: Any) -> NDArray[Any]:
        space, wanted = self.action_space, f"action must be in {self.action_space}"
        return actions.checked(action, self.config.control.count, space.shape or (), wanted)

    def _begin(self, seed: int, index: int) -> Any:
        """Start ``index`` of a seed; its row."""
        self._state, row = reset(self.config, jnp.uint32(seed), jnp.int32(index))
        return row

    def _decide(self, action: NDArray[Any]) -> Any:
        """One step; its row."""
        self._state, row = step(self.config, self._state, action)
        return row


class TrapGoalEnv(TrapEnv):
    """The trap with goals as actions, planner and goal critic beneath: ``lanewise/TrapGoal-v0``.

    A step lasts until the goal critic ends the goal; its reward is the sum over its decisions.
    """

    actions = "goal"


class TrapContinuousEnv(TrapEnv):
    """The trap with acceleration and steering as actions: ``lanewise/TrapContinuous-v0``.

    Both from -1 to 1, as shares of ``driving.actions.acceleration`` and
    ``driving.actions.steering`` (positive to the right).
    """

    actions = "continuous"


def refuse_other(settings: Mapping[str, Any], render_mode: object) -> None:
    """Refuses the kind of action, which the id says, and a render mode that there is not."""
    if "actions" in settings:
        raise SettingsError(
            "actions: each kind has an id of its own: lanewise/Trap-v0, lanewise/TrapGoal-v0, "
            "lanewise/TrapContinuous-v0"
        )
    if render_mode is not None:
        look_up("render_mode", render_mode, dict.fromkeys(RENDER_MODES))


def refuse_unusable(closed: bool) -> None:
    """Refuses to go on in a closed environment, or in a forked process."""
    if closed:
        raise ClosedEnvironmentError("this environment is closed; make a new one")
    process.refuse_forked()


def metadata(config: EnvConfig) -> dict[str, Any]:
    """Render modes, and frames a second at which a video of every decision runs in real time."""
    rate = 1.0 / config.driving.decision_duration
    whole = round(rate)
    return {
        "render_modes": list(RENDER_MODES),
        "render_fps": whole if isclose(rate, whole) else rate,
    }


def info(facts: dict[str, NDArray[Any]], starts: Starts) -> Info:
    """Of one environment, in plain types."""
    found = {name: facts[name].item() for name in spaces.INFO}
    seed, start = starts.first
    return found | {"seed": seed, "start": start}


@pinned.jit(static_argnums=0)
def reset(config: EnvConfig, seed: Array, index: Array) -> tuple[State, Array]:
    """(state, row) of a start."""
    state, shown = functional.reset(config, trap.start_key(seed, config.split, index))
    return state, spaces.pack(shown)


@pinned.jit(static_argnums=0)
def step(config: EnvConfig, state: State, action: Array) -> tuple[State, Array]:
    """(state, row) after a step."""
    state, shown = functional.step(config, state, action)
    return state, spaces.pack(shown)
