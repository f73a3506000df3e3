"""Rectangles in motion, and the separating-axis test of two of them.

``RoadObject._is_colliding`` and ``utils.are_polygons_intersecting`` of highway-env.
"""

from typing import NamedTuple

import jax.numpy as jnp
from jax import Array
from jax.typing import ArrayLike

from lanewise.world.motion import HeadingTrig
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


def of_vehicles(world: World, trig: HeadingTrig) -> Box:
    """Rectangles of all vehicles.

    Args:
        world: one world.
        trig: of its vehicles.

    Returns:
        Arrays [N].
    """
    vehicles, drivers = world.vehicles, world.drivers
    return Box(
        x=vehicles.x,
        y=vehicles.y,
        cosine=trig.cosine,
        sine=trig.sine,
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
