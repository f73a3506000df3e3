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

from lanewise.world import sets
from lanewise.world.boxes import Box, of_vehicles, overlap
from lanewise.world.once import once
from lanewise.world.select import pick
from lanewise.world.state import World, numbered

SLACK = 1e-3
"""By this much, m, the quick test is more generous than the exact one, against rounding."""


def may_touch(boxes: Box, other: int, duration: ArrayLike) -> Array:
    """Which boxes a box might touch: a quick test that never misses a pair.

    Far centres, or boxes that stay apart across the heading of the first, cannot touch.

    Args:
        boxes: of all vehicles, [N].
        other: the other vehicle of each pair, static.
        duration: of the tick, s.

    Returns:
        bool [N].
    """
    mine, theirs = boxes, Box(*(value[other] for value in boxes))
    apart_x, apart_y = mine.x - theirs.x, mine.y - theirs.y
    first = numbered(mine.x) < other
    speed = jnp.where(first, mine.speed, theirs.speed)
    reach = mine.half_diagonal + theirs.half_diagonal + speed * duration
    near = apart_x * apart_x + apart_y * apart_y <= reach * reach * (1 + SLACK)
    cosine = jnp.abs(mine.cosine * theirs.cosine + mine.sine * theirs.sine)
    turn = mine.cosine * theirs.sine - mine.sine * theirs.cosine
    width = mine.half_width + theirs.half_length * jnp.abs(turn) + theirs.half_width * cosine
    centre = mine.cosine * apart_y - mine.sine * apart_x
    # The own velocity has no part across the own heading.
    shift = -theirs.speed * turn * duration
    width += SLACK
    apart = (centre + jnp.minimum(shift, 0) > width) | (centre + jnp.maximum(shift, 0) < -width)
    return near & ~apart


def candidates(world: World, boxes: Box, duration: ArrayLike) -> sets.Words:
    """The vehicles each vehicle must be tested against.

    A pair is tested when both are present and either checks collisions.

    Args:
        world: one world.
        boxes: of its vehicles.
        duration: of the tick, s.

    Returns:
        For each vehicle a set of vehicles, [N].
    """
    present, checks = world.vehicles.present, world.drivers.checks_collisions
    count, index = present.shape[0], numbered(present)

    def tested(other: int) -> Array:
        pair = present & present[other] & (checks | checks[other]) & (index != other)
        return pair & may_touch(boxes, other, duration)

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
    mine = once(vehicles.present, lambda: of_vehicles(world))
    count, index = vehicles.x.shape[0], numbered(vehicles.x)

    def meet(state: tuple[sets.Words, Outcome]) -> tuple[sets.Words, Outcome]:
        left, so_far = state
        other = sets.smallest(left)
        theirs = once(vehicles.present, lambda: Box(*(pick(value, other) for value in mine)))
        first = index < other
        a = Box(*(jnp.where(first, m, t) for m, t in zip(mine, theirs, strict=True)))
        b = Box(*(jnp.where(first, t, m) for m, t in zip(mine, theirs, strict=True)))
        pair = once(vehicles.present, lambda: overlap(a, b, duration))
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

    met = once(vehicles.present, lambda: candidates(world, mine, duration))
    before = Outcome(vehicles.crashed, vehicles.impacted, vehicles.impact_x, vehicles.impact_y)
    _, after = lax.while_loop(lambda state: jnp.any(sets.inhabited(state[0])), meet, (met, before))
    return replace(world, vehicles=replace(vehicles, **after._asdict()))
