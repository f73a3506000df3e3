"""Settings of the trap: who stands where at the start, and who drives how. Imports no JAX."""

from dataclasses import dataclass, field
from typing import Annotated

from lanewise.fields.ranges import Between, OneOf, OrNone
from lanewise.scenario.populations import POPULATIONS
from lanewise.world.settings import PAPER_DRIVER, DriverSettings

Metres = Between(0.0, 1000.0, "m")
MetresPerSecond = Between(0.0, 60.0, "m/s")
Lanes = Between(2, 8)
EgoSpeed = Between(1.0, 40.0, "m/s")
TrapSpeed = Between(0.5, 40.0, "m/s")
FrontDistance = Between(5.0, 200.0, "m")
SideDistance = Between(-200.0, 200.0, "m")
Vehicles = Between(0, 100)
Difference = Between(0.0, 20.0, "m/s")
Populations = OneOf(tuple(POPULATIONS))


@dataclass(frozen=True)
class TrafficSettings:
    """Ordinary traffic around the trap."""

    vehicles_ahead: Annotated[int, Vehicles] = 9
    """Vehicles ahead of the trap, in lanes at random."""
    first_gap: Annotated[float, Metres] = 45.0
    """From the front trap car to the first vehicle ahead, centre to centre."""
    spacing: Annotated[float, Metres] = 25.0
    """Mean distance from one vehicle to the next along the road, centre to centre."""
    spacing_jitter: Annotated[float, Metres] = 5.0
    """Each distance varies uniformly by plus or minus this."""
    vehicles_behind: Annotated[int, Vehicles] = 0
    """Vehicles behind the ego; the paper's "further upstream" may mean these (row 9)."""
    gap_behind: Annotated[float, Metres] = 45.0
    """From the ego to the first vehicle behind, centre to centre."""
    speed: Annotated[float, MetresPerSecond] = 12.5
    """Initial speed of every traffic vehicle."""
    driver: DriverSettings = field(default_factory=lambda: PAPER_DRIVER)
    """How traffic drives."""
    populations: Annotated[tuple[str, ...], Populations, OrNone(0)] = ()
    """Whose drivers the traffic consists of, one for each vehicle, all equally likely
    (docs/settings.md); empty: everybody drives as `driver`."""


@dataclass(frozen=True)
class TrapSettings:
    """A slow car ahead of the ego and another in the lane to its right, at one constant speed.

    The ego starts in the far-left lane at x = 0. Distances are centre to centre (row 8 of the
    reading). The defaults are preset ``trap-10``; ``trap-10.9`` differs in ``trap_speed``.
    """

    lanes: Annotated[int, Lanes] = 3
    """Number of lanes; the trap takes two."""
    lane_width: Annotated[float, Between(2.5, 10.0, "m")] = 4.0
    """Width of every lane."""
    speed_limit: Annotated[float, Between(1.0, 60.0, "m/s")] = 30.0
    """Speed limit of every lane; drivers' target speeds are clipped to it."""
    ego_driver: Annotated[str, OneOf(("controller", "rule-based"))] = "controller"
    """Who drives the ego: a controller, or the rules of the traffic (IDM and MOBIL), which is the
    reference driver `rule-based`."""
    ego_speed: Annotated[float, EgoSpeed] = 10.0
    """The ego's speed at the start."""
    trap_speed: Annotated[float, TrapSpeed] = 10.0
    """Speed of both trap cars, all episode long."""
    trap_speed_difference: Annotated[float, Difference] = 0.0
    """How much faster the trap car on the right is than the one ahead."""
    trap_speed_wave: Annotated[float, Difference] = 0.0
    """How far the speed of the trap cars swings both ways, each at its own time."""
    trap_wave_period: Annotated[float, Between(1.0, 1000.0, "s")] = 20.0
    """Of one swing."""
    training_ego_speed: Annotated[tuple[float, ...], EgoSpeed, OrNone(2)] = ()
    """The ego's speed in training and validation: uniform between the two; empty: as in tests."""
    training_trap_speed: Annotated[tuple[float, ...], TrapSpeed, OrNone(2)] = ()
    """Speed of the trap in training and validation: uniform between the two; empty: as in tests."""
    training_lanes: Annotated[tuple[int, ...], Lanes, OrNone(2)] = ()
    """Number of lanes in training and validation: uniform from the first to the second; empty: as
    in tests."""
    training_front_distance: Annotated[tuple[float, float], FrontDistance] = (
        14.80,
        16.44,
    )
    """D1 in training and validation: uniform between the two."""
    training_side_distance: Annotated[tuple[float, float], SideDistance] = (
        4.06,
        7.43,
    )
    """D2 in training and validation: uniform between the two."""
    training_braking: Annotated[float, Between(0.0, 10.0, "m/s^2")] = 0.0
    """In training and validation the ego is no faster than this braking can make up for before it
    is 1 m behind the trap car ahead, so that an accident can be avoided; 0: as fast as drawn."""
    training_trap_speed_difference: Annotated[tuple[float, ...], Difference, OrNone(2)] = ()
    """The difference of the trap cars' speeds in training and validation; empty: as in tests."""
    training_trap_speed_wave: Annotated[tuple[float, ...], Difference, OrNone(2)] = ()
    """The swing of the trap cars' speeds in training and validation; empty: as in tests."""
    training_traffic_speed: Annotated[tuple[float, ...], MetresPerSecond, OrNone(2)] = ()
    """Speed of the traffic in training and validation, at the start, from which populations take
    their desired speeds; empty: as in tests."""
    training_spacing: Annotated[tuple[float, ...], Metres, OrNone(2)] = ()
    """Mean distance of the traffic in training and validation; empty: as in tests."""
    training_vehicles_ahead: Annotated[tuple[int, ...], Vehicles, OrNone(2)] = ()
    """Vehicles ahead of the trap in training and validation; empty: as in tests."""
    training_vehicles_behind: Annotated[tuple[int, ...], Vehicles, OrNone(2)] = ()
    """Vehicles behind the ego in training and validation; empty: as in tests."""
    training_gap_behind: Annotated[tuple[float, ...], Metres, OrNone(2)] = ()
    """From the ego to the first vehicle behind in training and validation; empty: as in tests."""
    training_populations: Annotated[tuple[str, ...], Populations, OrNone(0)] = ()
    """Whose drivers the traffic consists of in training and validation; empty: as in tests."""
    test_front_distance: Annotated[float, FrontDistance] = 15.62
    """D1 in tests."""
    test_side_distance: Annotated[float, SideDistance] = 6.61
    """D2 in tests."""
    missing_target_speed: bool = True
    """Keep highway-env's quirk: traffic believes that the ego and the trap cars want to stop.
    Drivers with the model `linear` believe that they want to keep their speed."""
    traffic: TrafficSettings = field(default_factory=TrafficSettings)
    """Ordinary traffic."""
