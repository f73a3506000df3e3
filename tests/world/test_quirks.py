"""Quirks of docs/numerics.md, seen in highway-env and in our world."""

from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from highway_env.envs import HighwayEnv

from lanewise.interop.highway_env import build_env, command_table, read_world
from lanewise.world import idm, mobil, motion, tick
from lanewise.world.settings import LINEAR_DRIVER, PAPER_DRIVER, DriverSettings
from lanewise.world.state import RULE_BASED
from lanewise.world.steering import slip_sine
from small_worlds import (
    after,
    assert_same,
    both,
    change,
    make_world,
    single,
)


def assert_equal(ours, theirs, names=("x", "y", "heading", "speed", "target_lane", "crashed")):
    assert_same(ours, theirs, names=names, **dict.fromkeys(names, 1e-12))


def targets(world):
    """Target lanes after a tick, the same in both worlds."""
    ours, theirs = both(world)
    assert_equal(ours, theirs, ("target_lane",))
    return ours.target_lane.tolist()


def nudged(world, offset, ticks):
    """highway-env's vehicles after some ticks, all of them begun so far further to the right."""
    env = build_env(world)
    for vehicle in env.road.vehicles:
        vehicle.position[1] += offset
    for _ in range(ticks):
        env.road.act()
        env.road.step(0.1)
    return read_world(env).vehicles


RATES, DELAYS = np.arange(1, 101), (1.0, 0.3, 2.0, 10.0)


def ticks_until_due(dtype):
    """Ticks after which a driver whose timer has just restarted thinks again, [delays, rates]."""
    with jax.enable_x64(dtype == "float64"):
        world = make_world([0.0], [0], 10.0, kinds=[RULE_BASED], size=1)
        world = single(world) if dtype == "float32" else world
        drivers, vehicles = world.drivers, world.vehicles

        @jax.jit
        def due(delay, duration):
            seen = motion.observe(world, motion.heading_trig(vehicles))
            own = replace(world, drivers=replace(drivers, change_delay=delay[None]))

            def later(timer, _):
                now = replace(own, vehicles=replace(vehicles, timer=timer))
                return tick.wait(now, duration).vehicles.timer, mobil.due(now, seen, duration)[0]

            ticks = int(max(DELAYS) * max(RATES)) + 3
            return jnp.argmax(jax.lax.scan(later, jnp.zeros(1, dtype), length=ticks)[1])

        each = jax.vmap(jax.vmap(due, (None, 0)), (0, None))
        return np.array(each(jnp.asarray(DELAYS, dtype), jnp.asarray(1 / RATES, dtype)))


def test_timer_in_float32_fires_as_float64_sums_at_every_rate():
    """Other delays than 1 s are exact in float64; in float32 a whole number of ticks may be off."""
    delays = np.array(DELAYS)[:, None]
    sums = np.add.accumulate(np.broadcast_to(1 / RATES, (1003, len(RATES))))
    exact = np.array([np.argmax(sums > delay, axis=0) + 1 for delay in DELAYS])
    assert ticks_until_due("float64").tolist() == exact.tolist()
    apart = ticks_until_due("float32") - exact
    assert not apart[0].any()
    assert (np.abs(apart[1:]).max(axis=1) == 1).all()
    whole = np.abs(delays * RATES - np.round(delays * RATES)) < 1e-9
    assert not apart[~whole].any()


def test_strict_timer():
    for timer, fired in ((1.0, False), (np.nextafter(1.0, 2), True)):
        ours, theirs = both(make_world([0, 100], [0, 0], timer=[0.5, timer]))
        assert (ours.timer[1] < 1) == (theirs.timer[1] < 1) == fired


@pytest.mark.parametrize(("known_speed", "target_lane"), [(0.0, 0), (12.5, 1)])
def test_missing_target_speed(known_speed, target_lane):
    """A car wants to pass a slow one; an ego 200 m behind in the other lane keeps it back."""
    world = make_world([0, 200, 222], [1, 0, 0], [12.5, 12.5, 8.0], lanes=2, timer=[1, 2, 1],
                       kinds=[0, 2, 1])  # fmt: skip
    assert targets(change(world, "drivers", target_speed=[known_speed]))[1] == target_lane


