"""Populations of drivers as data: how the vehicles around the ego drive, with sources. No JAX.

A vehicle of a population drives by `Population.driver`, with the numbers of `Population.ranges`
drawn anew for each vehicle. Gaps are centre to centre, as highway-env counts them, so that a
published bumper gap stands here with one car length added. Nobody's desired speed is taken over:
it is a share of the scenario's traffic speed, so that populations meet the ego at like speeds.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

from lanewise.world.settings import (
    AGGRESSIVE_DRIVER,
    CAR_LENGTH,
    DEFENSIVE_DRIVER,
    HIGHWAY_ENV_DRIVER,
    PAPER_DRIVER,
    DriverSettings,
)

Range = tuple[float, float]


@dataclass(frozen=True)
class Population:
    """Drivers of one kind. Ranges are uniform and drawn for each vehicle."""

    source: str
    """Where the numbers come from."""
    driver: DriverSettings = PAPER_DRIVER
    """What all have in common; the desired speed is not taken from here."""
    ranges: Mapping[str, Range] = field(default_factory=dict)
    """By field of `DriverSettings`."""
    desired_speed: Range = (1.0, 1.0)
    """As a share of the traffic's speed."""
    wave: Range = (0.0, 0.0)
    """How far the desired speed swings both ways, as a share of itself."""
    period: Range = (20.0, 20.0)
    """Of one swing, s."""

    @property
    def waves(self) -> bool:
        """Whether desired speeds swing at all."""
        return self.wave[1] > 0


POPULATIONS: dict[str, Population] = {
    "paper": Population(source="the paper's table of traffic parameters"),
    "highway-env": Population(
        source="IDMVehicle of highway-env 1.12.1; the exponent as randomize_behavior draws it",
        driver=HIGHWAY_ENV_DRIVER,
        ranges={"exponent": (3.5, 4.5)},
    ),
    "aggressive": Population(
        source="AggressiveVehicle of highway-env 1.12.1", driver=AGGRESSIVE_DRIVER
    ),
    "defensive": Population(
        source="DefensiveVehicle of highway-env 1.12.1", driver=DEFENSIVE_DRIVER
    ),
    "highd": Population(
        source="AR(4)+IDM of Zhang, Wang and Sun 2024 (arXiv 2307.03340): means over drivers on "
        "German motorways (highD), read from github.com/Chengyuan-Zhang/IDM_Bayesian_Calibration "
        "at 7520b15; changes of lane, which it does not calibrate, as the paper's drivers",
        driver=replace(
            PAPER_DRIVER,
            comfort_acceleration=1.46,
            comfort_deceleration=2.40,
            jam_distance=3.22 + CAR_LENGTH,
            time_gap=1.17,
            acceleration_limit=3.0,
        ),
        desired_speed=(0.9, 1.2),
    ),
    "impolite": Population(
        source="ours: the paper's drivers without politeness, content with any gain",
        driver=PAPER_DRIVER,
        ranges={"politeness": (0.0, 0.0), "minimum_gain": (0.0, 0.1), "time_gap": (0.8, 1.2)},
        desired_speed=(0.95, 1.2),
    ),
    "timid": Population(
        source="ours: long gaps, slow to accelerate, lanes changed for a large gain alone",
        driver=PAPER_DRIVER,
        ranges={
            "time_gap": (2.0, 2.8),
            "comfort_acceleration": (0.3, 0.5),
            "politeness": (0.8, 1.0),
            "minimum_gain": (0.4, 0.6),
        },
        desired_speed=(0.8, 1.0),
    ),
    "stop-and-go": Population(
        source="ours: the paper's drivers, their desired speed swinging as in a jam's waves",
        driver=PAPER_DRIVER,
        ranges={"comfort_acceleration": (0.8, 1.2), "comfort_deceleration": (1.0, 1.5)},
        desired_speed=(0.85, 1.0),
        wave=(0.2, 0.4),
        period=(15.0, 40.0),
    ),
    "cutting-in": Population(
        source="ours: changes lanes for nothing and lets those behind brake hard",
        driver=PAPER_DRIVER,
        ranges={
            "politeness": (0.0, 0.0),
            "minimum_gain": (-0.1, 0.0),
            "imposed_braking": (3.0, 4.0),
            "time_gap": (0.8, 1.2),
        },
        desired_speed=(0.9, 1.1),
    ),
}
"""By name; a scenario names some, and each vehicle is of one of them, all equally likely."""
