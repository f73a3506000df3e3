"""Chance that is drawn from a world itself, so that it needs no state of its own.

A world that is the same to the bit draws the same; once anybody has moved, it has nothing in
common with what was drawn before.
"""

import jax
import jax.numpy as jnp
from jax import Array

from lanewise.system import pinned
from lanewise.world.state import World


def key(world: World) -> Array:
    """A random key made of the places of all vehicles; room for absent ones changes nothing."""
    vehicles = world.vehicles
    places = jnp.stack([vehicles.x, vehicles.y], axis=1).astype(jnp.float32)
    places = jnp.where(vehicles.present[:, None], places, 0.0).ravel()
    bits = jax.lax.bitcast_convert_type(places, jnp.uint32)
    odd = 2 * jnp.arange(bits.size, dtype=jnp.uint32) + 1
    return jax.random.fold_in(pinned.key(0), jnp.sum(bits * odd * jnp.uint32(2654435761)))


def noisy(features: Array, world: World, size: tuple[float, float]) -> Array:
    """Features with a normal error each, its standard deviation uniform between two."""
    low, high = size
    if not high:
        return features
    size_key, error_key = jax.random.split(key(world))
    deviation = low + (high - low) * jax.random.uniform(size_key, (), features.dtype)
    return features + deviation * jax.random.normal(error_key, features.shape, features.dtype)


def ticks(world: World, low: int, high: int) -> Array:
    """A whole number between two, both included, int32 []."""
    return jax.random.randint(jax.random.fold_in(key(world), 2), (), low, high + 1, jnp.int32)
