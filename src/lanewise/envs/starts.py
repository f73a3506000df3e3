"""Which start of which seed comes next in each of several environments."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lanewise.envs.keywords import plain
from lanewise.errors import LanewiseError
from lanewise.fields.ranges import show

LARGEST = 2**32
"""Seeds are smaller than this."""


@dataclass(frozen=True)
class Starts:
    """Seeds and counts of starts, one for each environment; never changed, only replaced."""

    seeds: NDArray[np.uint32]
    indices: NDArray[np.int32]
    """Negative where there was no start yet, and hence no seed."""

    @classmethod
    def none(cls, count: int) -> "Starts":
        """Before the first reset."""
        return cls(np.zeros(count, np.uint32), np.full(count, -1, np.int32))

    def turned(self, which: NDArray[np.bool_], seed: Any, options: Any) -> "Starts":
        """Those after a reset; everything is checked first.

        Args:
            which: bool [W] the environments that go on.
            seed: environment i takes ``seed + i``, or its own of a list, and begins with its first
                start; None goes on, at first from a random seed.
            options: ``start`` to go to that start instead of the next.
        """
        start = _start(mapping(options))
        each = self._each(plain(seed))
        given = np.array([number is not None for number in each])
        first = ~given & (self.indices < 0)
        numbers = np.array([0 if number is None else number for number in each], np.uint32)
        drawn = np.random.default_rng().integers(2**31, size=len(each), dtype=np.uint32)
        seeds = np.select([given, first], [numbers, drawn], self.seeds)
        indices = np.where(given | first, 0, self.indices + 1)
        if start is not None:
            indices = np.full_like(indices, start)
        return Starts(np.where(which, seeds, self.seeds), np.where(which, indices, self.indices))

    @property
    def first(self) -> tuple[int, int]:
        """(seed, count of the start) of the first environment."""
        return int(self.seeds[0]), int(self.indices[0])

    def following(self, which: NDArray[np.bool_]) -> "Starts":
        """One start further, where the environment restarted itself."""
        return Starts(self.seeds, self.indices + which.astype(np.int32))

    def _each(self, seed: Any) -> list[int | None]:
        count = len(self.seeds)
        if seed is None:
            return [None] * count
        if type(seed) is int:
            seed = [seed + place for place in range(count)]
        if not isinstance(seed, Sequence) or isinstance(seed, str | bytes):
            raise _no_seed(seed)
        if len(seed) != count:
            raise LanewiseError(f"{len(seed)} seeds for {count} environments; give as many")
        for number in seed:
            # A truth value is a whole number to `isinstance`.
            if number is not None and not (type(number) is int and 0 <= number < LARGEST):
                raise _no_seed(number)
        return list(seed)


def mapping(options: Any) -> dict[str, Any]:
    """The options of a reset, to take some away."""
    if options is not None and not isinstance(options, Mapping):
        raise LanewiseError(f"options: expected a mapping, got {show(options)}")
    return {} if options is None else dict(options)


def _no_seed(given: object) -> LanewiseError:
    return LanewiseError(
        f"a seed must be a whole number between 0 and {LARGEST - 1}, got {show(given)}"
    )


def _start(options: dict[str, Any]) -> int | None:
    start = plain(options.pop("start", None))
    if options:
        raise LanewiseError(f"unknown option {next(iter(options))!r}; there is only 'start'")
    if start is not None and not (type(start) is int and 0 <= start < 2**31):
        raise LanewiseError(f"option start must be a whole number from 0 on, got {show(start)}")
    return start
