"""Anyone's policy as one function from a batch of observations to a batch of actions."""

import inspect
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lanewise.errors import LanewiseError

Decide = Callable[[NDArray[np.float32], bool], NDArray[Any]]
"""([B, n] observations, whether they are the first of their episodes) to [B] or [B, 2] actions."""


def decider(policy: Any, batched: bool | None, action: tuple[int, ...]) -> Decide:
    """The policy as a function of batches.

    Args:
        policy: an object with ``predict(observation, ...)`` as Stable-Baselines3's, asked for its
            deterministic action, or a callable on observations.
        batched: whether it takes observations [B, n]; False: one at a time, [n]; None: found out by
            asking it with a batch. ``predict`` is always given batches.
        action: shape of one action, () or (2,).

    Raises:
        LanewiseError: it is neither, or ``batched`` is given for ``predict``.
    """
    if hasattr(policy, "predict"):
        if batched is not None:
            raise LanewiseError("batched: predict() is always given batches; leave it out")
        return _Predicting(policy)
    if not callable(policy):
        raise LanewiseError(
            "a policy is a function of observations, an object with predict(), a run folder or "
            f"pretrained/NAME; got {type(policy).__name__}"
        )
    return _Calling(policy, batched, action)


class _Predicting:
    """Stable-Baselines3's way: ``predict`` takes batches and hands a recurrent state on."""

    def __init__(self, policy: Any) -> None:
        known = inspect.signature(policy.predict).parameters
        anything = any(each.kind is each.VAR_KEYWORD for each in known.values())
        self._predict = policy.predict
        self._options = {
            name
            for name in ("state", "episode_start", "deterministic")
            if anything or name in known
        }
        self._state: Any = None

    def __call__(self, observations: NDArray[np.float32], first: bool) -> NDArray[Any]:
        self._state = None if first else self._state
        options = {
            "state": self._state,
            "episode_start": np.full(len(observations), first),
            "deterministic": True,
        }
        found = self._predict(
            observations, **{name: options[name] for name in options if name in self._options}
        )
        if isinstance(found, tuple):
            found, self._state = found
        return np.asarray(found)


class _Calling:
    """A function, of a batch or of one observation."""

    def __init__(
        self, policy: Callable[[Any], Any], batched: bool | None, action: tuple[int, ...]
    ) -> None:
        self._policy, self._batched, self._action = policy, batched, action

    def __call__(self, observations: NDArray[np.float32], first: bool) -> NDArray[Any]:
        if self._batched is None:
            self._batched = self._takes_batches(observations)
        if self._batched:
            return np.asarray(self._policy(observations))
        return np.stack([np.asarray(self._policy(one)) for one in observations])

    def _takes_batches(self, observations: NDArray[np.float32]) -> bool:
        """Whether an answer to a batch looks like a batch of actions."""
        try:
            shape: tuple[int, ...] = np.shape(self._policy(observations))
        except Exception:
            # Asked with one observation it will say itself what is wrong, if anything is.
            return False
        return tuple(shape) == (len(observations), *self._action)
