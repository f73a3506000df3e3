"""What a controller observes: the paper's 26 features, or those of `lane_observation`.

The paper's are highway-env's ``Kinematics`` plus the ego's lane offset, in this order: ego
[presence, x, y, vx, vy], lane offset, then for each of the four vehicles nearest along the road
[presence, x, y, vx, vy] relative to the ego (zeros for missing vehicles).
"""

import jax.numpy as jnp
from jax import Array

from lanewise.driving import lane_observation
from lanewise.driving.lane_observation import Surroundings
from lanewise.driving.settings import VARIANTS, ObservationSettings
from lanewise.world import road
from lanewise.world.state import World

SIZE = VARIANTS["kinematics"]
"""Number of the paper's features."""
NEIGHBOURS = 4
"""Vehicles observed besides the ego."""
LANE_OFFSET = 5
"""Where the lane offset stands among the features."""
HIGHWAY_ENV_X = 200.0
"""highway-env reads this longitudinal distance as 1, m."""
HIGHWAY_ENV_SPEED = 80.0
"""highway-env reads this speed as 1, m/s."""


def nearest(world: World, perception_distance: float) -> tuple[Array, Array]:
    """Indices of the vehicles highway-env observes, nearest along the road first.

    A vehicle counts when its centre is nearer than ``perception_distance`` and not more than two
    car lengths behind the ego; ties keep the list's order.

    Returns:
        (int32 [4] indices, bool [4] whether there is such a vehicle).
    """
    vehicles = world.vehicles
    along = vehicles.x - vehicles.x[0]
    across = vehicles.y - vehicles.y[0]
    seen = (
        vehicles.present
        & (jnp.sqrt(along**2 + across**2) < perception_distance)
        & (along > -2.0 * world.drivers.length[0])
    )
    others = jnp.arange(along.shape[0]) > 0
    distance = jnp.where(seen & others, jnp.abs(along), jnp.inf)
    indices, found = [], []
    for _ in range(NEIGHBOURS):
        index = jnp.argmin(distance)
        indices.append(index)
        found.append(jnp.isfinite(distance[index]))
        distance = jnp.where(jnp.arange(distance.shape[0]) == index, jnp.inf, distance)
    return jnp.stack(indices).astype(jnp.int32), jnp.stack(found)


def lane_offset(world: World) -> Array:
    """The ego's signed distance from its nearest lane's centre, positive to the right, m; []."""
    x, y = world.vehicles.x[0], world.vehicles.y[0]
    return road.lateral_offset(world.road, road.closest_lane(world.road, x, y), y)


def raw(world: World, perception_distance: float) -> tuple[Array, Array]:
    """Features in SI units, before scaling.

    Returns:
        ([5, 5] rows of [presence, x, y, vx, vy], ego first and absolute, the others relative to
        it, m and m/s; [] lane offset, m).
    """
    vehicles = world.vehicles
    columns = jnp.stack(
        [
            jnp.ones_like(vehicles.x),
            vehicles.x,
            vehicles.y,
            vehicles.speed * jnp.cos(vehicles.heading),
            vehicles.speed * jnp.sin(vehicles.heading),
        ],
        axis=-1,
    )
    indices, found = nearest(world, perception_distance)
    relative = columns[indices] - columns[0].at[0].set(0.0)
    rows = jnp.concatenate([columns[:1], jnp.where(found[:, None], relative, 0.0)])
    offset = lane_offset(world)
    return rows, offset


def scaled(settings: ObservationSettings, world: World) -> tuple[Array, Array, Array]:
    """The features of `raw`, scaled and clipped; see `ObservationSettings` for the two scalings.

    Returns:
        ([5] the ego's row, [4, 5] rows of the others, [] lane offset).
    """
    rows, offset = raw(world, settings.perception_distance)
    width = jnp.sum(jnp.where(world.road.present, world.road.width, 0.0))
    half_lane = world.road.width[0] / 2.0
    if settings.scaling == "highway-env":
        ego_ranges = other_ranges = (
            1.0,
            HIGHWAY_ENV_X,
            width,
            HIGHWAY_ENV_SPEED,
            HIGHWAY_ENV_SPEED,
        )
    else:
        speed, relative = settings.speed_range, settings.relative_speed_range
        ego_ranges = (1.0, HIGHWAY_ENV_X, width, speed, relative)
        other_ranges = (1.0, settings.x_range, width, relative, relative)
    dtype, limit = rows.dtype, settings.limit
    ego = jnp.clip(rows[0] / jnp.asarray(ego_ranges, dtype), -limit, limit)
    others = jnp.clip(rows[1:] / jnp.asarray(other_ranges, dtype), -limit, limit)
    return ego, others, jnp.clip(offset / half_lane, -limit, limit)


def features(settings: ObservationSettings, world: World) -> Array:
    """The observation of a controller, [`settings.size`]."""
    if settings.variant == "lanes":
        found: Array = lane_observation.observe(jnp, surroundings(world))
        return found
    ego, others, lane = scaled(settings, world)
    return jnp.concatenate([ego, lane[None], others.reshape(-1)])


def surroundings(world: World) -> Surroundings:
    """What `lane_observation` reads of a world."""
    vehicles, drivers, road = world.vehicles, world.drivers, world.road
    return Surroundings(
        x=vehicles.x,
        y=vehicles.y,
        heading=vehicles.heading,
        speed=vehicles.speed,
        length=drivers.length,
        present=vehicles.present,
        lane_centre=road.centre,
        lane_width=road.width,
        lane_present=road.present,
    )
