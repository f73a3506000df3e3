"""Kinds of accidents, each driven in the world until it happens."""

import jax
import jax.numpy as jnp
import pytest

from lanewise.driving import accident_kinds as kinds
from lanewise.driving import accidents
from lanewise.evaluation.episodes import ACCIDENT_KINDS
from lanewise.world import tick
from lanewise.world.state import CONSTANT
from small_worlds import change, make_world, mirrored, single

NAMES = list(ACCIDENT_KINDS)
DRIFT = 0.1
"""Heading of who changes lane, rad."""
PLACES = ((0.0, 0), (54.0, 1), (56.0, 1))
"""Of an ego: in the left lane, before and after it has run into a car at 60 m."""


@jax.jit
def drive(world):
    """(kind of the accident, the other vehicle) once everybody has gone straight on."""

    def on(state):
        world, history, _, _ = state
        after = tick.run(world, 0.1, 5)
        history = kinds.follow(history, world, after)
        code = accidents.ego_accident(after, 0.1)
        return after, history, code, kinds.kind(code, after, history, 0.5)

    start = world, kinds.begin(world), jnp.int32(accidents.NONE), jnp.int32(kinds.NONE)
    world, _, _, kind = jax.lax.while_loop(lambda state: state[2] == accidents.NONE, on, start)
    return kind, kinds.partner(world)


def cars(*rows):
    """A world of vehicles [x, lane, speed, heading], the ego first; a pair has crashed far away."""
    rows = [*rows, (300.0, 1, 10.0, 0.0), (302.0, 1, 10.0, 0.0)]
    x, lane, speed, heading = zip(*rows, strict=True)
    return make_world(x, lane, speed, kinds=[CONSTANT] * len(rows), heading=list(heading), size=4)


CASES = {
    kinds.CAR_AHEAD: cars((0.0, 1, 15.0, 0.0), (20.0, 1, 10.0, 0.0)),
    kinds.OWN_LANE_CHANGE: cars((0.0, 0, 15.0, DRIFT), (14.0, 1, 10.0, 0.0)),
    kinds.CUT_IN: cars((0.0, 1, 15.0, 0.0), (18.5, 0, 10.0, DRIFT)),
    kinds.SIDE_SWIPE: cars((0.0, 0, 12.0, DRIFT), (1.0, 1, 12.0, 0.0)),
    kinds.SIDE_SWIPED: cars((0.0, 1, 12.0, 0.0), (-1.0, 0, 12.0, DRIFT)),
    kinds.HIT_FROM_BEHIND: cars((0.0, 1, 10.0, 0.0), (-20.0, 1, 15.0, 0.0)),
    kinds.OFF_ROAD: cars((0.0, 0, 12.0, -DRIFT), (-50.0, 1, 10.0, 0.0)),
    kinds.STOPPED: cars((0.0, 1, 0.05, 0.0), (-50.0, 2, 10.0, 0.0)),
}


@pytest.mark.parametrize("mirror", [False, True])
@pytest.mark.parametrize("wanted", CASES, ids=lambda kind: NAMES[kind])
def test_an_accident_is_of_the_kind_that_it_was_made_to_be(wanted, mirror):
    world = mirrored(CASES[wanted]) if mirror else CASES[wanted]
    kind, other = drive(single(world))
    assert NAMES[int(kind)] == NAMES[wanted]
    if wanted not in (kinds.OFF_ROAD, kinds.STOPPED):
        assert int(other) == 1


def test_codes_are_called_what_they_mean():
    assert [getattr(kinds, name.upper()) for name in NAMES] == list(range(len(NAMES)))


def test_a_change_of_lane_long_ago_is_no_reason():
    """The ego runs into the car ahead, some decisions after it came from the left lane."""
    left, *straight = (cars((x, lane, 12.0, 0.0), (60.0, 1, 10.0, 0.0)) for x, lane in PLACES)
    before, after = (single(change(world, crashed=[True, True])) for world in straight)
    code, found = jnp.int32(accidents.COLLISION), {}
    history = kinds.follow(kinds.begin(single(left)), single(left), before)
    for decisions in range(1, 10):
        history = kinds.follow(history, before, after)
        found[decisions] = int(kinds.kind(code, after, history, 0.5))
    assert found == {n: kinds.OWN_LANE_CHANGE if n <= 8 else kinds.CAR_AHEAD for n in range(1, 10)}