def test_cancelled_free_road_term():
    """The old rear vehicle is the ego: its 5e11 m/s^2 cancel, in float32 too."""
    world = make_world([0.0, 30.0, 52.0], [0, 0, 0], [12.5, 12.5, 8.0], timer=[0.5, 1.5, 0.5],
                       kinds=[0, 2, 1])  # fmt: skip
    ego, driver, _ = build_env(world).road.vehicles
    assert abs(driver.acceleration(ego, driver)) > 1e11
    assert [after(each).target_lane[1] for each in (world, single(world))] == [1, 1]


def test_rounding_of_the_cancelled_free_road_term():
    """With an exponent of 6 the ego's 3e17 m/s^2 swallow what it would gain: no change."""
    world = make_world([100, 110.13, 202.94], [1, 1, 2], [9.49, 10.87, 9.65], kinds=[0, 2, 1],
                       timer=[0.5, 1.5, 0.5], settings=DriverSettings(exponent=6.0))  # fmt: skip
    assert targets(world)[1] == 1
    assert after(single(world)).target_lane[1] == 2


def test_unfloored_desired_gap():
    assert_equal(*both(make_world([-50, 0, 20], [0, 0, 0], [10, 10, 39], kinds=[0, 2, 1])))
    assert idm.desired_gap(make_world([0], [0]).drivers, 10.0, -29.0)[0] < 0


@pytest.mark.parametrize(("speed", "changes"), [(0.9, False), (1.1, True)])
def test_no_change_below_walking_pace_but_the_timer_restarts(speed, changes):
    """Nothing but its speed keeps the driver in its lane."""
    world = make_world([-90, 0, 12], [1, 1, 1], [5, speed, 0], timer=[1, 2, 1], kinds=[0, 2, 1])
    ours, theirs = both(world)
    assert (ours.target_lane[1] != 1) == (theirs.target_lane[1] != 1) == changes
    assert ours.timer[1] == theirs.timer[1] == 0.1


def test_deciders_parameters_judge_the_others():
    """A jumpy driver's own time gap does not count; the decider's does."""
    jumpy = DriverSettings(time_gap=9.0, imposed_braking=0.0)
    world = make_world([-200, 0, -22, 22], [0, 0, 1, 0], [12, 12, 12, 8], lanes=2,
                       settings=[PAPER_DRIVER, PAPER_DRIVER, jumpy, PAPER_DRIVER],
                       kinds=[0, 2, 2, 1], timer=[0.5, 1.5, 0.5, 0.5])  # fmt: skip
    assert targets(world)[1] == 1


def test_smaller_of_two_lanes():
    world = make_world([-90, 0, 18, 60], [2, 0, 1, 0], [12, 12, 6, 12], kinds=[0, 2, 1, 1])
    ours, theirs = both(change(world, target_lane=[2, 1]))
    assert_equal(ours, theirs, ("acceleration",))
    assert ours.acceleration[1] == -1.0


@pytest.mark.parametrize("order", [[1, 2, 3], [3, 2, 1], [2, 1, 3], [2, 3, 1]])
def test_aborts_in_list_order(order):
    """Three cars in a column bound for one lane: who gives up depends on the list."""
    x = np.array([0.0, 12.0, 24.0])[np.array(order) - 1]
    world = make_world([-300.0, *x], [2, 0, 0, 0])
    assert {0, 1} <= set(targets(change(world, target_lane=[2, 1, 1, 1]))[1:])


def test_new_targets_of_earlier_vehicles_are_seen():
    """A change that starts in this tick aborts one of a later vehicle, not of an earlier."""
    for starter, changer, aborted in ((1, 2, True), (2, 1, False)):
        x, target, timer = np.full(4, -300.0), np.zeros(4, int), np.full(4, 0.5)
        x[starter], x[changer], x[3] = 15.0, 0.0, 37.0
        target[changer], timer[starter] = 1, 1.5
        world = make_world(x, [0] * 4, [12, 12, 12, 8], lanes=2, kinds=[0, 2, 2, 1], timer=timer)
        found = targets(change(world, target_lane=target))
        assert (found[starter], found[changer]) == (1, 0 if aborted else 1)


@pytest.mark.parametrize(("offset", "found"), [(3.0, True), (3.001, False)])
def test_a_changing_vehicle_is_on_two_lanes(offset, found):
    world = make_world([0, 0, 12], [2, 1, 0], y=[8, 4, 4 - offset], kinds=[0, 2, 1])
    ours, theirs = both(world)
    assert_equal(ours, theirs, ("acceleration",))
    assert (ours.acceleration[1] < 0) == found


