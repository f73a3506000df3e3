"""Laws of motion: what one tick can and cannot do to a vehicle, whatever is around it."""

import numpy as np
from law_worlds import (
    NUMBERS,
    PUSHES,
    TICK,
    Found,
    Law,
    after,
    drivers_with,
    lane_distances,
    lane_of,
    road_with,
    vehicles_with,
)

from lanewise.world.state import CONSTANT, EXTERNAL, RULE_BASED

TOP = 40.0
"""Beyond this speed accelerations are cut, m/s; see `world.settings.TOP_SPEED`."""
ROUNDING = 1e-12


def motion(worlds, rng):
    """Nobody leaps, spins, or leaves the numbers.

    All numbers stay finite; |move| <= |v| dt + |impact|; |turn| <= |v| sin(slip) / (L / 2) dt with
    the slip commanded, for rule-based drivers at most their limit.
    """
    before, now = worlds.vehicles, after(worlds)
    present = before.present
    found = Found(present.shape[0])
    for name in NUMBERS + PUSHES:
        found.require(f"finite {name}", np.isfinite(getattr(now, name)), present)
    pushed = np.where(before.impacted, np.hypot(before.impact_x, before.impact_y), 0)
    moved = np.hypot(now.x - before.x, now.y - before.y)
    excess = moved - np.abs(before.speed) * TICK - pushed
    found.expect("leap", np.maximum(excess, 0), ROUNDING, present)
    by_rules = present & (worlds.drivers.kind == RULE_BASED) & ~before.crashed
    slip = np.where(before.crashed, 0, now.slip_sine)
    turn = before.speed * slip / (worlds.drivers.length / 2) * TICK
    found.expect("turn", now.heading - before.heading - turn, ROUNDING, present)
    limit = worlds.drivers.slip_limit * (1 + ROUNDING)
    found.require("steering limit", np.abs(now.slip_sine) <= limit, by_rules & ~now.crashed)
    return found


def speed(worlds, rng):
    """Speeds change as commanded, and no command is beyond a driver's limit.

    v' = v + a dt for all, a = -v for the crashed; a rule-based driver's |a| stays within its limit
    and an external one's is the command, but beyond 40 m/s, where a <= 40 - |v| brings everybody
    back (`clipped-command-persists`): |v'| <= max(|v|, 40 + |a| dt). Constant drivers without a
    command keep their speed to the bit. IDM drivers may reverse (`drivers-may-reverse`).
    """
    before, now, drivers = worlds.vehicles, after(worlds), worlds.drivers
    present = before.present
    found = Found(present.shape[0])
    change = now.speed - before.speed
    found.expect("v + a dt", change - now.acceleration * TICK, ROUNDING, present)
    hit = present & before.crashed
    usual = np.abs(before.speed) <= TOP
    found.expect("crashed", now.acceleration + before.speed, ROUNDING, hit & usual)
    by_rules = present & (drivers.kind == RULE_BASED) & ~before.crashed & usual
    within = np.abs(now.acceleration) <= drivers.acceleration_limit
    found.require("acceleration limit", within, by_rules)
    obeys = present & (drivers.kind != RULE_BASED) & ~before.crashed & usual
    found.require("command", now.acceleration == before.acceleration, obeys)
    idle = obeys & (drivers.kind == CONSTANT) & (before.acceleration == 0)
    found.require("constant speed", now.speed == before.speed, idle)
    largest = np.maximum(np.abs(before.acceleration), drivers.acceleration_limit)
    most = np.maximum(np.abs(before.speed), TOP + largest * TICK)
    found.require("top speed", np.abs(now.speed) <= most + ROUNDING, present)
    return found


def lanes(worlds, rng):
    """A lane is always one that exists, and targets change to a neighbouring lane or back.

    Only by drivers who change lanes, at 1 m/s or faster if a change begins; timers restart at
    most then, and go on by dt.
    """
    before, now, drivers = worlds.vehicles, after(worlds), worlds.drivers
    present = before.present
    found = Found(present.shape[0])
    count = worlds.road.present.sum(axis=1)[:, None]
    lane, target = lane_of(worlds), before.target_lane
    nearest = lane_distances(vehicles_with(worlds, x=now.x, y=now.y)).argmin(axis=-1)
    found.require("nearest lane", nearest < count, present)
    found.require("target lane", (now.target_lane >= 0) & (now.target_lane < count), present)
    chooses = (drivers.kind == RULE_BASED) & drivers.changes_lanes & ~before.crashed
    kept = now.target_lane == target
    found.require("keeps its lane", kept, present & ~chooses)
    began = present & (target == lane) & ~kept
    found.require("neighbouring lane", np.abs(now.target_lane - lane) == 1, began)
    found.require("walking pace", np.abs(before.speed) >= 1, began)
    found.require("timer", now.timer == TICK, began)
    gave_up = present & (target != lane) & ~kept
    found.require("back to its lane", now.target_lane == lane, gave_up)
    restarts = (now.timer == TICK) & (before.timer > drivers.change_delay) & (target == lane)
    goes_on = now.timer == np.where(drivers.kind == RULE_BASED, before.timer + TICK, before.timer)
    found.require("timer", goes_on | (restarts & chooses), present)
    return found


