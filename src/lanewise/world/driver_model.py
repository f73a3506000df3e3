"""What rule-based drivers command, each by the model it drives by.

A driver's model is the IDM with the lane keeping of `steering`; for those in ``Drivers.linear`` it
is `linear`. Each is a free-road term minus an interaction with the leader. Without linear drivers
nothing of `linear` is computed, and a tick is the same program as if it did not exist.
"""

import jax.numpy as jnp
from jax import Array

from lanewise.world import idm, linear, neighbours, steering
from lanewise.world.materialize import materialize
from lanewise.world.motion import Motion
from lanewise.world.neighbours import Front, Rear
from lanewise.world.observers import Observers, all_vehicles, masked_apply
from lanewise.world.state import Drivers, World

CHANGING_COMPACTION = 20
"""One driver in so many is changing lanes; see docs/speed.md."""


def free_road(drivers: Drivers, follower: Rear) -> Array:
    """Acceleration of a follower on an empty lane, by the models of ``drivers``, m/s^2; [N]."""
    by_idm = idm.free_road(drivers, follower.effort)
    if drivers.linear is None or follower.shortfall is None:
        return by_idm
    by_linear = linear.free_road(drivers.linear, follower.shortfall)
    return jnp.where(drivers.linear.applies, by_linear, by_idm)


def interaction(drivers: Drivers, follower: Rear, leader: Front) -> Array:
    """Deceleration of a follower because of a leader, by the models of ``drivers``, m/s^2; [N]."""
    leader_speed = leader.velocity_x * follower.cosine + leader.velocity_y * follower.sine
    closing_speed, gap = follower.speed - leader_speed, leader.x - follower.x
    by_idm = idm.interaction(drivers, follower.speed, closing_speed, gap)
    if drivers.linear is None or leader.speed is None:
        return by_idm
    by_linear = linear.interaction(drivers, drivers.linear, follower.speed, leader.speed, gap)
    return jnp.where(drivers.linear.applies, by_linear, by_idm)


def following(drivers: Drivers, follower: Rear, front: Front) -> Array:
    """As `interaction`, 0 where there is no leader."""
    return jnp.where(front.exists, interaction(drivers, follower, front), 0)


def accelerate(world: World, motion: Motion, target_lane: Array) -> Array:
    """Acceleration every rule-based driver commands, within its limit, m/s^2; [N].

    While it changes lanes, to the target lane int32 [N] of this tick, the smaller of two lanes'.
    """

    def behind_both(observers: Observers) -> Array:
        front = neighbours.front(world, motion, observers, observers.own(target_lane))
        mine = neighbours.as_rear(observers.world, observers.motion)
        return jnp.maximum(observers.own(braking), following(observers.world.drivers, mine, front))

    me = neighbours.as_rear(world, motion)
    front = neighbours.front(world, motion, all_vehicles(world, motion), motion.lane)
    braking = materialize(world.vehicles.present, lambda: following(world.drivers, me, front))
    changes = motion.decides & (target_lane != motion.lane)
    braking = masked_apply(world, motion, changes, braking, behind_both, one_in=CHANGING_COMPACTION)
    limit = world.drivers.acceleration_limit
    return jnp.clip(free_road(world.drivers, me) - braking, -limit, limit)


def keep_lane(world: World, target_lane: Array) -> Array:
    """Sine of the slip angle, [N], that every driver commands to follow its target lane."""
    by_idm, law = steering.keep_lane(world, target_lane), world.drivers.linear
    if law is None:
        return by_idm
    return jnp.where(law.applies, linear.keep_lane(world, law, target_lane), by_idm)