def test_target_speed_is_clipped_to_the_limit():
    ours, theirs = both(make_world([-90, 0], [0, 0], 29, settings=DriverSettings(target_speed=50)))
    assert_equal(ours, theirs)
    np.testing.assert_allclose(ours.acceleration[1], 0.5 * (1 - (29 / 30) ** 4))


def test_a_lane_without_limit_clips_no_target_speed():
    world = make_world([-90, 0, 60], [0, 0, 0], [29, 39, 38], settings=DriverSettings(50.0))
    ours, theirs = both(change(world, "road", speed_limit=np.inf), 20)
    assert_equal(ours, theirs)
    assert theirs.speed[2] > 38


def test_content_without_target_speed():
    """The ego of `test_missing_target_speed` keeps no linear driver back."""
    place = {"x": [0, 200, 222], "lane": [1, 0, 0], "speed": [12.5, 12.5, 8.0], "lanes": 2}
    place |= {"timer": [1, 2, 1], "kinds": [0, 2, 1]}
    for settings, lane in ((PAPER_DRIVER, 0), (replace(LINEAR_DRIVER, time_gap=1.5), 1)):
        assert targets(make_world(**place, settings=settings))[1] == lane


def test_unclipped_target_speed():
    settings = replace(LINEAR_DRIVER, target_speed=35.0)
    ours, theirs = both(make_world([-90, 0], [0, 0], 30, settings=settings))
    assert_equal(ours, theirs)
    np.testing.assert_allclose(ours.acceleration[1], 0.3 * 5)


@pytest.mark.parametrize(("speed", "brakes"), [(11.9, True), (12.0, False)])
def test_unprojected_speeds(speed, brakes):
    """A leader at a right angle gets nothing further, and only its own speed counts."""
    settings = replace(LINEAR_DRIVER, target_speed=12.0)
    world = make_world([-90, 0, 90], [0, 0, 0], [5, 12, speed], heading=[0, 0, np.pi / 2],
                       kinds=[0, 2, 1], settings=settings)  # fmt: skip
    ours, theirs = both(world)
    assert_equal(ours, theirs)
    assert (ours.acceleration[1] < -0.02) == brakes


@pytest.mark.parametrize("distance", [60.0, 9000.0])
def test_slower_leader_at_any_distance(distance):
    settings = replace(LINEAR_DRIVER, target_speed=12.0)
    world = make_world([-90, 0, distance], [0, 0, 0], [5, 12, 2], kinds=[0, 2, 1],
                       settings=settings)  # fmt: skip
    ours, theirs = both(world)
    assert_equal(ours, theirs)
    np.testing.assert_allclose(ours.acceleration[1], -0.3 * 10)


@pytest.mark.parametrize(("settings", "turns"), [(PAPER_DRIVER, False), (LINEAR_DRIVER, True)])
def test_unlimited_approach(settings, turns):
    """Far from its lane at low speed, a linear driver turns until it drives back."""
    settings = replace(settings, target_speed=5.0, steering_limit=np.pi / 3)
    world = make_world([-90, 0], [0, 0], 5, y=[0, 20], settings=settings)
    ours, theirs = both(world, 30)
    assert_equal(ours, theirs)
    assert (ours.heading[1] < -np.pi / 2) == turns


def test_same_random_gains():
    """Randomised, Aggressive and Defensive vehicles are LinearVehicles with another MOBIL gain."""
    worlds = []
    for kind in ("Linear", "Aggressive", "Defensive"):
        others = f"highway_env.vehicle.behavior.{kind}Vehicle"
        action = {"type": "DiscreteAction"}
        env = HighwayEnv(config={"action": action, "other_vehicles_type": others})
        env.reset(seed=0)
        worlds.append(read_world(env))
    calm, *two = worlds
    jax.tree.map(np.testing.assert_array_equal, *two)
    least = change(calm, "drivers", minimum_gain=two[0].drivers.minimum_gain)
    jax.tree.map(np.testing.assert_array_equal, least, two[0])
    assert len(set(calm.drivers.linear.gap_gain[1:])) == 50


@pytest.mark.parametrize(("y", "heading", "again"), [(0.3, 0.0, True), (1.9, 0.1, False)])
def test_predicted_hit_moves_and_crashes_on_the_next_tick(y, heading, again):
    """Though nothing may touch any more, where one pulls out of the way a little too late."""
    world = make_world([-2.4, 5.5], [0, 0], [25.0, 5.0], kinds=[0, 1], y=[0, y],
                       heading=[0, heading])  # fmt: skip
    for ticks, impacted, crashed in ((1, True, False), (2, again, True)):
        ours, theirs = both(world, ticks)
        assert_equal(ours, theirs, ("x", "y", "speed", "crashed", "impacted", "impact_x"))
        assert ours.impacted.tolist() == [impacted] * 2
        assert ours.crashed.tolist() == [crashed] * 2


