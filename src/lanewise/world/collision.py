"""Who hits whom: the separating-axis test on moving rectangles, pair by pair.

``RoadObject.handle_collisions`` and ``utils.are_polygons_intersecting``. Of a pair, ``a`` is the
vehicle earlier in the list. Rectangles that overlap crash now; rectangles that will overlap within
a tick get an impact, which moves them and crashes them on the *next* tick.
"""

from dataclasses import replace
from typing import NamedTuple

import jax.numpy as jnp
from jax import Array, lax
from jax.typing import ArrayLike

from lanewise.world import sets
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


def may_touch(boxes_: Box, other: int, duration: ArrayLike) -> Array:
    """Which boxes a box might touch: a quick test that never misses a pair.

    Far centres, or boxes that stay apart across the heading of the first, cannot touch.

    Args:
        boxes_: of all vehicles, [N].
        other: the other vehicle of each pair, static.
        duration: of the tick, s.

    Returns:
        bool [N].
    """
    mine, theirs = boxes_, Box(*(value[other] for value in boxes_))
    apart_x, apart_y = mine.x - theirs.x, mine.y - theirs.y
    first = jnp.arange(mine.x.shape[0]) < other
    speed = jnp.where(first, mine.speed, theirs.speed)
    reach = mine.half_diagonal + theirs.half_diagonal + speed * duration
    near = jnp.sqrt(apart_x * apart_x + apart_y * apart_y) <= reach
    cosine = jnp.abs(mine.cosine * theirs.cosine + mine.sine * theirs.sine)
    turn = mine.cosine * theirs.sine - mine.sine * theirs.cosine
    width = mine.half_width + theirs.half_length * jnp.abs(turn) + theirs.half_width * cosine
    centre = mine.cosine * apart_y - mine.sine * apart_x
    # The own velocity has no part across the own heading.
    shift = -theirs.speed * turn * duration
    apart = (centre + jnp.minimum(shift, 0) > width) | (centre + jnp.maximum(shift, 0) < -width)
    return near & ~apart


def candidates(world: World, duration: ArrayLike) -> sets.Words:
    """The vehicles each vehicle must be tested against.

    A pair is tested when both are present and either checks collisions.

    Args:
        world: one world.
        duration: of the tick, s.

    Returns:
        For each vehicle a set of vehicles, [N].
    """
    present, checks = world.vehicles.present, world.drivers.checks_collisions
    all_boxes = boxes(world)
    count = present.shape[0]
    index = jnp.arange(count)

    def tested(other: int) -> Array:
        pair = present & present[other] & (checks | checks[other]) & (index != other)
        return pair & may_touch(all_boxes, other, duration)

    return sets.where(count, tested)


class Outcome(NamedTuple):
    """What collisions do to each vehicle, arrays [N]."""

    crashed: Array
    """bool."""
    impacted: Array
    """bool."""
    impact_x: Array
    """m."""
    impact_y: Array
    """m."""


def resolve(world: World, duration: ArrayLike) -> World:
    """Crash vehicles that overlap and set impacts on those about to.

    Each of a pair is moved by half the way out. Pairs come in list order and later ones
    overwrite, so of several impacts on a vehicle the one with the last other vehicle stays
    (`last-impact-wins`): every vehicle goes through its candidates in rising order.

    Args:
        world: one world, vehicles already moved.
        duration: of the tick, s.

    Returns:
        The world with `crashed` and impacts set.
    """
    vehicles = world.vehicles
    mine = boxes(world)
    count = vehicles.x.shape[0]
    index = jnp.arange(count)

    def meet(state: tuple[sets.Words, Outcome]) -> tuple[sets.Words, Outcome]:
        left, so_far = state
        other = sets.smallest(left)
        theirs = Box(*(sets.chosen(value, index, other) for value in mine))
        first = index < other
        a = Box(*(jnp.where(first, m, t) for m, t in zip(mine, theirs, strict=True)))
        b = Box(*(jnp.where(first, t, m) for m, t in zip(mine, theirs, strict=True)))
        pair = overlap(a, b, duration)
        tested = other >= 0
        hit = tested & pair.soon
        share = jnp.where(first, 0.5, -0.5).astype(vehicles.x.dtype)
        after = Outcome(
            crashed=so_far.crashed | (tested & pair.now),
            impacted=so_far.impacted | hit,
            impact_x=jnp.where(hit, share * pair.x, so_far.impact_x),
            impact_y=jnp.where(hit, share * pair.y, so_far.impact_y),
        )
        return sets.without(left, sets.single(other, count)), after

    before = Outcome(vehicles.crashed, vehicles.impacted, vehicles.impact_x, vehicles.impact_y)
    _, after = lax.while_loop(
        lambda state: jnp.any(sets.inhabited(state[0])), meet, (candidates(world, duration), before)
    )
    return replace(world, vehicles=replace(vehicles, **after._asdict()))
