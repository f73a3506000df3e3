"""The reward of the paper, eq. (3) to (6), for one decision."""

import jax.numpy as jnp
from jax import Array

from lanewise.driving import observation
from lanewise.driving.settings import RewardSettings
from lanewise.world.state import World


def speed(speed: Array) -> Array:
    """Speed term r_v, eq. (3): 0 up to 5 m/s, 0.2 at 12.5, 1 at 15, falling fast above."""
    return jnp.where(
        speed > 15.0,
        jnp.exp(-jnp.square(jnp.maximum(speed, 15.0) - 15.0)),
        jnp.where(
            speed > 12.5,
            8.0 / 25.0 * speed - 19.0 / 5.0,
            jnp.where(speed > 5.0, 2.0 / 75.0 * speed - 2.0 / 15.0, 0.0),
        ),
    )


def centring(lane_offset: Array) -> Array:
    """Lane-centring term r_y = exp(-1.5 d^2), eq. (4); d in m from the nearest lane centre."""
    return jnp.exp(-1.5 * jnp.square(lane_offset))


def steering(angle: Array) -> Array:
    """Steering term r_theta = -|sin(theta)|, eq. (5); theta in rad."""
    return -jnp.abs(jnp.sin(angle))


def total(
    settings: RewardSettings,
    ego_speed: Array,
    lane_offset: Array,
    steering_angle: Array,
    accident: Array,
) -> Array:
    """Reward of a decision, eq. (6): the weighted mean of the terms, or the accident penalty.

    The speed, m/s, and the offset, m, are those after the decision, the angle, rad, is that of its
    action. Between -0.06 w_theta/sum(w) and 1 without an accident.
    """
    weights = settings.speed_weight + settings.steering_weight + settings.centring_weight
    driving = (
        settings.speed_weight * speed(ego_speed)
        + settings.steering_weight * steering(steering_angle)
        + settings.centring_weight * centring(lane_offset)
    ) / weights
    return jnp.where(accident, -settings.accident_penalty, driving)


def decision_reward(
    settings: RewardSettings, world: World, steering_angle: Array, accident: Array
) -> Array:
    """Reward of a decision that led to ``world``, eq. (6); see `total`."""
    offset = observation.lane_offset(world)
    return total(settings, world.vehicles.speed[0], offset, steering_angle, accident)
