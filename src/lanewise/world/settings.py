"""Settings of the road's physics and of the drivers on it. Imports no JAX."""

from dataclasses import dataclass
from math import pi
from typing import Annotated

from lanewise.fields.ranges import Between

CAR_LENGTH, CAR_WIDTH = 5.0, 2.0
"""Size of every car, m; highway-env's and the paper's."""
TOP_SPEED = 40.0
"""Beyond plus or minus this speed the *acceleration* is limited, m/s; speed itself never is."""
FARTHEST = 131_072.0
"""A road ends this far from x = 0 both ways, m: up to there float32 places are finer than 1 cm."""


@dataclass(frozen=True)
class DriverSettings:
    """How a rule-based driver drives; the defaults are the paper's table of traffic parameters."""

    target_speed: Annotated[float, Between(0.0, 60.0, "m/s")] = 12.5
    """Desired speed of the IDM (v_desired)."""
    comfort_acceleration: Annotated[float, Between(0.01, 10.0, "m/s^2")] = 0.5
    """IDM acceleration a."""
    comfort_deceleration: Annotated[float, Between(0.01, 10.0, "m/s^2")] = 0.5
    """IDM deceleration b, as a positive number."""
    jam_distance: Annotated[float, Between(0.0, 100.0, "m")] = 10.0
    """IDM distance S0, centre to centre: it already contains one car length."""
    time_gap: Annotated[float, Between(0.0, 10.0, "s")] = 1.5
    """IDM time gap T."""
    exponent: Annotated[float, Between(0.1, 20.0)] = 4.0
    """IDM exponent delta of the free-road term. Above 4, highway-env loses gains of MOBIL in
    rounding, which float32 does not (`cancelled-free-road-term` in numerics.md)."""
    politeness: Annotated[float, Between(0.0, 10.0)] = 0.5
    """MOBIL politeness p."""
    minimum_gain: Annotated[float, Between(-10.0, 10.0, "m/s^2")] = 0.2
    """MOBIL threshold: a change must gain at least this."""
    imposed_braking: Annotated[float, Between(0.0, 20.0, "m/s^2")] = 2.0
    """MOBIL safety: the hardest braking a change may force on the new rear vehicle."""
    change_delay: Annotated[float, Between(0.001, 60.0, "s")] = 1.0
    """A driver considers a lane change when its timer is strictly above this. In float32, delays
    other than 1 s may end a tick apart from highway-env (`timer-in-float32` in numerics.md)."""
    acceleration_limit: Annotated[float, Between(0.0, 20.0, "m/s^2")] = 1.0
    """Accelerations are clipped to plus and minus this."""
    steering_limit: Annotated[float, Between(0.0, 1.5, "rad")] = pi / 36
    """Steering angles are clipped to plus and minus this."""
    changes_lanes: bool = True
    """Whether the driver changes lanes at all."""


PAPER_DRIVER = DriverSettings()
"""The paper's IDM and MOBIL."""
