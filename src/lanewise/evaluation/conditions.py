"""Conditions a controller may meet: their axes as data, and what came of each. Imports no JAX.

One drive as long as the last horizon gives the outcome at every horizon: no controller knows when
its test ends.
"""

import itertools
from collections.abc import Sequence
from dataclasses import dataclass
from math import nan
from typing import NamedTuple

import numpy as np

from lanewise.errors import SettingsError
from lanewise.evaluation.episodes import ACCIDENT_KINDS, Episodes
from lanewise.evaluation.statistics import Interval, clopper_pearson
from lanewise.fields.ranges import show
from lanewise.scenario.populations import POPULATIONS
from lanewise.scenario.settings import TrapSettings
from lanewise.world.settings import PAPER_DRIVER

HORIZONS = (25, 60, 120)
"""After how many seconds a drive is judged; the first is that of the paper's test."""
JUDGED = 1
"""Index of the horizon by which accidents are compared."""
KINDS = tuple(ACCIDENT_KINDS)[1:]
"""Kinds of accidents, in the order in which they are counted."""
EMPTY, NOBODY = "empty", "nobody"
"""The density without traffic, and its population."""
FEWEST_LANES = 3
"""The trap takes two lanes: with no third, the right drive is to follow it."""


class Density(NamedTuple):
    """How much traffic there is."""

    vehicles_ahead: int
    vehicles_behind: int
    spacing: float
    """Mean distance from one vehicle to the next, m."""


DENSITIES = {
    EMPTY: Density(0, 0, 25.0),
    "light": Density(9, 2, 40.0),
    "medium": Density(9, 2, 25.0),
    "dense": Density(12, 4, 15.0),
}


class Condition(NamedTuple):
    """One combination of all axes: a cell of the grid."""

    population: str
    """A name in `POPULATIONS`, or `NOBODY`."""
    density: str
    """A name in `DENSITIES`."""
    ego_speed: float
    """m/s, at the start."""
    trap_speed: float
    """m/s."""
    lanes: int
    noise: float
    """Of the observation, see `ObservationSettings.noise`."""
    latency: float
    """Of decisions, s."""

    @property
    def approach(self) -> tuple[float, float, int]:
        """Speeds of ego and trap, m/s, and lanes: what can be won depends on nothing else."""
        return self.ego_speed, self.trap_speed, self.lanes

    @property
    def start_numbers(self) -> dict[str, float]:
        """Numbers of its `trap.Start`; what is missing is the scenario's."""
        return dict(zip(("ego_speed", "trap_speed", "lanes"), self.approach, strict=True))

    @property
    def settings(self) -> dict[str, object]:
        """What it changes in the settings of a run, by dotted name."""
        traffic = DENSITIES[self.density]._asdict()
        populations = () if self.population == NOBODY else (self.population,)
        return {
            "scenario.lanes": self.lanes,
            "scenario.ego_speed": self.ego_speed,
            "scenario.trap_speed": self.trap_speed,
            **{f"scenario.traffic.{name}": value for name, value in traffic.items()},
            "scenario.traffic.populations": populations,
            "driving.observation.noise": self.noise,
            "driving.latency": self.latency,
        }


@dataclass(frozen=True)
class ConditionGrid:
    """The axes; every combination of one value each is a cell."""

    population: tuple[str, ...] = tuple(POPULATIONS)
    density: tuple[str, ...] = tuple(DENSITIES)
    speeds: tuple[tuple[float, float], ...] = (
        (10.0, 10.0),
        (12.0, 10.0),
        (10.0, 8.0),
        (13.0, 11.0),
    )
    """Speeds of the ego and of the trap, m/s."""
    lanes: tuple[int, ...] = (2, 3, 5)
    noise: tuple[float, ...] = (0.0, 0.05)
    latency: tuple[float, ...] = (0.0, 0.2)
    """s."""

    def groups(self) -> list[list[Condition]]:
        """All cells in the order of driving; those of a group differ in speeds and lanes alone.

        Noise and latency vary slowest, because each pair of them is a compiled program. Without
        traffic it does not matter who drives it: such cells have no population.
        """
        traffic = [d for d in self.density if d != EMPTY]
        who = [(NOBODY, EMPTY)] if EMPTY in self.density else []
        who += itertools.product(self.population, traffic)
        return [
            [
                Condition(population, density, *speeds, lanes, noise, latency)
                for speeds, lanes in itertools.product(self.speeds, self.lanes)
            ]
            for noise, latency, (population, density) in itertools.product(
                self.noise, self.latency, who
            )
        ]

    def searched(self) -> list[Condition]:
        """One condition of each approach that may be winnable."""
        return [condition for condition in self.groups()[0] if condition.lanes >= FEWEST_LANES]


def check(grid: ConditionGrid) -> None:
    """Refuse an axis that names a value twice: its cells would count double."""
    for axis, values in vars(grid).items():
        for value in values:
            if values.count(value) > 1:
                flag = "ego-speed and --trap-speed" if axis == "speeds" else axis
                raise SettingsError(f"--{flag}: {show(value)} is given twice")


def seen_in_training(scenario: TrapSettings) -> tuple[str, ...]:
    """Populations that a controller trained on this scenario has met; those of its traffic."""
    named = scenario.training_populations or scenario.traffic.populations
    if named or scenario.traffic.driver != PAPER_DRIVER:
        return named
    return ("paper",)


@dataclass(frozen=True)
class ConditionOutcome:
    """What came of a condition's episodes; each list by horizon."""

    episodes: int
    escapes: list[int]
    """The paper's successes: past the trap by then."""
    successes: list[int]
    """Past the trap by then, and no accident by then, not even afterwards."""
    kinds: list[list[int]]
    """Accidents by then, in the order of `KINDS`."""
    first_accident: list[int]
    """The first episode with an accident by then; -1 where there is none."""

    def at(self, horizon: int) -> "HorizonCounts":
        """The counts at a horizon, by its index."""
        return HorizonCounts(
            1,
            self.episodes,
            self.escapes[horizon],
            self.successes[horizon],
            tuple(self.kinds[horizon]),
        )


def outcome(episodes: Episodes, limits: Sequence[float]) -> ConditionOutcome:
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
    return ConditionOutcome(len(episodes), escapes, successes, kinds, first)


@dataclass(frozen=True)
class ConditionCell:
    """A condition with all that is known of it."""

    condition: Condition
    winnable: bool
    """Whether its start can be won by the first horizon, other traffic left out."""
    outcome: ConditionOutcome


@dataclass(frozen=True)
class HorizonCounts:
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
        """``escapes``, ``successes`` or ``accidents`` of 1; NaN without episodes."""
        return float(getattr(self, name)) / self.episodes if self.episodes else nan

    def interval(self, name: str) -> Interval | None:
        """Its exact 95 % interval, fractions of 1; None without episodes."""
        return clopper_pearson(getattr(self, name), self.episodes) if self.episodes else None


def pooled(cells: Sequence[ConditionCell], horizon: int, winnable: bool = False) -> HorizonCounts:
    """The episodes of all cells, or of the winnable ones alone, at a horizon's index."""
    counts = [cell.outcome.at(horizon) for cell in cells if cell.winnable or not winnable]
    return HorizonCounts(
        cells=len(counts),
        episodes=sum(c.episodes for c in counts),
        escapes=sum(c.escapes for c in counts),
        successes=sum(c.successes for c in counts),
        kinds=tuple(sum(c.kinds[kind] for c in counts) for kind in range(len(KINDS))),
    )
