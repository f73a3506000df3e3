"""A grid of starts: its axes as data. Imports no JAX."""

import itertools
from dataclasses import dataclass
from typing import NamedTuple

from lanewise.errors import SettingsError
from lanewise.scenario.settings import TrapSettings

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

    def places(self) -> list["Point"]:
        """Every start, the last axis fastest."""
        return [Point(*values) for values in itertools.product(*vars(self).values())]

    def searched(self) -> list["Point"]:
        """One start of each approach."""
        # Starts that differ in their traffic alone stand side by side.
        return self.places()[:: len(self.spacing) * len(self.vehicles_behind)]


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
    def approach(self) -> tuple[float, ...]:
        """All but the traffic, on which it does not depend whether a start can be won."""
        return self[:5]

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


def check_searchable(scenario: TrapSettings) -> None:
    """Refuse a trap whose starts `reachability` cannot judge."""
    if scenario.trap_speed_wave:
        raise SettingsError(
            "--scenario.trap-speed-wave must be 0: whether a start can be won is searched for with "
            "trap cars of constant speed"
        )
