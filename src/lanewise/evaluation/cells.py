"""Cells of a grid, whatever its axes: what is known of each, and counts over some. Without JAX.

One drive as long as the last horizon gives the outcome at every horizon: no controller knows when
its test ends.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from math import nan
from typing import Any, Generic, Protocol, TypeVar

import numpy as np

from lanewise.errors import SettingsError
from lanewise.evaluation.episodes import ACCIDENT_KINDS, Episodes
from lanewise.evaluation.statistics import Interval, clopper_pearson
from lanewise.fields.ranges import show

KINDS = tuple(ACCIDENT_KINDS)[1:]
"""Kinds of accidents, in the order in which they are counted."""
OUTCOMES = ("escapes", "successes", "accidents")
"""Numbers of `Counts` that are shown as shares of the episodes."""


class Place(Protocol):
    """Where in a grid a cell is: a value on each axis."""

    @property
    def approach(self) -> tuple[float, ...]:
        """What decides whether its start can be won."""

    @property
    def start_numbers(self) -> dict[str, float]:
        """Numbers of its `trap.Start`; what is missing is the scenario's."""


PlaceType = TypeVar("PlaceType", bound=Place)
AnyPlace = TypeVar("AnyPlace", bound=Place, covariant=True)


class PlacedGrid(Protocol[AnyPlace]):
    """A dataclass of axes, each with its values."""

    def places(self) -> Sequence[AnyPlace]:
        """Every cell, in the order of driving."""

    def searched(self) -> Sequence[AnyPlace]:
        """One place of each approach that may be winnable."""


@dataclass(frozen=True)
class Reach:
    """Whether a start can be won at all, without other traffic; see `reachability`."""

    winnable: bool
    """Whether there is an escape; true also where the search was given up."""
    decided: bool
    """Whether the search came to an end."""
    clear: bool
    """Whether there is an escape that keeps the clearance from both trap cars."""
    escape: str
    """The best escape found, one digit a decision; empty if none was."""
    states: int
    """States the exhaustive search visited; 0 where it was not needed."""


@dataclass(frozen=True)
class CellOutcome:
    """What came of a cell's episodes; each list by horizon."""

    episodes: int
    speed: float
    """Mean of the episodes' average speeds, m/s."""
    reward: float
    """Mean accumulated reward."""
    escapes: list[int]
    """The paper's successes: past the trap by then."""
    successes: list[int]
    """Past the trap by then, and no accident by then, not even afterwards."""
    kinds: list[list[int]]
    """Accidents by then, in the order of `KINDS`."""
    first_accident: list[int]
    """The first episode with an accident by then; -1 without one."""

    def at(self, horizon: int) -> "Counts":
        """The counts at a horizon, by its index."""
        return Counts(
            1,
            self.episodes,
            self.escapes[horizon],
            self.successes[horizon],
            tuple(self.kinds[horizon]),
        )


def outcome(episodes: Episodes, limits: Sequence[float]) -> CellOutcome:
    """What came of episodes by each of some times, s, none beyond the end of the drive."""
    escapes, successes, kinds, first = [], [], [], []
    for limit in limits:
        # The time of an escape that never came is NaN, which is at no time.
        escaped = episodes.escape_time <= limit
        crashed = (episodes.accident > 0) & (episodes.duration <= limit)
        escapes.append(int(escaped.sum()))
        successes.append(int((escaped & ~crashed).sum()))
        found = np.bincount(episodes.accident_kind[crashed], minlength=len(ACCIDENT_KINDS))
        kinds.append(found[1:].tolist())
        first.append(int(crashed.argmax()) if crashed.any() else -1)
    return CellOutcome(
        episodes=len(episodes),
        speed=float(episodes.average_speed.mean()),
        reward=float(episodes.accumulated_reward.mean()),
        escapes=escapes,
        successes=successes,
        kinds=kinds,
        first_accident=first,
    )


@dataclass(frozen=True)
class Cell(Generic[PlaceType]):
    """A place of a grid with all that is known of it."""

    place: PlaceType
    reach: Reach | None
    """None where nobody searched, because the start cannot be won."""
    outcome: CellOutcome

    @property
    def winnable(self) -> bool:
        """Whether its start can be won, other traffic left out."""
        return self.reach is not None and self.reach.winnable


def cells_of(
    grid: PlacedGrid[PlaceType], reached: Sequence[Reach], outcomes: Sequence[CellOutcome]
) -> list[Cell[PlaceType]]:
    """All cells of a grid, from what was found of its `searched` places and of all its places."""
    approaches = (place.approach for place in grid.searched())
    known = dict(zip(approaches, reached, strict=True))
    return [
        Cell(place, known.get(place.approach), outcome)
        for place, outcome in zip(grid.places(), outcomes, strict=True)
    ]


DENOMINATORS: dict[str, Callable[[Cell[Any]], bool]] = {
    "all": lambda cell: True,
    "winnable": lambda cell: cell.winnable,
    "winnable_with_clearance": lambda cell: cell.reach is not None and cell.reach.clear,
}
"""Over which cells a share is taken."""


@dataclass(frozen=True)
class Counts:
    """Episodes of some cells, pooled, at one horizon."""

    cells: int
    episodes: int
    escapes: int
    successes: int
    kinds: tuple[int, ...]
    """Accidents, in the order of `KINDS`."""

    @property
    def accidents(self) -> int:
        """Of any kind."""
        return sum(self.kinds)

    def rate(self, name: str) -> float:
        """One of `OUTCOMES`, of 1; NaN without episodes."""
        return float(getattr(self, name)) / self.episodes if self.episodes else nan

    def interval(self, name: str) -> Interval | None:
        """Its exact 95 % interval, fractions of 1; None without episodes."""
        return clopper_pearson(getattr(self, name), self.episodes) if self.episodes else None

    def to_json(self) -> dict[str, Any]:
        """The counts, the rates and their intervals."""
        stored: dict[str, Any] = vars(self) | {"kinds": dict(zip(KINDS, self.kinds, strict=True))}
        for name in OUTCOMES:
            stored[name] = getattr(self, name)
            stored |= {f"{name}_rate": self.rate(name), f"{name}_interval": self.interval(name)}
        return stored


def pool(cells: Sequence[Cell[Any]], horizon: int, over: str = "all") -> Counts:
    """The episodes of those cells that a denominator counts, at a horizon's index."""
    counts = [cell.outcome.at(horizon) for cell in cells if DENOMINATORS[over](cell)]
    return Counts(
        cells=len(counts),
        episodes=sum(c.episodes for c in counts),
        escapes=sum(c.escapes for c in counts),
        successes=sum(c.successes for c in counts),
        kinds=tuple(sum(c.kinds[kind] for c in counts) for kind in range(len(KINDS))),
    )


def fold(
    cells: Sequence[Cell[PlaceType]], *axes: str
) -> dict[tuple[Any, ...], list[Cell[PlaceType]]]:
    """The cells by their values on some axes; all other axes are folded together."""
    groups: dict[tuple[Any, ...], list[Cell[PlaceType]]] = {}
    for cell in cells:
        groups.setdefault(tuple(getattr(cell.place, axis) for axis in axes), []).append(cell)
    return groups


def check_axes(axes: Mapping[str, Sequence[object]]) -> None:
    """Refuse an axis that names a value twice: its cells would count double."""
    for axis, values in axes.items():
        for value in values:
            if values.count(value) > 1:
                pair = axis == "speeds"
                flag = "ego-speed and --trap-speed" if pair else axis.replace("_", "-")
                raise SettingsError(f"--{flag}: {show(value)} is given twice")
