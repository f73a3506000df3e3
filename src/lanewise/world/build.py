"""Build drivers and vehicles of a world from settings and places, padded to a static maximum."""

from collections.abc import Sequence

import jax.numpy as jnp
from jax import Array
from jax.typing import ArrayLike, DTypeLike

from lanewise.errors import SettingsError
from lanewise.world.settings import CAR_LENGTH, CAR_WIDTH, DriverSettings
from lanewise.world.state import RULE_BASED, Drivers, Vehicles
from lanewise.world.steering import slip_sine


def padded(values: ArrayLike, maximum: int, fill: float = 0) -> Array:
    """Extend [n] to [maximum] with ``fill``.

    Raises:
        SettingsError: there are more values than that.
    """
    array = jnp.asarray(values)
    missing = maximum - array.shape[0]
    if missing < 0:
        raise SettingsError(f"{array.shape[0]} vehicles do not fit into a world of {maximum}")
    return jnp.pad(array, (0, missing), constant_values=fill)


def make_drivers(
    settings: Sequence[DriverSettings],
    kinds: Sequence[int],
    maximum: int | None = None,
    dtype: DTypeLike = jnp.float32,
    missing_target_speed: bool = True,
    checks_collisions: bool = True,
) -> Drivers:
    """Drivers from one `DriverSettings` and one kind per vehicle; [maximum].

    Args:
        settings: how each vehicle's driver drives.
        kinds: EXTERNAL, CONSTANT or RULE_BASED, per vehicle.
        maximum: static number of vehicles; absent ones drive like the last.
        dtype: of the numbers.
        missing_target_speed: vehicles that are not rule-based seem to want to stop, as in
            highway-env; otherwise they seem to want their setting's target speed.
        checks_collisions: whether vehicles check their collisions.

    Raises:
        SettingsError: settings and kinds differ in number, or exceed the maximum.
    """
    if len(settings) != len(kinds) or not settings:
        raise SettingsError(f"{len(settings)} driver settings for {len(kinds)} vehicles")
    size = len(kinds) if maximum is None else maximum
    everyone = [*settings, *[settings[-1]] * (size - len(settings))]

    def of(name: str) -> Array:
        return padded(jnp.asarray([getattr(s, name) for s in everyone], dtype), size)

    kind = padded(jnp.asarray(kinds, jnp.int32), size)
    target_speed = of("target_speed")
    if missing_target_speed:
        target_speed = jnp.where(kind == RULE_BASED, target_speed, 0)
    return Drivers(
        kind=kind,
        target_speed=target_speed,
        comfort_acceleration=of("comfort_acceleration"),
        comfort_deceleration=of("comfort_deceleration"),
        jam_distance=of("jam_distance"),
        time_gap=of("time_gap"),
        exponent=of("exponent"),
        politeness=of("politeness"),
        minimum_gain=of("minimum_gain"),
        imposed_braking=of("imposed_braking"),
        change_delay=of("change_delay"),
        acceleration_limit=of("acceleration_limit"),
        slip_limit=slip_sine(of("steering_limit")),
        changes_lanes=jnp.asarray([s.changes_lanes for s in everyone]),
        checks_collisions=jnp.full(size, checks_collisions),
        length=jnp.full(size, CAR_LENGTH, dtype),
        width=jnp.full(size, CAR_WIDTH, dtype),
    )


def initial_timer(x: ArrayLike, y: ArrayLike, change_delay: ArrayLike = 1.0) -> Array:
    """highway-env's start of the lane-change timer, (x + y) pi mod delay, s; any shape."""
    return jnp.mod((jnp.asarray(x) + jnp.asarray(y)) * jnp.pi, jnp.asarray(change_delay))


def make_vehicles(
    x: ArrayLike,
    y: ArrayLike,
    speed: ArrayLike,
    lane: ArrayLike,
    maximum: int | None = None,
    heading: ArrayLike | None = None,
    timer: ArrayLike | None = None,
    dtype: DTypeLike = jnp.float32,
) -> Vehicles:
    """Vehicles at rest in their commands, [maximum]: nothing commanded, nobody crashed.

    Args:
        x: [n] m.
        y: [n] m.
        speed: [n] m/s.
        lane: int [n], which each vehicle follows.
        maximum: static number of vehicles.
        heading: [n] rad; along the road if none is given.
        timer: [n] s; zeros and a missing timer become `initial_timer` with a delay of 1 s.
        dtype: of the numbers.

    Raises:
        SettingsError: more vehicles than the maximum.
    """
    place_x, place_y = jnp.asarray(x, dtype), jnp.asarray(y, dtype)
    count = place_x.shape[0]
    size = count if maximum is None else maximum
    own_timer = initial_timer(place_x, place_y)
    if timer is not None:
        given = jnp.asarray(timer, dtype)
        own_timer = jnp.where(given != 0, given, own_timer)
    zeros = jnp.zeros(size, dtype)
    no = jnp.zeros(size, bool)
    return Vehicles(
        present=padded(jnp.ones(count, bool), size),
        x=padded(place_x, size),
        y=padded(place_y, size),
        heading=zeros if heading is None else padded(jnp.asarray(heading, dtype), size),
        speed=padded(jnp.asarray(speed, dtype), size),
        slip_sine=zeros,
        acceleration=zeros,
        target_lane=padded(jnp.asarray(lane, jnp.int32), size),
        timer=padded(own_timer, size),
        crashed=no,
        impacted=no,
        impact_x=zeros,
        impact_y=zeros,
    )
