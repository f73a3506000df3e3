"""Who hits whom: a quick test finds the few pairs worth the separating-axis test.

``RoadObject.handle_collisions``, ``_is_colliding`` and ``utils.are_polygons_intersecting`` of
highway-env. Of a pair, ``a`` is the vehicle earlier in the list. Rectangles that overlap crash now;
rectangles that will overlap within a tick get an impact, which moves them and crashes them on the
*next* tick.
"""

from dataclasses import replace
from typing import NamedTuple

import jax.numpy as jnp
from jax import Array, lax
from jax.typing import ArrayLike

from lanewise.world import bitset, compaction
from lanewise.world.compaction import Selection
from lanewise.world.materialize import materialize
from lanewise.world.motion import HeadingTrig
from lanewise.world.state import World, numbered

TOUCHING_COMPACTION = 50
"""One vehicle in so many passes the quick test; see docs/speed.md."""
SLACK = 1e-3
"""By this much, m, the quick test is more generous than the exact one, against rounding."""


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


def boxes_of(world: World, trig: HeadingTrig) -> Box:
    """Rectangles of all vehicles, [N]."""
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


def candidates(world: World, boxes: Box, duration: ArrayLike) -> bitset.Bitset:
    """The vehicles each vehicle must be tested against: a quick test that never misses a pair.

    A pair is tested when both are present and either checks collisions. It cannot touch if it is
    apart along the road, |dx| > r + r', or across the heading of the first, |cos dy| > |sin dx|
    + w + w' + (l' + |v'| dt) |sin turn|: along that normal the exact test finds it apart. Bounded
    by |dx| <= r + r' and |sin turn| <= |sin| + |sin'|, the right side falls into terms of one
    vehicle each and one product.
    """
    present, checks = world.vehicles.present, world.drivers.checks_collisions
    travel = jnp.abs(boxes.speed) * duration
    reach = jnp.where(present, boxes.half_diagonal + travel + SLACK, -jnp.inf)
    sine, cosine = jnp.abs(boxes.sine), jnp.abs(boxes.cosine)
    stretch = boxes.half_length + travel
    mine = sine * reach + boxes.half_width + SLACK
    theirs = stretch * sine + boxes.half_width
    both = stretch + reach
    count = present.shape[0]

    def tested(other: int) -> Array:
        along = jnp.abs(boxes.x - boxes.x[other]) <= reach + reach[other]
        aside = jnp.abs(boxes.y - boxes.y[other]) * cosine
        across = aside <= mine + theirs[other] + sine * both[other]
        return along & across & (checks | checks[other])

    met = bitset.where(count, tested)
    return bitset.without(met, bitset.single(numbered(present), count))


def overlap(a: Box, b: Box, duration: ArrayLike) -> Overlap:
    """Separating-axis test of two boxes, now and within one tick at constant velocity.

    Along each normal n of both boxes, taken in the order back, right, front, left, ``a`` covers
    [p - r_a, p + r_a] stretched by its relative displacement and ``b`` covers [-r_b, r_b]. The
    normal with the least overlap is the way out, the first of equals. ``a`` is the earlier vehicle
    of the pair; the shapes broadcast.
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


class CollisionState(NamedTuple):
    """What collisions do to each vehicle, arrays [N]."""

    crashed: Array
    """bool."""
    impacted: Array
    """bool."""
    impact_x: Array
    """m."""
    impact_y: Array
    """m."""


def resolve(world: World, trig: HeadingTrig, duration: ArrayLike) -> World:
    """Crash vehicles that overlap and set impacts on those about to; they have moved already.

    Each of a pair is moved by half the way out. Pairs come in list order and later ones
    overwrite, so of several impacts on a vehicle the one with the last other vehicle stays
    (`last-impact-wins`): every vehicle goes through its candidates in rising order.
    """
    vehicles = world.vehicles
    boxes = materialize(vehicles.present, lambda: boxes_of(world, trig))
    met = materialize(vehicles.present, lambda: candidates(world, boxes, duration))
    before = CollisionState(
        vehicles.crashed, vehicles.impacted, vehicles.impact_x, vehicles.impact_y
    )
    after = compaction.masked_apply(
        bitset.inhabited(met),
        before,
        lambda chosen: _meet(chosen, boxes, chosen.own(met), chosen.own(before), duration),
        one_in=TOUCHING_COMPACTION,
    )
    return replace(world, vehicles=replace(vehicles, **after._asdict()))


def _meet(
    chosen: Selection, boxes: Box, met: bitset.Bitset, before: CollisionState, duration: ArrayLike
) -> CollisionState:
    """What happens to a few vehicles that go through their candidates, [K]."""
    mine, count = materialize(chosen.real, lambda: chosen.own(boxes)), boxes.x.shape[0]

    def meet(state: tuple[bitset.Bitset, CollisionState]) -> tuple[bitset.Bitset, CollisionState]:
        left, so_far = state
        other = bitset.smallest(left)
        values = materialize(
            chosen.real, lambda: [chosen.at(value, jnp.maximum(other, 0)) for value in boxes]
        )
        theirs = Box(*values)
        first = chosen.vehicle < other
        a = Box(*(jnp.where(first, m, t) for m, t in zip(mine, theirs, strict=True)))
        b = Box(*(jnp.where(first, t, m) for m, t in zip(mine, theirs, strict=True)))
        pair = materialize(chosen.real, lambda: overlap(a, b, duration))
        tested = other >= 0
        hit = tested & pair.soon
        share = jnp.where(first, 0.5, -0.5).astype(boxes.x.dtype)
        after = CollisionState(
            crashed=so_far.crashed | (tested & pair.now),
            impacted=so_far.impacted | hit,
            impact_x=jnp.where(hit, share * pair.x, so_far.impact_x),
            impact_y=jnp.where(hit, share * pair.y, so_far.impact_y),
        )
        return bitset.without(left, bitset.single(other, count)), after

    _, after = lax.while_loop(
        lambda state: jnp.any(bitset.inhabited(state[0])), meet, (met, before)
    )
    return after
