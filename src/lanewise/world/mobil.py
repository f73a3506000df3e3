"""Lane changes: MOBIL decides when to start one, and a rival ahead aborts one.

Kesting, Treiber, Helbing, "General lane-changing model MOBIL for car-following models", 2007;
in the form of ``highway_env.vehicle.behavior.IDMVehicle.change_lane_policy``.
"""

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array, lax
from jax.typing import ArrayLike, DTypeLike

from lanewise.world import bitset, driver_model, idm, neighbours
from lanewise.world import road as roads
from lanewise.world.materialize import materialize, rounded
from lanewise.world.motion import Motion
from lanewise.world.neighbours import Front, Pair, Rear
from lanewise.world.observers import Observers, masked_apply
from lanewise.world.state import RULE_BASED, World, numbered

SLOWEST_CHANGE = 1.0
"""Nobody starts a lane change below this speed, m/s."""
DUE_COMPACTION = 10
"""One driver in so many thinks about a lane change in a tick: every second, at 10 Hz."""
CONTESTED_COMPACTION = 50
"""One driver in so many is changing to a lane that others are bound for; see docs/speed.md."""
TIMER_SLACK = 1e-5
"""More than float32 sums of ticks up to 1 s are off, s; see `timer-in-float32`."""
FASTEST_RATE = 100
"""Highest number of ticks a second at which the timer in float32 is known to be right."""


EARLY = tuple(
    rate for rate in range(1, FASTEST_RATE + 1) if np.add.accumulate([1 / rate] * rate)[-1] > 1
)
"""Ticks a second of which float64 sums pass 1 s by rounding, a tick early."""


def timer_slack(dtype: DTypeLike, duration: ArrayLike) -> Array | float:
    """What is added to a delay so that sums in float32 pass it when those in float64 do, s."""
    if dtype != jnp.float32:
        return 0.0
    with jax.ensure_compile_time_eval():  # A tick costs nothing more where its length is known.
        rate = jnp.rint(1 / jnp.asarray(duration, dtype))
        early = jnp.any(rate == jnp.array(EARLY, dtype))
        return jnp.where(early, -TIMER_SLACK, TIMER_SLACK).astype(dtype)


def due(world: World, motion: Motion, duration: ArrayLike) -> Array:
    """Which drivers think about a lane change in this tick, bool [N].

    Those not changing already whose timer is strictly above their delay (`strict-timer`).
    """
    vehicles, drivers = world.vehicles, world.drivers
    slack = timer_slack(vehicles.timer.dtype, duration)
    return (
        motion.decides
        & drivers.changes_lanes
        & (vehicles.target_lane == motion.lane)
        & (vehicles.timer > drivers.change_delay + slack)
    )


def _behind_me(world: World, motion: Motion, rear: Rear) -> Array:
    """Deceleration of a rear vehicle behind the decider, judged by the decider's model, m/s^2."""
    return driver_model.interaction(world.drivers, rear, neighbours.as_front(world, motion))


def _relief(world: World, motion: Motion, rear: Rear, front: Front) -> Array:
    """How much less a rear vehicle brakes behind ``front`` than behind the decider, m/s^2."""
    relief = _behind_me(world, motion, rear) - driver_model.following(world.drivers, rear, front)
    return jnp.where(rear.exists, relief, 0)


def gain(world: World, motion: Motion, own: Pair, new: Pair) -> Array:
    """What a lane change gains, a_me' - a_me + p (a_new' - a_new + a_old' - a_old), m/s^2; [N].

    Primes are after the change. The free-road terms cancel and are left out.
    """
    drivers, me = world.drivers, neighbours.as_rear(world, motion)
    my_gain = driver_model.following(drivers, me, own.front)
    my_gain -= driver_model.following(drivers, me, new.front)
    others_gain = _relief(world, motion, own.rear, own.front) - _relief(
        world, motion, new.rear, new.front
    )
    return my_gain + drivers.politeness * others_gain