def crashes(worlds, rng):
    """Who has crashed stays so, who was hit crashes, and pushes are equal and opposite.

    Where exactly two vehicles are hit, their pushes add up to nothing, to the bit; of more,
    `last-impact-wins`. Whoever overlaps nobody does not crash.
    """
    before, now = worlds.vehicles, after(worlds)
    present = before.present
    found = Found(present.shape[0])
    found.require("stays crashed", now.crashed, present & before.crashed)
    found.require("crashes when hit", now.crashed, present & before.impacted)
    pair = (now.impacted & present).sum(axis=1) == 2
    for name in PUSHES:
        push = np.where(now.impacted & present, getattr(now, name), 0)
        found.require(f"opposite {name}", push.sum(axis=1)[:, None] == 0, pair[:, None])
    apart = np.hypot(
        now.x[:, :, None] - now.x[:, None], now.y[:, :, None] - now.y[:, None]
    ) + 1e9 * np.eye(present.shape[1])
    apart = np.where(present[:, None], apart, np.inf).min(axis=2)
    diagonal = np.hypot(worlds.drivers.length, worlds.drivers.width).max()
    clear = present & (apart > diagonal) & ~before.impacted & ~before.crashed
    found.require("clear of all", ~now.crashed, clear)
    return found


def straight(worlds, rng):
    """Who stands in the middle of its lane and wants nothing stays there, to the bit.

    Everybody with heading 0 on the centre of the own lane, which is also the target: y and
    heading are kept by rule-based drivers that do not begin a change, and by an ego or a
    constant driver without a steering command, whose x grows by v dt.
    """
    lane = lane_of(worlds)
    centre = np.take_along_axis(worlds.road.centre, lane, 1)
    zero = np.zeros_like(worlds.vehicles.x)
    worlds = vehicles_with(
        worlds,
        y=centre,
        heading=zero,
        slip_sine=zero,
        target_lane=lane,
        impacted=np.zeros_like(worlds.vehicles.impacted),
    )
    before, now = worlds.vehicles, after(worlds)
    present = before.present
    found = Found(present.shape[0])
    stays = present & (now.target_lane == lane)
    found.require("y", now.y == before.y, stays)
    found.require("heading", now.heading == 0, stays)
    plain = stays & np.isin(worlds.drivers.kind, (EXTERNAL, CONSTANT))
    found.expect("v dt", now.x - before.x - before.speed * TICK, ROUNDING, plain)
    return found


def free_road(worlds, rng):
    """Alone on the road a driver nears its target speed and never passes it.

    For 0 <= v <= v0: v <= v' <= v0, as long as a delta dt <= v0.
    """
    present = np.zeros_like(worlds.vehicles.present)
    present[:, 0] = True
    target = np.maximum(worlds.drivers.target_speed, 2.0)
    road = road_with(worlds, speed_limit=np.full_like(worlds.road.speed_limit, 40.0)).road
    worlds = drivers_with(worlds, kind=np.full_like(worlds.drivers.kind, RULE_BASED))
    worlds = drivers_with(worlds, target_speed=target)
    share = rng.choice([0.0, 1.0, 2.0], target.shape, p=[0.1, 0.1, 0.8])
    share = np.where(share == 2.0, rng.random(target.shape), share)
    worlds = vehicles_with(
        worlds, present=present, speed=target * share, crashed=np.zeros_like(present)
    )
    worlds = type(worlds)(road, worlds.drivers, worlds.vehicles)
    before, now = worlds.vehicles, after(worlds)
    found = Found(present.shape[0])
    steep = worlds.drivers.comfort_acceleration * worlds.drivers.exponent * TICK > target
    slow = present & ~steep
    found.require("gains", now.speed >= before.speed, slow)
    found.require("does not pass", now.speed <= target * (1 + ROUNDING), slow)
    return found


LAWS = (
    Law("motion", "Nobody leaps, spins or leaves the numbers", "1e-12 m, 1e-12 rad", motion),
    Law("speed", "Speeds change as commanded, within each driver's limit", "1e-12 m/s", speed),
    Law("lanes", "Lanes exist, targets are neighbours, timers go on", "equal", lanes),
    Law("crashes", "Crashed stays crashed; pushes are equal and opposite", "equal", crashes),
    Law("straight", "Who is in the middle of its lane stays there", "equal to the bit", straight),
    Law("free-road", "Alone, a driver nears its target speed and never passes it", "1e-12",
        free_road),
)  # fmt: skip
