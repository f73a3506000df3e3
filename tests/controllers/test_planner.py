"""The planner drives the bicycle of the world, alone on the road, to every goal."""

from functools import cache

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from percepts import percept_of

from lanewise.controllers import planner
from lanewise.controllers.goals import Goal
from lanewise.controllers.settings import PlannerSettings
from lanewise.driving import actions, percept
from lanewise.driving.settings import DrivingSettings
from lanewise.world import bicycle, build, motion, road
from lanewise.world.settings import PAPER_DRIVER
from lanewise.world.state import EXTERNAL, World

DRIVING, PLANNER = DrivingSettings(), PlannerSettings()
ACT = jax.jit(planner.act, static_argnums=(0, 1))
DECISIONS = 60
"""30 s."""
CASES = np.array(
    [
        (speed, 1 + side, np.clip(speed + change, 3.0, 16.0))
        for speed in np.arange(3.0, 16.01, 0.25)
        for side in (-1, 0, 1)
        for change in (-1.0, -0.5, 0.0, 0.5, 1.0)
    ]
)
"""Initial speed, target lane, target speed; everyone starts in lane 1."""


def move(world):
    """A tick of a vehicle that meets nobody."""
    return bicycle.move(world, motion.heading_trig(world.vehicles), DRIVING.tick_duration)


def drive(speed, lane, target):
    """(offset from the target lane, heading, speed difference) after each decision."""
    lanes = road.straight_road(3)
    world = World(
        road=lanes,
        drivers=build.make_drivers([PAPER_DRIVER], [EXTERNAL]),
        vehicles=build.make_vehicles([0.0], [4.0], speed[None], [1]),
    )

    def decide(world, _):
        seen = percept.perceive(DRIVING.observation, world)
        action = planner.act(PLANNER, DRIVING, Goal(lane, target), seen)
        commands = actions.commands(DRIVING.actions, action, jnp.dtype(jnp.float32))
        world = bicycle.command(world, *commands)
        world = jax.lax.fori_loop(0, DRIVING.ticks_per_decision, lambda _, now: move(now), world)
        ego = world.vehicles
        return world, (ego.y[0] - lanes.centre[lane], ego.heading[0], ego.speed[0] - target)

    return jax.lax.scan(decide, world, length=DECISIONS)[1]


@cache
def driven():
    speed, lane, target = CASES.T
    return [
        np.abs(np.asarray(track))
        for track in jax.jit(jax.vmap(drive))(
            jnp.asarray(speed, jnp.float32),
            jnp.asarray(lane, jnp.int32),
            jnp.asarray(target, jnp.float32),
        )
    ]


def decisions_until(condition):
    """Decisions until a condition [C, T] first holds."""
    assert condition.any(axis=1).all(), CASES[~condition.any(axis=1)]
    return np.argmax(condition, axis=1) + 1


def test_the_planner_settles_and_stays_from_3_to_16_metres_a_second():
    offset, heading, difference = driven()
    settled = (offset < 0.3) & (heading < 0.03) & (difference < 0.3)
    late = settled[:, 40:].all(axis=1)
    assert late.all(), CASES[~late]


def test_lane_changes_are_quick():
    offset, _, difference = driven()
    speed, lane, target = CASES.T
    seconds = decisions_until((offset < 0.3) & (difference < 0.3)) / 2.0
    pure = (lane != 1) & (speed == target)
    assert np.median(seconds[pure]) <= 3.5
    assert seconds[pure & (speed >= 5.0)].max() <= 8.0


def test_speed_changes_follow_at_once():
    offset, heading, difference = driven()
    _, lane, _ = CASES.T
    straight = lane == 1
    assert decisions_until(difference < 0.3)[straight].max() <= 2
    assert offset[straight].max() < 1e-3
    assert heading[straight].max() < 1e-3


def test_the_planner_stays_on_the_road():
    offset, heading, _ = driven()
    assert offset.max() < 4.5
    assert heading.max() < 0.3


@pytest.mark.parametrize("side", [-1, 1])
def test_a_car_on_its_way_to_the_centre_is_left_alone(side):
    """The offset is judged a second later; by where the car is, it would turn away from the lane.

    One decision ahead, going straight and turning back leave headings of the same size.
    """
    seen = percept_of(y=4.0 + side * 0.6, heading=-side * 0.0314)
    goal = Goal(jnp.int32(1), jnp.float32(10.0))
    assert int(ACT(PlannerSettings(preview=1), DRIVING, goal, seen)) == actions.IDLE


@pytest.mark.parametrize(
    ("target", "speed", "sign"),
    [(10, 9.6, 1), (10, 9.8, 0), (10, 10.2, 0), (10, 10.4, -1), (10, 3, 1)],
)
def test_speed_rule_takes_the_nearest_quantum(target, speed, sign):
    assert float(planner.speed_rule(DRIVING, jnp.float32(target), jnp.float32(speed))) == sign