def summed_gain(world: World, motion: Motion, own: Pair, new: Pair) -> Array:
    """`gain` as highway-env sums it up: free-road terms are rounded before they cancel.

    A rear vehicle that seems to want to stop has so large a term that little of the gain may be
    left (`cancelled-free-road-term`). Only in float64 can this be equal.
    """
    drivers, present = world.drivers, world.vehicles.present
    me = neighbours.as_rear(world, motion)

    def predicted(follower: Rear, *decelerations: Array) -> list[Array]:
        free = rounded(present, lambda: driver_model.free_road(drivers, follower))
        return [free - deceleration for deceleration in decelerations]

    def of_rear(rear: Rear, front: Front) -> list[Array]:
        behind_me = _behind_me(world, motion, rear)
        both = predicted(rear, behind_me, driver_model.following(drivers, rear, front))
        return [jnp.where(rear.exists, acceleration, 0) for acceleration in both]

    mine_after, mine = predicted(
        me,
        driver_model.following(drivers, me, new.front),
        driver_model.following(drivers, me, own.front),
    )
    new_after, new_before = of_rear(new.rear, new.front)
    old_before, old_after = of_rear(own.rear, own.front)
    others_gain = new_after - new_before + old_after - old_before
    return mine_after - mine + drivers.politeness * others_gain


def recommends(world: World, motion: Motion, own: Pair, new: Pair) -> Array:
    """Whether MOBIL recommends each vehicle a change to another lane, bool [N].

    The new rear vehicle must not brake harder than b_safe, and the `gain` must reach a_th. All
    accelerations are predicted with the decider's own model and parameters, unclipped.
    """
    drivers = world.drivers
    imposed = driver_model.free_road(drivers, new.rear) - _behind_me(world, motion, new.rear)
    safe = ~new.rear.exists | (imposed >= -drivers.imposed_braking)
    gained = summed_gain if world.vehicles.x.dtype == jnp.float64 else gain
    return safe & (gained(world, motion, own, new) >= drivers.minimum_gain)


def choose(world: World, motion: Motion, thinks: Array) -> Array:
    """Target lane, int32 [N], of every driver that may start a change now; others keep theirs."""
    vehicles = world.vehicles
    moving = thinks & (jnp.abs(vehicles.speed) >= SLOWEST_CHANGE)
    reachable = materialize(
        vehicles.present, lambda: roads.reachable_lanes(world.road, vehicles.x, vehicles.y)
    )
    return masked_apply(
        *(world, motion, moving, vehicles.target_lane),
        lambda observers: _chosen_lane(world, motion, observers, observers.own(reachable)),
        one_in=DUE_COMPACTION,
    )


def _chosen_lane(world: World, motion: Motion, observers: Observers, reachable: Array) -> Array:
    """The lane each vehicle of some observers prefers, of those it can reach; int32 [Q].

    Left is tried first, then right, and right overwrites left (`right-overwrites-left`).
    """
    mine, seen = observers.world, observers.motion
    # The lanes side by side: as many steps for the three of them as for one.
    lanes = seen.lane + jnp.array([0, -1, 1], jnp.int32).reshape(-1, *(1,) * seen.lane.ndim)
    around = materialize(observers.real, lambda: neighbours.both(world, motion, observers, lanes))
    own: Pair = jax.tree.map(lambda leaf: leaf[0], around)
    new: Pair = jax.tree.map(lambda leaf: leaf[1:], around)
    open_ = (reachable & roads.lane_bit(lanes[1:])) != 0
    left, right = open_ & recommends(mine, seen, own, new)
    target = jnp.where(left, lanes[1], mine.vehicles.target_lane)
    return jnp.where(right, lanes[2], target)


