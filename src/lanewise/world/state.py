"""The state of one world: a road, its drivers, and the vehicles on it, as flat arrays.

Shapes: ``N`` vehicles and ``M`` lanes, both static maxima; ``present`` masks tell which exist.
Frame: x along the road, y across it, growing to the right (lane 0 is the leftmost);
headings in radians, positive to the right. Vehicle order is meaningful: it is the order in
which highway-env lets vehicles decide and breaks ties. The ego, where there is one, is vehicle 0.
Every function is written for one world; callers batch with ``jax.vmap``. What a tick calls also
takes worlds along trailing axes, arrays [N, ...] and [M, ...], which is how `tick.run` lays them
out: with vehicles along the first axis and worlds along the last, XLA's loops run over worlds.
"""

from dataclasses import dataclass

import jax
import jax.numpy as jnp
from jax import Array

EXTERNAL = 0
"""Driver kind: commands come from outside (the ego). A plain ``Vehicle`` of highway-env."""
CONSTANT = 1
"""Driver kind: keeps its commands for ever (the trap cars). A plain ``Vehicle`` of highway-env."""
RULE_BASED = 2
"""Driver kind: MOBIL and the IDM, or the `Linear` model. An ``IDMVehicle`` of highway-env."""


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Road:
    """Straight parallel lanes; nobody else knows how wide a lane is."""

    present: Array
    """bool [M]: does the lane exist."""
    centre: Array
    """[M] lateral position of the centre line, m."""
    width: Array
    """[M] m."""
    start: Array
    """[M] where the lane begins, m."""
    end: Array
    """[M] where the lane ends, m."""
    speed_limit: Array
    """[M] m/s."""
    open_to_change: Array
    """bool [M]: may drivers change into this lane."""


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Waves:
    """Whose speed swings around a mean, and how; see `lanewise.world.waves`."""

    mean: Array
    """[N] m/s."""
    amplitude: Array
    """[N] m/s; 0 for those whose speed does not swing."""
    period: Array
    """[N] s."""
    phase: Array
    """[N] share of a period at time 0, 0 to 1."""


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Linear:
    """Which rule-based drivers are highway-env's ``LinearVehicle``s, and their gains.

    See `linear` for the equations. MOBIL, and all other numbers, are as for every driver.
    """

    applies: Array
    """bool [N]: does the driver drive by it; the others by the IDM."""
    target_speed_gain: Array
    """[N] 1/s."""
    relative_speed_gain: Array
    """[N] 1/s."""
    gap_gain: Array
    """[N] 1/s^2."""
    heading_gain: Array
    """[N] 1/s."""
    offset_gain: Array
    """[N] 1/s^2."""


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Drivers:
    """Who drives each vehicle, and how; constant through an episode, but for waves.

    Fields as `DriverSettings`, but for the limit of the steering.
    """

    kind: Array
    """int32 [N]: EXTERNAL, CONSTANT or RULE_BASED."""
    target_speed: Array
    """[N] m/s; 0 for a plain vehicle reproduces highway-env's quirk `missing-target-speed`."""
    comfort_acceleration: Array
    """[N] m/s^2."""
    comfort_deceleration: Array
    """[N] m/s^2, positive."""
    jam_distance: Array
    """[N] m, centre to centre."""
    time_gap: Array
    """[N] s."""
    exponent: Array
    """[N]."""
    politeness: Array
    """[N]."""
    minimum_gain: Array
    """[N] m/s^2."""
    imposed_braking: Array
    """[N] m/s^2, positive."""
    change_delay: Array
    """[N] s."""
    acceleration_limit: Array
    """[N] m/s^2."""
    slip_limit: Array
    """[N] sine of the slip angle at the steering limit; see `Vehicles.slip_sine`."""
    changes_lanes: Array
    """bool [N]."""
    checks_collisions: Array
    """bool [N]: a pair is checked when either of the two checks."""
    length: Array
    """[N] m."""
    width: Array
    """[N] m."""
    linear: Linear | None = None
    """Those who drive by the linear model; None where nobody does, which costs nothing."""
    waves: Waves | None = None
    """Of speeds; None where nobody's swings."""


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Vehicles:
    """Where the vehicles are and what they are about to do."""

    present: Array
    """bool [N]."""
    x: Array
    """[N] centre along the road, m."""
    y: Array
    """[N] centre across the road, m, positive to the right."""
    heading: Array
    """[N] rad, positive to the right, not wrapped."""
    speed: Array
    """[N] m/s, along the heading; may be negative."""
    slip_sine: Array
    """[N] sine of the commanded slip angle: sin(atan(tan(steering) / 2))."""
    acceleration: Array
    """[N] commanded acceleration, m/s^2."""
    target_lane: Array
    """int32 [N] lane a rule-based driver follows; differs from its lane while it changes."""
    timer: Array
    """[N] s since the driver last thought about a lane change."""
    crashed: Array
    """bool [N]."""
    impacted: Array
    """bool [N]: a predicted hit moves this vehicle on the next tick."""
    impact_x: Array
    """[N] displacement of that hit, m."""
    impact_y: Array
    """[N] m."""


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class World:
    """All there is: a step is a pure function from one `World` to the next."""

    road: Road
    drivers: Drivers
    vehicles: Vehicles


def numbered(values: Array) -> Array:
    """The number of each vehicle, int32 [N, 1, ...], to be compared with arrays [N, ...]."""
    return jnp.arange(values.shape[0]).reshape(-1, *(1,) * (values.ndim - 1))


def select_by_index(values: Array, wanted: Array) -> Array:
    """``values[wanted]``, [Q, ...], of arrays [K, ...]; any of them where that is no index.

    By elementwise selection, as vehicles and lanes are few. A gather is slower on a CPU, and keeps
    XLA from using vector instructions in all that is computed from it.
    """
    result = jnp.broadcast_to(values[0], wanted.shape)
    for index in range(1, values.shape[0]):
        result = jnp.where(wanted == index, values[index], result)
    return result
