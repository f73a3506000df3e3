"""Anyone's policy as one function from a batch of observations to a batch of actions."""

import inspect
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lanewise.driving import actions
from lanewise.errors import LanewiseError

Decide = Callable[[NDArray[np.float32], NDArray[np.bool_], bool], NDArray[Any]]
"""([B, n] observations, [B] whose actions are wanted, whether they are the first of their episodes)
to actions, int32 [B] or float32 [B, 2]; those that are not wanted may be anything that exists."""
SAME = 1e-3
"""Continuous actions that differ by less count as the same answer."""


def decider(policy: Any, batched: bool | None, count: int, deterministic: bool = True) -> Decide:
    """The policy as a function of batches.

    Args:
        policy: an object with ``predict(observation, ...)`` as Stable-Baselines3's, or a callable
            on observations.
        batched: whether it takes observations [B, n]; False: one at a time, [n]; None: found out by
            asking it with a batch. ``predict`` is always given batches.
        count: number of actions; 0 for continuous ones.
        deterministic: whether ``predict`` is asked for its deterministic action, and a function is
            refused if it answers the same observation differently.

    Raises:
        LanewiseError: it is neither, or ``batched`` is given for ``predict``.
    """
    if callable(getattr(policy, "predict", None)):
        if batched is not None:
            raise LanewiseError("batched: predict() is always given batches; leave it out")
        return _Predicting(policy.predict, count, deterministic)
    if not callable(policy):
        raise LanewiseError(
            "a policy is a function of observations, an object with predict(), a run folder or "
            f"pretrained/NAME; got {type(policy).__name__}"
        )
    return _Calling(policy, batched, count, deterministic)


class _Predicting:
    """Stable-Baselines3's way: ``predict`` takes batches and hands a recurrent state on."""

    def __init__(self, predict: Callable[..., Any], count: int, deterministic: bool) -> None:
        self._predict, self._count, self._deterministic = predict, count, deterministic
        self._options = _taken(predict, {"state", "episode_start", "deterministic"})
        self._state: Any = None

    def __call__(
        self, observations: NDArray[np.float32], wanted: NDArray[np.bool_], first: bool
    ) -> NDArray[Any]:
        self._state = None if first else self._state
        options = {
            "state": self._state,
            "episode_start": np.full(len(observations), first),
            "deterministic": self._deterministic,
        }
        found = self._predict(
            observations.copy(), **{name: options[name] for name in self._options}
        )
        if isinstance(found, tuple):
            if len(found) != 2:
                raise LanewiseError(
                    "predict() must return actions, or a tuple of actions and a state; it returned "
                    f"{len(found)} values"
                )
            found, self._state = found
        return _several(found, len(observations), self._count)


class _Calling:
    """A function, of a batch or of one observation, that answers from what it is given alone."""

    def __init__(
        self,
        policy: Callable[[Any], Any],
        batched: bool | None,
        count: int,
        deterministic: bool,
    ) -> None:
        self._policy, self._batched, self._count = policy, batched, count
        self._deterministic = deterministic
        self._asked = 0
        self._first: tuple[NDArray[Any], ...] = ()

    def __call__(
        self, observations: NDArray[np.float32], wanted: NDArray[np.bool_], first: bool
    ) -> NDArray[Any]:
        if self._batched is None:
            self._batched = self._takes_batches(observations)
        found = self._answers(observations, wanted)
        if self._deterministic:
            self._ask_again(observations, wanted, found)
        return found

    def _answers(
        self, observations: NDArray[np.float32], wanted: NDArray[np.bool_]
    ) -> NDArray[Any]:
        # Copies: a policy may write over what it is given.
        if self._batched:
            return _several(self._policy(observations.copy()), len(observations), self._count)
        found = np.zeros(
            (len(observations), *_shape(self._count)), np.int32 if self._count else np.float32
        )
        for place in np.flatnonzero(wanted):
            found[place] = _one(self._policy(observations[place].copy()), self._count)
        return found

    def _ask_again(self, *now: NDArray[Any]) -> None:
        """Refuse a function that answers the first observations differently by now.

        It is asked after 1, 2, 4, 8, ... decisions: what it has seen meanwhile must not matter.
        """
        self._first = self._first or now
        self._asked += 1
        if self._asked & (self._asked - 1):
            return
        observations, wanted, before = self._first
        after = self._answers(observations, wanted)
        differ = wanted & (np.abs(after - before) > SAME).reshape(len(after), -1).any(axis=1)
        if differ.any():
            raise LanewiseError(
                f"the policy answered an observation with {before[differ][0].tolist()} and later "
                f"with {after[differ][0].tolist()}: a function may use nothing else\n"
                "  if it remembers, give an object with predict(observation, state, "
                "episode_start); if it draws at random, deterministic=False"
            )

    def _takes_batches(self, observations: NDArray[np.float32]) -> bool:
        """Whether an answer to a batch looks like a batch of actions."""
        try:
            shape: tuple[int, ...] = np.shape(self._policy(observations.copy()))
        except Exception:
            # Asked with one observation it will say itself what is wrong, if anything is.
            return False
        return tuple(shape) == (len(observations), *_shape(self._count))


def _taken(predict: Callable[..., Any], options: set[str]) -> set[str]:
    """Those of some keywords that a function takes."""
    try:
        known = inspect.signature(predict).parameters
    except (TypeError, ValueError):  # Some compiled functions do not say.
        return set()
    anything = any(each.kind is each.VAR_KEYWORD for each in known.values())
    return options if anything else options & known.keys()


def _shape(count: int) -> tuple[int, ...]:
    """Of one action."""
    return () if count else (2,)


def _several(given: Any, episodes: int, count: int) -> NDArray[Any]:
    what = f"whole numbers from 0 to {count - 1}" if count else "pairs of numbers from -1 to 1"
    wanted = f"for {episodes} observations the policy must return {episodes} {what}"
    return actions.checked(given, count, (episodes, *_shape(count)), wanted)


def _one(given: Any, count: int) -> NDArray[Any]:
    what = f"a whole number from 0 to {count - 1}" if count else "two numbers from -1 to 1"
    wanted = f"for an observation the policy must return {what}"
    return actions.checked(given, count, _shape(count), wanted)