def aborts(world: World, motion: Motion, chosen: Array) -> Array:
    """Which changes under way are given up because of a rival, bool [N].

    A rival is another rule-based vehicle, outside the target lane, bound for it too, and ahead
    within the desired gap. Drivers decide in list order: driver i knows the new target of j < i and
    the old one of j > i, and a rival that has itself just given up is none any more. So ``abort``
    is the only fixed point of abort_i = sure_i or any_j<i (contest_ij and not abort_j), which
    iteration reaches in as many rounds as the longest chain, nearly always none.
    """
    vehicles, drivers = world.vehicles, world.drivers
    target, lane = vehicles.target_lane, motion.lane
    considers = motion.decides & drivers.changes_lanes & (target != lane)
    count, index = lane.shape[0], numbered(lane)

    def met(observers: Observers) -> bitset.Bitset:
        return _rivals(world, motion, observers, chosen)

    nobody = bitset.where(count, lambda _: jnp.zeros_like(considers))
    contested = considers & _is_contested(world, motion, chosen)
    rivals = masked_apply(world, motion, contested, nobody, met, one_in=CONTESTED_COMPACTION)
    changers = materialize(
        vehicles.present, lambda: bitset.where(count, lambda other: considers[other])
    )
    undecided = bitset.both(bitset.below(index, count), changers)
    unsettled = bitset.both(rivals, undecided)
    sure = bitset.inhabited(bitset.without(rivals, undecided))

    def settle(state: tuple[Array, Array]) -> tuple[Array, Array]:
        abort, _ = state
        given_up = bitset.where(count, lambda other: abort[other])
        settled = sure | bitset.inhabited(bitset.without(unsettled, given_up))
        return settled, jnp.any(settled != abort)

    start = sure, jnp.any(bitset.inhabited(unsettled))
    abort, _ = lax.while_loop(lambda state: state[1], settle, start)
    return abort


def _is_contested(world: World, motion: Motion, chosen: Array) -> Array:
    """Whether two vehicles or more are bound for the lane each is bound for, bool [N].

    A quick test that never misses a rival.
    """
    vehicles = world.vehicles
    target = roads.lane_bit(vehicles.target_lane)
    bound = (target | roads.lane_bit(chosen)) & ~roads.lane_bit(motion.lane)
    bound = jnp.where(vehicles.present & (world.drivers.kind == RULE_BASED), bound, 0)

    def bound_by_several() -> Array:
        some = several = jnp.zeros_like(bound[0])
        for number in range(bound.shape[0]):
            several |= some & bound[number]
            some |= bound[number]
        return several

    return (target & materialize(vehicles.present, bound_by_several)) != 0


def _rivals(world: World, motion: Motion, observers: Observers, chosen: Array) -> bitset.Bitset:
    """The rivals of each observer, which is changing lanes; [Q] sets of vehicles."""
    mine, seen = observers.world, observers.motion
    target = mine.vehicles.target_lane
    x, velocity_x, velocity_y, lane = observers.around(
        (world.vehicles.x, motion.velocity_x, motion.velocity_y, motion.lane)
    )
    rule_based = world.vehicles.present & (world.drivers.kind == RULE_BASED)
    rule_based, before, after = observers.around((rule_based, world.vehicles.target_lane, chosen))

    def contests(other: int) -> Array:
        rival_speed = velocity_x[other] * seen.cosine + velocity_y[other] * seen.sine
        gap = x[other] - mine.vehicles.x
        wanted = idm.desired_gap(
            mine.drivers, mine.vehicles.speed, mine.vehicles.speed - rival_speed
        )
        bound_for = jnp.where(other < observers.number, after[other], before[other])
        bound_too = rule_based[other] & (bound_for == target) & (lane[other] != target)
        return bound_too & (gap > 0) & (gap < wanted)

    return bitset.where(x.shape[0], contests)


def decide(world: World, motion: Motion, duration: ArrayLike) -> tuple[Array, Array]:
    """Every rule-based driver's target lane, int32 [N], and timer, s: 0 for those that thought."""
    thinks = due(world, motion, duration)
    chosen = choose(world, motion, thinks)
    target = jnp.where(aborts(world, motion, chosen), motion.lane, chosen)
    timer = jnp.where(thinks, 0, world.vehicles.timer)
    return target, timer
