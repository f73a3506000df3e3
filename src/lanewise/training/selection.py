"""Which weights a stage hands on (row 27 of the reading).

``best-training``    those with the best mean reward over 10 training episodes (the paper's rule
                     for step 1)
``best-validation``  of every `WINDOW` validations in a row the weights with the median score, and
                     of these the best: one lucky validation is never a median
``last``             those at the end
"""

from collections.abc import Sequence
from statistics import median_low

import jax
import numpy as np

from lanewise.controllers.controller import Parameters
from lanewise.evaluation.episodes import Episodes

RECENT = 10
"""Training episodes over which `best-training` averages (the paper's 10)."""
WINDOW = 5
"""Validations in a row, of which `best-validation` takes the median."""
REWARD_SCALE = 50.0
"""In a validation's score, this much more reward weighs as much as success in every episode."""


def score(validation: Episodes) -> float:
    """What weights are worth by a validation: success first, then reward."""
    return weighed(
        float(np.mean(validation.success)),
        float(np.mean(validation.accident > 0)),
        float(np.mean(validation.accumulated_reward)),
    )


def weighed(success_rate: float, accident_rate: float, reward: float) -> float:
    """The score of a validation with these figures, its reward one a second."""
    return success_rate - accident_rate + reward / REWARD_SCALE


def median_place(scores: Sequence[float]) -> int:
    """Place of the median: equal scores in order of time, of an even number the lower one."""
    return median_low(zip(scores, range(len(scores)), strict=True))[1]


def no_window(keep: str, weights: Parameters) -> Parameters:
    """Room for the weights of `WINDOW` validations; none where the rule looks at no validation.

    Args:
        keep: the rule.
        weights: of the levels that learn, as arrays or their shapes.

    Returns:
        Zeros with a leading axis of `WINDOW`, or no level at all.
    """
    if keep != "best-validation":
        return {}
    room: Parameters = jax.tree.map(
        lambda leaf: np.zeros((WINDOW, *leaf.shape), leaf.dtype), weights
    )
    return room


def put(window: Parameters, number: int, weights: Parameters) -> Parameters:
    """The window with the weights of validation ``number``, from 0 on, in place of the oldest."""

    def placed(room: np.ndarray, leaf: jax.Array) -> np.ndarray:
        room = room.copy()
        room[number % WINDOW] = leaf
        return room

    after: Parameters = jax.tree.map(placed, window, weights)
    return after


def taken(window: Parameters, number: int) -> Parameters:
    """The weights of validation ``number``, one of the last `WINDOW`."""
    weights: Parameters = jax.tree.map(lambda room: room[number % WINDOW], window)
    return weights
