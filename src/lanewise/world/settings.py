"""Settings of the road's physics and of the drivers on it. Imports no JAX."""

from dataclasses import dataclass, field, replace
from math import pi
from typing import Annotated

from lanewise.fields.ranges import Between, OneOf

CAR_LENGTH, CAR_WIDTH = 5.0, 2.0
"""Size of every car, m; highway-env's and the paper's."""
TOP_SPEED = 40.0
"""Beyond plus or minus this speed the *acceleration* is limited, m/s; speed itself never is."""
FARTHEST = 131_072.0
"""A road ends this far from x = 0 both ways, m: up to there float32 places are finer than 1 cm."""


@dataclass(frozen=True)
class LinearSettings:
    """Gains of a driver with the model `linear`; the defaults are those of highway-env."""

    target_speed_gain: Annotated[float, Between(0.0, 10.0, "1/s")] = 0.3
    """Acceleration for each m/s below the target speed; braking above it. The target speed is not
    clipped to the speed limit."""
    relative_speed_gain: Annotated[float, Between(0.0, 10.0, "1/s")] = 0.3
    """Braking for each m/s faster than the vehicle ahead."""
    gap_gain: Annotated[float, Between(0.0, 10.0, "1/s^2")] = 2.0
    """Braking for each metre nearer to the vehicle ahead than the jam distance and the time gap."""
    heading_gain: Annotated[float, Between(0.0, 20.0, "1/s")] = 5.0
    """Turning back, in rad/s, for each radian off the direction of the lane."""
    offset_gain: Annotated[float, Between(0.0, 50.0, "1/s^2")] = 5.0 * (1 / 0.6)
    """Acceleration across the road, in m/s^2, for each metre off the centre of the lane."""


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
    model: Annotated[str, OneOf(("idm", "linear"))] = "idm"
    """How the driver follows a leader and its lane: by the IDM and nested gains, or as a
    LinearVehicle of highway-env, with S0 and T of the IDM. Both change lanes by MOBIL."""
    linear: LinearSettings = field(default_factory=LinearSettings)
    """Gains of the model `linear`; without effect on the model `idm`."""


PAPER_DRIVER = DriverSettings()
"""The paper's IDM and MOBIL."""
HIGHWAY_ENV_DRIVER = DriverSettings(
    target_speed=22.5,
    comfort_acceleration=3.0,
    comfort_deceleration=5.0,
    politeness=0.0,
    acceleration_limit=6.0,
    steering_limit=pi / 3,
)
"""highway-env's ``IDMVehicle`` before its exponent is randomised. There the target speed is the
speed at the start, by default 21 to 24 m/s; here it is the mean."""
LINEAR_DRIVER = replace(HIGHWAY_ENV_DRIVER, model="linear", time_gap=2.5)
"""highway-env's ``LinearVehicle`` before its gains are randomised."""
AGGRESSIVE_DRIVER = replace(
    LINEAR_DRIVER,
    minimum_gain=1.0,
    linear=LinearSettings(0.8 / (0.25 * 30), 0.8 / (0.75 * 30), 0.5),
)
"""highway-env's ``AggressiveVehicle`` before its gains are randomised."""
DEFENSIVE_DRIVER = replace(
    LINEAR_DRIVER,
    minimum_gain=1.0,
    linear=LinearSettings(1.2 / (0.25 * 30), 1.2 / (0.75 * 30), 2.0),
)
"""highway-env's ``DefensiveVehicle`` before its gains are randomised."""
