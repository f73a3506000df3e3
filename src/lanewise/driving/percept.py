"""What a controller may look at when it decides."""

from dataclasses import dataclass

import jax
from jax import Array

from lanewise.driving import chance
from lanewise.driving.settings import ObservationSettings
from lanewise.driving.task_functions import PAPER_TASK, TaskFunctions
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
    settings: ObservationSettings,
    world: World,
    task: TaskFunctions = PAPER_TASK,
    training: bool = False,
) -> Percept:
    """The percept of the ego in ``world``; its features alone are noisy.

    In ``training`` the noise is as set for it.
    """
    vehicles = world.vehicles
    return Percept(
        features=chance.noisy(task.observe(settings, world), world, settings.noise_range(training)),
        x=vehicles.x[0],
        y=vehicles.y[0],
        heading=vehicles.heading[0],
        speed=vehicles.speed[0],
        lane=road.closest_lane(world.road, vehicles.x[0], vehicles.y[0]),
        road=world.road,
    )
