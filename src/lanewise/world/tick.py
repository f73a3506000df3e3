"""One tick of the world: everyone looks, decides, moves, and may collide.

The order is highway-env's ``Road.act`` then ``Road.step``: all decide on the same positions, then
all move, then collisions are found.
"""

from dataclasses import replace

import jax.numpy as jnp
from jax import lax
from jax.typing import ArrayLike

from lanewise.world import bicycle, collision, idm, mobil, motion, neighbours, steering
from lanewise.world.motion import Motion
from lanewise.world.state import RULE_BASED, World


def tick(world: World, duration: ArrayLike) -> World:
    """Advance one world by one simulation step.

    Args:
        world: one world.
        duration: of the step, s.

    Returns:
        The world a step later.
    """
    seen = motion.observe(world)
    world = act(world, seen)
    world = bicycle.move(world, duration)
    world = wait(world, duration)
    return collision.resolve(world, duration)


def act(world: World, seen: Motion) -> World:
    """Let every rule-based driver choose a lane, a steering and an acceleration.

    Args:
        world: one world.
        seen: its motion.

    Returns:
        The world with commands, target lanes and timers set; nobody has moved yet.
    """
    vehicles, decides = world.vehicles, seen.decides
    around = neighbours.find(world, seen)
    target_lane, timer = mobil.decide(world, seen, around)
    acceleration = idm.accelerate(world, seen, around, target_lane)
    slip_sine = steering.keep_lane(world, target_lane)
    return replace(
        world,
        vehicles=replace(
            vehicles,
            target_lane=target_lane,
            timer=timer,
            acceleration=jnp.where(decides, acceleration, vehicles.acceleration),
            slip_sine=jnp.where(decides, slip_sine, vehicles.slip_sine),
        ),
    )


def wait(world: World, duration: ArrayLike) -> World:
    """Advance the lane-change timers of rule-based drivers, crashed ones included.

    Args:
        world: one world.
        duration: of the step, s.

    Returns:
        The world with later timers.
    """
    vehicles = world.vehicles
    waits = vehicles.present & (world.drivers.kind == RULE_BASED)
    timer = jnp.where(waits, vehicles.timer + duration, vehicles.timer)
    return replace(world, vehicles=replace(vehicles, timer=timer))


def run(world: World, duration: ArrayLike, count: int) -> World:
    """Advance one world by several ticks without new commands from outside.

    Args:
        world: one world.
        duration: of each tick, s.
        count: how many, static.

    Returns:
        The world ``count`` ticks later.
    """
    later: World = lax.fori_loop(0, count, lambda _, state: tick(state, duration), world)
    return later