def test_clipped_command_persists():
    world = make_world([0.0, 500.0], [0, 0], [39.95, 5.0], kinds=[0, 1])
    ours, theirs = both(change(world, acceleration=[1.0]), 10)
    assert_equal(ours, theirs, ("speed", "acceleration"))
    assert ours.speed[0] > 40
    assert ours.acceleration[0] < 0


@pytest.mark.parametrize(("speed", "acceleration"), [(2.8, 3.1), (5.9, 3.1)])
def test_top_speed_edge(speed, acceleration):
    """Whether sums of 0.31 m/s pass 40 m/s or end at it is rounding, the same in both."""
    world = change(make_world([0.0], [0], speed, kinds=[0]), acceleration=[acceleration])
    ticks = round((40 - speed) / acceleration * 10)
    for more in (0, 1):
        ours, theirs = both(world, ticks + more)
        assert ours.speed[0] == theirs.speed[0]


def test_standstill_and_reversing():
    """A driver comes to a stop and backs away: 1e-13 m aside become more than a micrometre."""
    world = make_world([150, 150, 127.8], [0, 1, 1], [0, 0, 3.3], y=[0.41, 3.8, 4.11],
                       kinds=[0, 1, 2], lanes=2)  # fmt: skip
    ours, theirs = both(world, 100)
    assert_equal(ours, theirs, ("crashed", "target_lane"))
    assert_same(ours, theirs, names=("x", "y"), x=0.25, y=0.25)
    assert theirs.speed[2] < -0.4
    others = [nudged(world, offset, 100).y[2] for offset in (1e-13, -1e-13)]
    assert np.abs(np.array(others) - theirs.y[2]).max() > 1e-6


def test_wrecks_at_rest():
    """Pushed until they just touch, wrecks are about to collide or not by rounding."""
    world = make_world([-300, 0, 30], [1, 0, 0], [0, 20, 0], y=[4, 1.7, 0], kinds=[0, 1, 1],
                       lanes=2)  # fmt: skip
    flags = []
    for ticks in range(13, 18):
        ours, theirs = both(world, ticks)
        assert ours.crashed.tolist() == [False, True, True]
        for other in (ours, nudged(world, 1e-15, ticks)):
            assert_equal(other, theirs, ("x", "y", "heading", "speed", "crashed"))
            flags.append((other.impacted == theirs.impacted).all())
    assert not all(flags)


def test_crashed_vehicles_neither_steer_nor_decide():
    world = make_world([0, 90], [0, 0], [20, 10], heading=0.1, timer=[1, 3])
    given = {"acceleration": [1.0], "slip_sine": [float(slip_sine(0.3))]}
    ours, theirs = both(change(world, crashed=[True, True], target_lane=[0, 1], **given), 3)
    assert_equal(ours, theirs)
    np.testing.assert_allclose(ours.speed[0], 20 * 0.9**3)
    np.testing.assert_allclose(ours.heading, 0.1)
    np.testing.assert_allclose(ours.timer[1], 3.3)


@pytest.mark.parametrize("crashed", [False, True])
def test_a_crashed_driver_keeps_a_lane_that_it_would_leave(crashed):
    world = make_world([-90, 0, 14], [1, 1, 1], [5, 8, 2], timer=[1, 2, 1], kinds=[0, 2, 1])
    ours, theirs = both(change(world, crashed=[False, crashed]))
    assert_equal(ours, theirs, ("x", "y", "speed", "target_lane"))
    assert ours.timer[1] == theirs.timer[1]
    assert (ours.target_lane[1] == 1) == crashed


def test_float32_actions():
    table = command_table(build_env(make_world([0, 90], [0, 0])))
    assert table[2, 1] != np.pi / 50
    exact = [(action // 3 - 1, (action % 3 - 1) * np.pi / 50) for action in range(9)]
    np.testing.assert_allclose(table, exact, rtol=1e-7)


def test_constructor_zeros():
    """A timer or target speed of zero survives the way to highway-env and back."""
    world = change(make_world([0, 90], [0, 0]), timer=[0.5, 0.0])
    again = read_world(build_env(change(world, "drivers", target_speed=[12.5, 0.0])))
    assert again.vehicles.timer[1] == again.drivers.target_speed[1] == 0
