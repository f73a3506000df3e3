"""Which start of which seed comes next in each of several environments."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lanewise.errors import LanewiseError

LARGEST = 2**32
"""Seeds are smaller than this."""


class Starts:
    """Seeds and counts of starts, one for each environment."""

    def __init__(self, count: int) -> None:
        self.seeds = np.zeros(count, np.uint32)
        self.indices = np.full(count, -1, np.int32)
        self._seeded = False

    def turn(
        self,
        which: NDArray[np.bool_],
        seed: int | Sequence[int | None] | None,
        options: dict[str, Any] | None,
    ) -> None:
        """Go to the next start.

        Args:
            which: bool [W] the environments that go on.
            seed: environment i takes ``seed + i``, or its own of a list, and begins with its first
                start; None goes on, at first from random seeds.
            options: ``start`` to go to that start instead of the next.

        Raises:
            LanewiseError: an option or a seed makes no sense.
        """
        start = _start(options)
        if seed is None and not self._seeded:
            seed = [
                int(number) for number in np.random.default_rng().integers(2**31, size=len(which))
            ]
        for place, given in enumerate(self._each(seed)):
            if which[place]:
                self._turn(place, given)
        if start is not None:
            self.indices[which] = start
        self._seeded = True

    @property
    def first(self) -> tuple[int, int]:
        """(seed, count of the start) of the first environment."""
        return int(self.seeds[0]), int(self.indices[0])

    def following(self, which: NDArray[np.bool_]) -> None:
        """One start further, where the environment restarted itself."""
        self.indices += which.astype(np.int32)

    def copy(self) -> "Starts":
        """As they stand now."""
        other = Starts(len(self.seeds))
        other.seeds, other.indices = self.seeds.copy(), self.indices.copy()
        return other

    def _each(self, seed: int | Sequence[int | None] | None) -> Sequence[int | None]:
        count = len(self.seeds)
        if seed is None:
            return [None] * count
        if isinstance(seed, int | np.integer):
            return [int(seed) + place for place in range(count)]
        each = list(seed)
        if len(each) != count:
            raise LanewiseError(f"{len(each)} seeds for {count} environments; give as many")
        return each

    def _turn(self, place: int, seed: int | None) -> None:
        if seed is None:
            self.indices[place] += 1
            return
        if not 0 <= seed < LARGEST:
            raise LanewiseError(f"a seed must be between 0 and {LARGEST - 1}, got {seed}")
        self.seeds[place], self.indices[place] = seed, 0


def _start(options: dict[str, Any] | None) -> int | None:
    given = dict(options or {})
    start = given.pop("start", None)
    if given:
        raise LanewiseError(f"unknown option {next(iter(given))!r}; there is only 'start'")
    if start is not None and not (isinstance(start, int | np.integer) and 0 <= start < 2**31):
        raise LanewiseError(f"option start must be a whole number from 0 on, got {start!r}")
    return None if start is None else int(start)
