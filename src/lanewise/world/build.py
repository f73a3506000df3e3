"""Build the drivers and vehicles of a world from settings and places, in float32."""

from collections.abc import Sequence
from dataclasses import fields, replace
from typing import Any

import jax
import jax.numpy as jnp
from jax import Array
from jax.typing import ArrayLike

from lanewise.world.settings import CAR_LENGTH, CAR_WIDTH, DriverSettings, LinearSettings
from lanewise.world.state import RULE_BASED, Drivers, Linear, Vehicles, World
from lanewise.world.steering import slip_sine

NUMBERS = tuple(field.name for field in fields(DriverSettings) if isinstance(field.default, float))
"""Settings of a driver that are numbers."""


def make_drivers(
    settings: Sequence[DriverSettings], kinds: Sequence[int], missing_target_speed: bool = True
) -> Drivers:
    """Drivers from the settings and the kind of each, [N].

    With ``missing_target_speed``, vehicles that are not rule-based seem to want to stop, as in
    highway-env; otherwise they seem to want their setting's target speed. ``linear`` is None unless
    somebody drives by that model.
    """
    of: dict[str, Any] = dict(_columns(settings, NUMBERS))
    kind, count = jnp.asarray(kinds, jnp.int32), len(kinds)
    if missing_target_speed:
        of["target_speed"] = jnp.where(kind == RULE_BASED, of["target_speed"], 0)
    return Drivers(
        kind=kind,
        slip_limit=slip_sine(of.pop("steering_limit")),
        changes_lanes=jnp.asarray([s.changes_lanes for s in settings], bool),
        checks_collisions=jnp.ones(count, bool),
        length=jnp.full(count, CAR_LENGTH, jnp.float32),
        width=jnp.full(count, CAR_WIDTH, jnp.float32),
        linear=_make_linear(settings, kinds),
        **of,
    )


def _make_linear(settings: Sequence[DriverSettings], kinds: Sequence[int]) -> Linear | None:
    rules = zip(settings, kinds, strict=True)
    applies = [each.model == "linear" and kind == RULE_BASED for each, kind in rules]
    if not any(applies):
        return None
    names = [field.name for field in fields(LinearSettings)]
    gains = _columns([each.linear for each in settings], names)
    return Linear(applies=jnp.asarray(applies), **gains)


def nobody_linear(count: int) -> Linear:
    """The linear model for ``count`` drivers of whom none drives by it."""
    names = [field.name for field in fields(LinearSettings)]
    return Linear(applies=jnp.zeros(count, bool), **_columns([LinearSettings()] * count, names))


def _columns(rows: Sequence[object], names: Sequence[str]) -> dict[str, Array]:
    """By name, the numbers of all rows, float32."""
    return {name: jnp.asarray([getattr(row, name) for row in rows], jnp.float32) for name in names}


def initial_timer(x: Array, y: Array) -> Array:
    """highway-env's start of the lane-change timer, (x + y) pi mod 1 s; any shape."""
    return jnp.mod((x + y) * jnp.pi, 1.0)


def make_vehicles(x: ArrayLike, y: ArrayLike, speed: ArrayLike, lane: ArrayLike) -> Vehicles:
    """Vehicles along the road, [N]: nothing commanded, nobody crashed.

    Places in m, speeds in m/s, and the lane, int, that each vehicle follows.
    """
    place_x, place_y = jnp.asarray(x, jnp.float32), jnp.asarray(y, jnp.float32)
    zeros, no = jnp.zeros_like(place_x), jnp.zeros(place_x.shape, bool)
    return Vehicles(
        present=~no,
        x=place_x,
        y=place_y,
        heading=zeros,
        speed=jnp.asarray(speed, jnp.float32),
        slip_sine=zeros,
        acceleration=zeros,
        target_lane=jnp.asarray(lane, jnp.int32),
        timer=initial_timer(place_x, place_y),
        crashed=no,
        impacted=no,
        impact_x=zeros,
        impact_y=zeros,
    )


def padded(world: World, count: int) -> World:
    """The world with room for ``count`` vehicles, static; those added are absent."""
    more = count - world.vehicles.x.shape[0]
    drivers, vehicles = jax.tree.map(
        lambda values: jnp.pad(values, (0, more), mode="edge"), (world.drivers, world.vehicles)
    )
    there = jnp.pad(world.vehicles.present, (0, more))
    return replace(world, drivers=drivers, vehicles=replace(vehicles, present=there))
