"""What a controller may look at when it decides."""

from dataclasses import dataclass

import jax
import jax.numpy as jnp
from jax import Array

from lanewise.driving.settings import ObservationSettings
from lanewise.driving.task_functions import PAPER_TASK, TaskFunctions
from lanewise.system import pinned
from lanewise.world import road
from lanewise.world.state import Road, World


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Percept:
    """The 26 features, the ego in SI units, and the road."""

    features: Array
    """[26] scaled observation, or what a user's own function returns."""
    x: Array
    """[] m."""
    y: Array
    """[] m, positive to the right."""
    heading: Array
    """[] rad."""
    speed: Array
    """[] m/s."""
    lane: Array
    """int32 [] nearest lane."""
    road: Road
    """The lanes."""
    world: World | None = None
    """Everybody on the road: privileged, there in tests alone, read by reference drivers alone."""


def perceive(
    settings: ObservationSettings, world: World, task: TaskFunctions = PAPER_TASK
) -> Percept:
    """The percept of the ego in ``world``; the features alone have the settings' noise."""
    vehicles = world.vehicles
    features = task.observe(settings, world)
    if settings.noise:
        error = jax.random.normal(_key_of(world), features.shape, features.dtype)
        features += settings.noise * error
    return Percept(
        features=features,
        x=vehicles.x[0],
        y=vehicles.y[0],
        heading=vehicles.heading[0],
        speed=vehicles.speed[0],
        lane=road.closest_lane(world.road, vehicles.x[0], vehicles.y[0]),
        road=world.road,
    )


def _key_of(world: World) -> Array:
    """A random key made of the places of all vehicles, so that noise needs no state of its own.

    The same world is observed with the same noise, and after a tick it has nothing in common.
    Room for absent vehicles changes nothing.
    """
    vehicles = world.vehicles
    places = jnp.stack([vehicles.x, vehicles.y], axis=1).astype(jnp.float32)
    places = jnp.where(vehicles.present[:, None], places, 0.0).ravel()
    bits = jax.lax.bitcast_convert_type(places, jnp.uint32)
    odd = 2 * jnp.arange(bits.size, dtype=jnp.uint32) + 1
    return jax.random.fold_in(pinned.key(0), jnp.sum(bits * odd * jnp.uint32(2654435761)))
