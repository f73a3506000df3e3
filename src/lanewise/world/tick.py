"""One tick of the world: everyone looks, decides, moves, and may collide.

The order is highway-env's ``Road.act`` then ``Road.step``: all decide on the same positions, then
all move, then collisions are found.
"""

from collections.abc import Callable
from dataclasses import replace

import jax
import jax.numpy as jnp
from jax import Array, lax
from jax.custom_batching import custom_vmap
from jax.typing import ArrayLike

from lanewise.world import bicycle, collision, driver_model, mobil, motion
from lanewise.world.materialize import materialize, on_cpu
from lanewise.world.motion import HeadingTrig, Motion
from lanewise.world.state import RULE_BASED, Vehicles, World

CACHED = 4096
"""Vehicles whose ticks are computed together on a CPU; see docs/speed.md."""


def tick(world: World, duration: ArrayLike) -> World:
    """Advance one world by one simulation step, s."""
    return step(world, motion.heading_trig(world.vehicles), duration)[0]


def step(world: World, trig: HeadingTrig, duration: ArrayLike) -> tuple[World, HeadingTrig]:
    """As `tick`, from where the vehicles are headed to where they are headed then."""
    seen = materialize(world.vehicles.present, lambda: motion.observe(world, trig))
    world = act(world, seen, duration)
    world = bicycle.move(world, trig, duration)
    world = wait(world, duration)
    trig = motion.heading_trig(world.vehicles)
    return collision.resolve(world, trig, duration), trig


def act(world: World, seen: Motion, duration: ArrayLike) -> World:
    """Let every rule-based driver choose a lane, a steering and an acceleration; nobody moves."""
    vehicles = world.vehicles

    def decided() -> dict[str, Array]:
        target_lane, timer = mobil.decide(world, seen, duration)
        acceleration = driver_model.accelerate(world, seen, target_lane)
        slip_sine = driver_model.keep_lane(world, target_lane)
        return {
            "target_lane": target_lane,
            "timer": timer,
            "acceleration": jnp.where(seen.decides, acceleration, vehicles.acceleration),
            "slip_sine": jnp.where(seen.decides, slip_sine, vehicles.slip_sine),
        }

    return replace(world, vehicles=replace(vehicles, **materialize(vehicles.present, decided)))


def wait(world: World, duration: ArrayLike) -> World:
    """Advance the lane-change timers of rule-based drivers, crashed ones included."""
    vehicles = world.vehicles
    waits = vehicles.present & (world.drivers.kind == RULE_BASED)
    timer = jnp.where(waits, vehicles.timer + duration, vehicles.timer)
    return replace(world, vehicles=replace(vehicles, timer=timer))


def run(world: World, duration: float, count: int) -> World:
    """Advance one world by ``count`` ticks, static, without new commands from outside.

    Batched with ``jax.vmap``, the worlds lie along the last axis meanwhile (see `state`).
    """

    @custom_vmap
    def later(world: World) -> Vehicles:
        def next_tick(_: int, now: tuple[Vehicles, HeadingTrig]) -> tuple[Vehicles, HeadingTrig]:
            vehicles, trig = now
            after, trig = step(replace(world, vehicles=vehicles), trig, duration)
            return after.vehicles, trig

        begun = world.vehicles, motion.heading_trig(world.vehicles)
        after: Vehicles = lax.fori_loop(0, count, next_tick, begun)[0]
        return after

    @later.def_vmap
    def batched(size: int, batched: tuple[World], worlds: World) -> tuple[Vehicles, Vehicles]:
        def side_by_side(worlds: World, count: int) -> Vehicles:
            after = later(_worlds_last(worlds, batched[0], count))
            first: Vehicles = jax.tree.map(lambda leaf: jnp.moveaxis(leaf, -1, 0), after)
            return first

        after = _in_blocks(side_by_side, worlds, batched[0], size)
        return after, jax.tree.map(lambda _: True, after)

    return replace(world, vehicles=later(world))


def _in_blocks(
    advance: Callable[[World, int], Vehicles], worlds: World, batched: World, size: int
) -> Vehicles:
    """Advance worlds a block at a time, so small that what a tick computes stays in the cache.

    ``advance`` takes worlds along the first axis of those leaves that ``batched`` names.
    """
    vehicles = worlds.vehicles.present.shape[1 if batched.vehicles.present else 0]
    most = max(1, CACHED // vehicles)
    blocks = [count for count in range(most, most // 4, -1) if size % count == 0]
    if size <= most or not blocks or not on_cpu():
        return advance(worlds, size)
    count = blocks[0]
    leaves, structure = jax.tree.flatten(worlds)
    moving = jax.tree.leaves(batched)
    cut = [
        leaf.reshape(-1, count, *leaf.shape[1:])
        for leaf, moves in zip(leaves, moving, strict=True)
        if moves
    ]

    def block(parts: list[Array]) -> Vehicles:
        part = iter(parts)
        whole = [next(part) if moves else leaf for leaf, moves in zip(leaves, moving, strict=True)]
        return advance(jax.tree.unflatten(structure, whole), count)

    after: Vehicles = jax.tree.map(
        lambda leaf: leaf.reshape(size, *leaf.shape[2:]), lax.map(block, cut)
    )
    return after


def _worlds_last(worlds: World, batched: World, count: int) -> World:
    """Worlds along the first axis, of the leaves that are batched, as worlds along the last."""

    def last(leaf: Array, is_batched: bool) -> Array:
        return jnp.moveaxis(leaf, 0, -1) if is_batched else leaf[..., None]

    moved: World = jax.tree.map(last, worlds, batched)
    # What a loop carries keeps its shape, so that vehicles must have it from the start.
    vehicles = jax.tree.map(
        lambda leaf: jnp.broadcast_to(leaf, (*leaf.shape[:-1], count)), moved.vehicles
    )
    return replace(moved, vehicles=vehicles)
