"""Who hits whom: the separating-axis test on moving rectangles, pair by pair.

``RoadObject.handle_collisions`` and ``utils.are_polygons_intersecting``. Of a pair, ``a`` is the
vehicle earlier in the list. Rectangles that overlap crash now; rectangles that will overlap within
a tick get an impact, which moves them and crashes them on the *next* tick.
"""

from dataclasses import replace
from typing import NamedTuple

import jax.numpy as jnp
from jax import Array
from jax.typing import ArrayLike

from lanewise.world.motion import over_vehicles
from lanewise.world.state import World


class Box(NamedTuple):
    """A moving rectangle, arrays of one shape."""

    x: Array
    """Centre, m."""
    y: Array
    """m."""
    cosine: Array
    """Of the heading."""
    sine: Array
    """Of the heading."""
    speed: Array
    """m/s."""
    half_length: Array
    """m."""
    half_width: Array
    """m."""
    half_diagonal: Array
    """m."""


class Overlap(NamedTuple):
    """What a pair of boxes does."""

    now: Array
    """bool: they overlap."""
    soon: Array
    """bool: they will within the tick."""
    x: Array
    """The shortest way to move ``a`` out of ``b``, m; meaningful where ``soon``."""
    y: Array
    """m."""


def boxes(world: World) -> Box:
    """Rectangles of all vehicles.

    Args:
        world: one world.

    Returns:
        Arrays [N].
    """
    vehicles, drivers = world.vehicles, world.drivers
    return Box(
        x=vehicles.x,
        y=vehicles.y,
        cosine=jnp.cos(vehicles.heading),
        sine=jnp.sin(vehicles.heading),
        speed=vehicles.speed,
        half_length=drivers.length / 2,
        half_width=drivers.width / 2,
        half_diagonal=jnp.sqrt(drivers.length**2 + drivers.width**2) / 2,
    )


def overlap(a: Box, b: Box, duration: ArrayLike) -> Overlap:
    """Separating-axis test of two boxes, now and within one tick at constant velocity.

    Along each normal n of both boxes, taken in the order back, right, front, left, ``a`` covers
    [p - r_a, p + r_a] stretched by its relative displacement and ``b`` covers [-r_b, r_b]. The
    normal with the least overlap is the way out, the first of equals.

    Args:
        a: earlier vehicle of the pair.
        b: later vehicle.
        duration: of the tick, s.

    Returns:
        The outcome, of the broadcast shape.
    """
    apart_x, apart_y = a.x - b.x, a.y - b.y
    shift_x = (a.speed * a.cosine - b.speed * b.cosine) * duration
    shift_y = (a.speed * a.sine - b.speed * b.sine) * duration
    reach = a.half_diagonal + b.half_diagonal + a.speed * duration
    near = jnp.sqrt(apart_x * apart_x + apart_y * apart_y) <= reach
    cosine = jnp.abs(a.cosine * b.cosine + a.sine * b.sine)
    sine = jnp.abs(a.cosine * b.sine - a.sine * b.cosine)

    now, soon = near, near
    least = jnp.full_like(apart_x, jnp.inf)
    way_x, way_y = jnp.zeros_like(apart_x), jnp.zeros_like(apart_x)
    for box, other in ((a, b), (b, a)):
        along = box.half_length, other.half_length * cosine + other.half_width * sine
        across = box.half_width, other.half_length * sine + other.half_width * cosine
        for normal_x, normal_y, (own, foreign) in (
            (-box.cosine, -box.sine, along),
            (-box.sine, box.cosine, across),
            (box.cosine, box.sine, along),
            (box.sine, -box.cosine, across),
        ):
            radius_a, radius_b = (own, foreign) if box is a else (foreign, own)
            centre = apart_x * normal_x + apart_y * normal_y
            shift = shift_x * normal_x + shift_y * normal_y
            low = centre - radius_a + jnp.minimum(shift, 0)
            high = centre + radius_a + jnp.maximum(shift, 0)
            depth = jnp.where(low < -radius_b, high + radius_b, radius_b - low)
            now &= jnp.abs(centre) <= radius_a + radius_b
            soon &= depth >= 0
            shallower = jnp.abs(depth) < least
            sign = jnp.where(centre > 0, 1, -1)
            least = jnp.where(shallower, jnp.abs(depth), least)
            way_x = jnp.where(shallower, sign * normal_x, way_x)
            way_y = jnp.where(shallower, sign * normal_y, way_y)
    return Overlap(now, soon, least * way_x, least * way_y)


def resolve(world: World, duration: ArrayLike) -> World:
    """Crash vehicles that overlap and set impacts on those about to.

    A pair is tested when either checks collisions. Each of the two is moved by half the way out.
    Pairs come in list order and later ones overwrite, so of several impacts on a vehicle the one
    with the last other vehicle stays (`last-impact-wins`).

    Args:
        world: one world, vehicles already moved.
        duration: of the tick, s.

    Returns:
        The world with `crashed` and impacts set.
    """
    vehicles, drivers = world.vehicles, world.drivers
    mine = boxes(world)
    index = jnp.arange(vehicles.x.shape[0])

    def meet(other: Array | int, state: tuple[Array, Array, Array, Array]) -> tuple[Array, ...]:
        crashed, impacted, impact_x, impact_y = state
        theirs = Box(*(value[other] for value in mine))
        first = index < other
        a = Box(*(jnp.where(first, m, t) for m, t in zip(mine, theirs, strict=True)))
        b = Box(*(jnp.where(first, t, m) for m, t in zip(mine, theirs, strict=True)))
        outcome = overlap(a, b, duration)
        tested = (
            (index != other)
            & vehicles.present
            & vehicles.present[other]
            & (drivers.checks_collisions | drivers.checks_collisions[other])
        )
        hit = tested & outcome.soon
        share = jnp.where(first, 0.5, -0.5).astype(vehicles.x.dtype)
        return (
            crashed | (tested & outcome.now),
            impacted | hit,
            jnp.where(hit, share * outcome.x, impact_x),
            jnp.where(hit, share * outcome.y, impact_y),
        )

    start = (vehicles.crashed, vehicles.impacted, vehicles.impact_x, vehicles.impact_y)
    crashed, impacted, impact_x, impact_y = over_vehicles(vehicles.x.shape[0], meet, start)
    return replace(
        world,
        vehicles=replace(
            vehicles, crashed=crashed, impacted=impacted, impact_x=impact_x, impact_y=impact_y
        ),
    )
