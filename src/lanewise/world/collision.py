"""Who hits whom: a quick test finds the few pairs worth the separating-axis test.

``RoadObject.handle_collisions`` of highway-env. Of a pair, ``a`` is the vehicle earlier in the
list. Rectangles that overlap crash now; rectangles that will overlap within
a tick get an impact, which moves them and crashes them on the *next* tick.
"""

from dataclasses import replace
from typing import NamedTuple

import jax.numpy as jnp
from jax import Array, lax
from jax.typing import ArrayLike

from lanewise.world import bitset, compaction
from lanewise.world.boxes import Box, of_vehicles, overlap
from lanewise.world.compaction import Selection
from lanewise.world.materialize import materialize
from lanewise.world.motion import HeadingTrig
from lanewise.world.state import World, numbered

TOUCHING_COMPACTION = 50
"""One vehicle in so many passes the quick test; see docs/speed.md."""
SLACK = 1e-3
"""By this much, m, the quick test is more generous than the exact one, against rounding."""


def candidates(world: World, boxes: Box, duration: ArrayLike) -> bitset.Bitset:
    """The vehicles each vehicle must be tested against: a quick test that never misses a pair.

    A pair is tested when both are present and either checks collisions. It cannot touch if it is
    apart along the road, |dx| > r + r', or across the heading of the first, |cos dy| > |sin dx|
    + w + w' + (l' + |v'| dt) |sin turn|: along that normal the exact test finds it apart. Bounded
    by |dx| <= r + r' and |sin turn| <= |sin| + |sin'|, the right side falls into terms of one
    vehicle each and one product.

    Args:
        world: one world.
        boxes: of its vehicles.
        duration: of the tick, s.

    Returns:
        For each vehicle a set of vehicles, [N].
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
    """Crash vehicles that overlap and set impacts on those about to.

    Each of a pair is moved by half the way out. Pairs come in list order and later ones
    overwrite, so of several impacts on a vehicle the one with the last other vehicle stays
    (`last-impact-wins`): every vehicle goes through its candidates in rising order.

    Args:
        world: one world, vehicles already moved.
        trig: of its vehicles.
        duration: of the tick, s.

    Returns:
        The world with `crashed` and impacts set.
    """
    vehicles = world.vehicles
    boxes = materialize(vehicles.present, lambda: of_vehicles(world, trig))
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
