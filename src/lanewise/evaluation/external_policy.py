"""Anyone's policy as one function from a batch of observations to a batch of actions."""

import inspect
from collections.abc import Callable
from dataclasses import dataclass
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


@dataclass
class _Predicting:
    """Stable-Baselines3's way: ``predict`` takes batches and hands a recurrent state on."""

    predict: Callable[..., Any]
    count: int
    deterministic: bool
    state: Any = None

    def __call__(
        self, observations: NDArray[np.float32], wanted: NDArray[np.bool_], first: bool
    ) -> NDArray[Any]:
        options = {
            "state": None if first else self.state,
            "episode_start": np.full(len(observations), first),
            "deterministic": self.deterministic,
        }
        found = self.predict(observations.copy(), **_taken(self.predict, options))
        if isinstance(found, tuple):
            if len(found) != 2:
                raise LanewiseError(
                    "predict() must return actions, or a tuple of actions and a state; it returned "
                    f"{len(found)} values"
                )
            found, self.state = found
        return _checked(found, self.count, len(observations))


@dataclass
class _Calling:
    """A function, of a batch or of one observation, that answers from what it is given alone."""

    policy: Callable[[Any], Any]
    batched: bool | None
    count: int
    deterministic: bool
    asked: int = 0
    first: tuple[NDArray[Any], ...] = ()
    """The first question: observations, which were wanted, and the answer."""

    def __call__(
        self, observations: NDArray[np.float32], wanted: NDArray[np.bool_], first: bool
    ) -> NDArray[Any]:
        if self.batched is None:
            self.batched = self._takes_batches(observations)
        found = self._answers(observations, wanted)
        if self.deterministic:
            self._ask_again(observations, wanted, found)
        return found

    def _answers(
        self, observations: NDArray[np.float32], wanted: NDArray[np.bool_]
    ) -> NDArray[Any]:
        # Copies: a policy may write over what it is given.
        if self.batched:
            return _checked(self.policy(observations.copy()), self.count, len(observations))
        kind = np.int32 if self.count else np.float32
        found = np.zeros((len(observations), *_shape(self.count)), kind)
        for place in np.flatnonzero(wanted):
            found[place] = _checked(self.policy(observations[place].copy()), self.count)
        return found

    def _ask_again(self, *now: NDArray[Any]) -> None:
        """Refuse a function that answers the first observations differently by now.

        It is asked after 1, 2, 4, 8, ... decisions: what it has seen meanwhile must not matter.
        """
        self.first = self.first or now
        self.asked += 1
        if self.asked & (self.asked - 1):
            return
        observations, wanted, before = self.first
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
            shape: tuple[int, ...] = np.shape(self.policy(observations.copy()))
        except Exception:
            # Asked with one observation it will say itself what is wrong, if anything is.
            return False
        return tuple(shape) == (len(observations), *_shape(self.count))


def _taken(predict: Callable[..., Any], options: dict[str, Any]) -> dict[str, Any]:
    """Those of some keyword arguments that a function takes."""
    try:
        known = inspect.signature(predict).parameters
    except (TypeError, ValueError):  # Some compiled functions do not say.
        return {}
    if any(each.kind is each.VAR_KEYWORD for each in known.values()):
        return options
    return {name: value for name, value in options.items() if name in known}


def _shape(count: int) -> tuple[int, ...]:
    """Of one action."""
    return () if count else (2,)


def _checked(given: Any, count: int, batch: int | None = None) -> NDArray[Any]:
    """The answer to a batch of observations, or to one."""
    what = f"whole numbers from 0 to {count - 1}" if count else "pairs of numbers from -1 to 1"
    if batch is None:
        wanted = f"for an observation the policy must return one of the {what}"
        return actions.checked(given, count, _shape(count), wanted)
    wanted = f"for {batch} observations the policy must return {batch} {what}"
    return actions.checked(given, count, (batch, *_shape(count)), wanted)
