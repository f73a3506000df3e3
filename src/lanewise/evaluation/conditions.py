"""Conditions a controller may meet: their axes as data. Imports no JAX."""

import itertools
from dataclasses import dataclass
from typing import NamedTuple

from lanewise.scenario.populations import POPULATIONS
from lanewise.scenario.settings import TrapSettings
from lanewise.world.settings import PAPER_DRIVER

HORIZONS = (25, 60, 120)
"""After how many seconds a drive is judged; the first is that of the paper's test."""
JUDGED = 1
"""Index of the horizon by which accidents are compared."""
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

    def places(self) -> list[Condition]:
        """All cells in the order of driving."""
        return [condition for group in self.groups() for condition in group]

    def searched(self) -> list[Condition]:
        """One condition of each approach that may be winnable."""
        return [condition for condition in self.groups()[0] if condition.lanes >= FEWEST_LANES]


def seen_in_training(scenario: TrapSettings) -> tuple[str, ...]:
    """Populations that a controller trained on this scenario has met; those of its traffic."""
    named = scenario.training_populations or scenario.traffic.populations
    if named or scenario.traffic.driver != PAPER_DRIVER:
        return named
    return ("paper",)
