"""A grid of starts: its axes as data, and what came of every start. Imports no JAX."""

import itertools
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from math import nan
from typing import Any, NamedTuple, Protocol

from lanewise.errors import SettingsError
from lanewise.evaluation.episodes import ACCIDENTS
from lanewise.evaluation.statistics import clopper_pearson
from lanewise.fields.ranges import show
from lanewise.scenario.settings import TrapSettings

CAUSES = ACCIDENTS[1:]
"""What ends an episode badly."""
DISTANCES = ((14.3, 14.8, 16.44, 16.9), (3.5, 4.06, 7.43, 8.0))
"""D1 and D2, m: the ends of their training ranges and half a metre beyond."""


@dataclass(frozen=True)
class Grid:
    """The axes; every combination of one value each is a start."""

    ego_speed: tuple[float, ...] = (8.0, 9.0, 10.0, 11.0, 12.0, 13.0)
    """The ego's speeds at the start, m/s."""
    trap_speed: tuple[float, ...] = (8.0, 9.0, 10.0, 11.0)
    """Speeds of the trap cars, m/s."""
    lanes: tuple[int, ...] = (3, 4, 5)
    front_distance: tuple[float, ...] = DISTANCES[0]
    """Values of D1, m."""
    side_distance: tuple[float, ...] = DISTANCES[1]
    """Values of D2, m."""
    spacing: tuple[float, ...] = (25.0,)
    """Mean distances from one traffic vehicle to the next, m."""
    vehicles_behind: tuple[int, ...] = (0,)
    """Numbers of traffic vehicles behind the ego."""

    def points(self) -> list["Point"]:
        """Every start, the last axis fastest."""
        return [Point(*values) for values in itertools.product(*vars(self).values())]

    @property
    def traffics(self) -> int:
        """Starts that differ in their traffic alone; they stand side by side."""
        return len(self.spacing) * len(self.vehicles_behind)


class Place(Protocol):
    """A cell of any grid, of which the world needs to know how an episode starts."""

    @property
    def start_numbers(self) -> dict[str, float]:
        """Numbers of its `trap.Start`; what is missing is the scenario's."""


class Point(NamedTuple):
    """One start of a grid; fields as `Grid`."""

    ego_speed: float
    trap_speed: float
    lanes: int
    front_distance: float
    side_distance: float
    spacing: float
    vehicles_behind: int

    @property
    def start_numbers(self) -> dict[str, float]:
        """Numbers of its `trap.Start`; what is missing is the scenario's."""
        return self._asdict()


SETTINGS = {
    "ego_speed": "scenario.ego_speed",
    "trap_speed": "scenario.trap_speed",
    "lanes": "scenario.lanes",
    "front_distance": "scenario.test_front_distance",
    "side_distance": "scenario.test_side_distance",
    "spacing": "scenario.traffic.spacing",
    "vehicles_behind": "scenario.traffic.vehicles_behind",
}
"""The setting that each axis varies."""


def check(grid: Grid) -> None:
    """Refuse an axis that names a value twice: its starts would count double."""
    for axis, values in vars(grid).items():
        for value in values:
            if values.count(value) > 1:
                flag = axis.replace("_", "-")
                raise SettingsError(f"--{flag}: {show(value)} is given twice")


def check_searchable(scenario: TrapSettings) -> None:
    """Refuse a trap whose starts `reachability` cannot judge."""
    if scenario.trap_speed_wave:
        raise SettingsError(
            "--scenario.trap-speed-wave must be 0: whether a start can be won is searched for with "
            "trap cars of constant speed"
        )


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
class PointResult:
    """What came of a start's episodes."""

    episodes: int
    successes: int
    """Past the trap, and no accident, not even later."""
    collision: int
    off_road: int
    stopped: int
    speed: float
    """Mean of the episodes' average speeds, m/s."""
    reward: float
    """Mean accumulated reward."""
    escapes: int
    """The paper's successes: past the trap, whatever happened later."""


@dataclass(frozen=True)
class Cell:
    """A start of the grid with all that is known of it."""

    point: Point
    reach: Reach
    outcome: PointResult


DENOMINATORS: dict[str, Callable[[Reach], bool]] = {
    "all": lambda reach: True,
    "winnable": lambda reach: reach.winnable,
    "winnable_with_clearance": lambda reach: reach.clear,
}
"""Over which starts a share is taken."""


@dataclass(frozen=True)
class Share:
    """Episodes of some starts, pooled."""

    starts: int
    episodes: int
    escapes: int
    successes: int
    accidents: dict[str, int]

    @property
    def counts(self) -> dict[str, int]:
        """Episodes by outcome; `rate` takes the same names."""
        accidents = sum(self.accidents.values())
        return {"escape": self.escapes, "success": self.successes, "accident": accidents}

    def rate(self, outcome: str) -> float:
        """How often an outcome came, of 1; NaN without episodes."""
        return self.counts[outcome] / self.episodes if self.episodes else nan

    def to_json(self) -> dict[str, Any]:
        """The counts, the rates and their exact 95 % intervals."""
        stored: dict[str, Any] = dict(vars(self))
        for outcome, count in self.counts.items():
            interval = clopper_pearson(count, self.episodes) if self.episodes else None
            stored |= {f"{outcome}_rate": self.rate(outcome), f"{outcome}_interval": interval}
        return stored


def pool(cells: Sequence[Cell], denominator: str = "all") -> Share:
    """The episodes of those cells that count under a denominator."""
    counted = [cell.outcome for cell in cells if DENOMINATORS[denominator](cell.reach)]
    return Share(
        starts=len(counted),
        episodes=sum(outcome.episodes for outcome in counted),
        escapes=sum(outcome.escapes for outcome in counted),
        successes=sum(outcome.successes for outcome in counted),
        accidents={cause: sum(getattr(o, cause) for o in counted) for cause in CAUSES},
    )


def fold(cells: Sequence[Cell], *axes: str) -> dict[tuple[float, ...], list[Cell]]:
    """The cells by their values on some axes; all other axes are folded together."""
    groups: dict[tuple[float, ...], list[Cell]] = {}
    for cell in cells:
        groups.setdefault(tuple(getattr(cell.point, axis) for axis in axes), []).append(cell)
    return groups
