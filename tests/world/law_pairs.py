"""A world and its symmetric copy, each a tick later in our world and in highway-env."""

from dataclasses import replace

import jax
import numpy as np
from law_symmetries import mirrored, mirrored_vehicles
from law_worlds import after, fit, stack, taken
from laws_strategies import BATCH, SIZE

from lanewise.interop.highway_env import build_env, read_world
from lanewise.world.state import World


def both(world):
    """Vehicles a tick later, ours and highway-env's, as NumPy arrays."""
    batch = stack([fit(world, SIZE)] * BATCH)
    count = world.vehicles.x.shape[0]
    env = build_env(world)
    env.road.act()
    env.road.step(0.1)
    return jax.tree.map(lambda leaf: leaf[0, :count], after(batch)), read_world(env).vehicles


def mirror_both(world):
    """As `both`, of the mirrored world, mirrored back."""
    lanes = np.array([world.road.present.shape[0]])
    other = one(mirrored(many(world)))
    return [one(mirrored_vehicles(many(vehicles), lanes)) for vehicles in both(other)]


def reorder_both(world, order):
    """As `both`, of the world in another order, brought back."""
    order, batch = np.asarray(order)[None], many(world)
    other = World(batch.road, taken(batch.drivers, order), taken(batch.vehicles, order))
    back = order.argsort(axis=1)
    return [one(taken(many(vehicles), back)) for vehicles in both(one(other))]


def many(tree):
    return jax.tree.map(lambda leaf: np.asarray(leaf)[None], tree)


def one(tree):
    return jax.tree.map(lambda leaf: leaf[0], tree)


def change(world, **values):
    values = {
        name: np.asarray(value, getattr(world.vehicles, name).dtype)
        for name, value in values.items()
    }
    return replace(world, vehicles=replace(world.vehicles, **values))


def assert_broken(world, copy, name, vehicle):
    """Both worlds break the law in the same way: `name` of a vehicle differs after a tick."""
    for ours, theirs in (world, copy):
        np.testing.assert_allclose(getattr(ours, name), getattr(theirs, name), atol=1e-12)
    for mine, its in zip(world, copy, strict=True):
        before, other = (float(getattr(vehicles, name)[vehicle]) for vehicles in (mine, its))
        assert abs(before - other) > 1e-3
