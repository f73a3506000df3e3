"""Speeds that swing: sine waves around a mean, for those who brake and accelerate by themselves.

highway-env has none. They act between decisions, so that a tick is the same with and without them.
"""

from dataclasses import replace

import jax.numpy as jnp
from jax import Array
from jax.typing import ArrayLike

from lanewise.world.state import CONSTANT, RULE_BASED, Waves, World


def speed(waves: Waves, time: ArrayLike) -> Array:
    """The speed at a time, s: v + A sin(2 pi (t / T + phase)), m/s [N]."""
    turns = time / waves.period + waves.phase
    return waves.mean + waves.amplitude * jnp.sin(2 * jnp.pi * turns)


def follow(world: World, time: ArrayLike, duration: ArrayLike) -> World:
    """The world with what its waves want for the next ``duration``, s, from ``time`` on, s.

    A rule-based driver's desired speed is the wave's. A constant vehicle accelerates so that its
    speed is the wave's at the end.
    """
    waves, drivers, vehicles = world.drivers.waves, world.drivers, world.vehicles
    if waves is None:
        return world
    now, then = speed(waves, time), speed(waves, time + duration)
    swings = waves.amplitude > 0
    desired = jnp.where(swings & (drivers.kind == RULE_BASED), now, drivers.target_speed)
    constant = swings & (drivers.kind == CONSTANT)
    acceleration = jnp.where(constant, (then - now) / duration, vehicles.acceleration)
    return replace(
        world,
        drivers=replace(drivers, target_speed=desired),
        vehicles=replace(vehicles, acceleration=acceleration),
    )
