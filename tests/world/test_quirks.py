"""Every quirk of docs/numerics.md, seen in highway-env and in our world."""

from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from world_views import look, neighbours_on

from lanewise.interop.highway_env import build_env, command_table, read_world
from lanewise.world import bicycle, idm, mobil, tick
from lanewise.world.settings import PAPER_DRIVER, DriverSettings
from lanewise.world.state import CONSTANT, EXTERNAL, RULE_BASED

step = jax.jit(tick.tick)


def both(world, ticks=1, frequency=10):
    """Vehicles after some ticks, ours and highway-env's."""
    env = build_env(world, simulation_frequency=frequency)
    for _ in range(ticks):
        world = step(world, 1 / frequency)
        env.road.act()
        env.road.step(1 / frequency)
    return world.vehicles, read_world(env).vehicles


def change(world, **values):
    values = {name: jnp.asarray(value) for name, value in values.items()}
    return replace(world, vehicles=replace(world.vehicles, **values))


def assert_equal(ours, theirs, names=("x", "y", "heading", "speed", "target_lane", "crashed")):
    for name in names:
        np.testing.assert_allclose(getattr(ours, name), getattr(theirs, name), 0, 1e-12, name)


def fires(timers):
    return [index for index in range(1, len(timers)) if timers[index] < timers[index - 1]]


@pytest.mark.parametrize("frequency", [10, 15])
@pytest.mark.parametrize("dtype", ["float32", "float64"])
def test_timer_in_float32_fires_on_the_ticks_of_highway_env(make_world, frequency, dtype):
    with jax.enable_x64(True):
        world = make_world([0, 100], [0, 0], timer=[0.1, 0.63], dtype=dtype)
        reference = build_env(make_world([0, 100], [0, 0], timer=[0.1, 0.63]))
    ours, theirs = [], []
    with jax.enable_x64(dtype == "float64"):
        for _ in range(25 * frequency):
            world = step(world, 1 / frequency)
            assert world.vehicles.timer.dtype == dtype
            ours.append(float(world.vehicles.timer[1]))
            reference.road.act()
            reference.road.step(1 / frequency)
            theirs.append(reference.road.vehicles[1].timer)
    assert fires(ours) == fires(theirs)
    assert np.diff(fires(ours)).tolist() == [frequency + 1] * (len(fires(ours)) - 1)


@pytest.mark.usefixtures("float64")
class TestQuirks:
    def test_strict_timer(self, make_world):
        for timer, fired in ((1.0, False), (np.nextafter(1.0, 2), True)):
            ours, theirs = both(make_world([0, 100], [0, 0], timer=[0.5, timer]))
            assert (ours.timer[1] < 1) == (theirs.timer[1] < 1) == fired

    @pytest.mark.parametrize(("known_speed", "target_lane"), [(0.0, 0), (12.5, 1)])
    def test_missing_target_speed(self, make_world, known_speed, target_lane):
        """A car wants to pass a slow one; an ego 200 m behind in the other lane keeps it back."""
        world = make_world([0, 200, 222], [1, 0, 0], [12.5, 12.5, 8.0], lanes=2, timer=[1, 2, 1],
                           kinds=[EXTERNAL, RULE_BASED, CONSTANT])  # fmt: skip
        target_speed = world.drivers.target_speed.at[0].set(known_speed)
        world = replace(world, drivers=replace(world.drivers, target_speed=target_speed))
        ours, theirs = both(world)
        assert int(ours.target_lane[1]) == int(theirs.target_lane[1]) == target_lane

    def test_cancelled_free_road_term(self, make_world):
        """The old rear vehicle is the ego: its 5e11 m/s^2 cancel, in float32 too."""
        world = make_world([0.0, 30.0, 52.0], [0, 0, 0], [12.5, 12.5, 8.0], timer=[0.5, 1.5, 0.5],
                           kinds=[EXTERNAL, RULE_BASED, CONSTANT])  # fmt: skip
        env = build_env(world)
        driver, ego, slow = env.road.vehicles[1], env.road.vehicles[0], env.road.vehicles[2]
        theirs = driver.acceleration(ego, slow) - driver.acceleration(ego, driver)
        assert abs(driver.acceleration(ego, slow)) > 1e11
        seen = look(world)
        own = neighbours_on(world, seen, seen.lane)
        ours = mobil._relief(world, seen, own.rear, own.front)[1]
        np.testing.assert_allclose(ours, theirs, atol=2e-4)
        single = jax.tree.map(lambda a: a.astype("float32") if a.dtype == "float64" else a, world)
        for each in (world, single):
            assert int(step(each, 0.1).vehicles.target_lane[1]) == 1

    def test_unfloored_desired_gap(self, make_world):
        ours, theirs = both(make_world([-50, 0, 20], [0, 0, 0], [10, 10, 39], kinds=[0, 2, 1]))
        assert_equal(ours, theirs)
        drivers = make_world([0], [0]).drivers
        assert float(idm.desired_gap(drivers, jnp.array([10.0]), jnp.array([-29.0]))[0]) < 0

    def test_right_overwrites_left(self, make_world):
        world = make_world([-90, 0, 25], [1, 1, 1], [5, 12, 5], timer=[1, 2, 1], kinds=[0, 2, 1])
        ours, theirs = both(world)
        assert int(ours.target_lane[1]) == int(theirs.target_lane[1]) == 2

    def test_no_change_below_walking_pace_but_the_timer_restarts(self, make_world):
        """Nothing but its speed keeps the driver in its lane."""
        for speed, changes in ((0.9, False), (1.1, True)):
            world = make_world(
                [-90, 0, 12], [1, 1, 1], [5, speed, 0], timer=[1, 2, 1], kinds=[0, 2, 1]
            )
            ours, theirs = both(world)
            assert int(ours.target_lane[1]) == int(theirs.target_lane[1])
            assert (int(ours.target_lane[1]) != 1) == changes
            assert float(ours.timer[1]) == theirs.timer[1] == 0.1

    def test_deciders_parameters_judge_the_others(self, make_world):
        """A jumpy driver's own time gap does not count; the decider's does."""
        jumpy = DriverSettings(time_gap=9.0, imposed_braking=0.0)
        world = make_world(
            [-200.0, 0.0, -22.0, 22.0], [0, 0, 1, 0], [12.0, 12.0, 12.0, 8.0], lanes=2,
            settings=[PAPER_DRIVER, PAPER_DRIVER, jumpy, PAPER_DRIVER],
            kinds=[0, 2, 2, 1], timer=[0.5, 1.5, 0.5, 0.5],
        )  # fmt: skip
        ours, theirs = both(world)
        assert int(ours.target_lane[1]) == int(theirs.target_lane[1]) == 1

    def test_smaller_of_two_lanes(self, make_world):
        world = make_world([-90, 0, 18, 60], [2, 0, 1, 0], [12, 12, 6, 12], kinds=[0, 2, 1, 1])
        world = change(world, target_lane=[2, 1, 1, 0])
        ours, theirs = both(world)
        assert_equal(ours, theirs, ("acceleration",))
        assert float(ours.acceleration[1]) == -1.0

    @pytest.mark.parametrize("order", [[1, 2, 3], [3, 2, 1], [2, 1, 3], [2, 3, 1]])
    def test_aborts_in_list_order(self, make_world, order):
        """Three cars in a column bound for one lane: who gives up depends on the list."""
        x = np.array([0.0, 12.0, 24.0])[np.array(order) - 1]
        world = make_world([-300.0, *x], [2, 0, 0, 0], y=[8.0, 0.0, 0.0, 0.0])
        world = change(world, target_lane=[2, 1, 1, 1])
        ours, theirs = both(world)
        np.testing.assert_array_equal(ours.target_lane, theirs.target_lane)
        assert 0 in ours.target_lane.tolist()[1:]
        assert 1 in ours.target_lane.tolist()[1:]

    def test_new_targets_of_earlier_vehicles_are_seen(self, make_world):
        """A change that starts in this tick aborts one of a later vehicle, not of an earlier."""
        seen = []
        for starter, changer in ((1, 2), (2, 1)):
            x, lane, target, timer = (
                np.full(4, -300.0),
                np.zeros(4, int),
                np.zeros(4, int),
                [0.5] * 4,
            )
            x[starter], x[changer], x[3] = 15.0, 0.0, 37.0
            target[changer], timer[starter] = 1, 1.5
            world = make_world(x, lane, [12, 12, 12, 8], lanes=2, kinds=[0, 2, 2, 1], timer=timer)
            ours, theirs = both(change(world, target_lane=target.astype(np.int32)))
            np.testing.assert_array_equal(ours.target_lane[1:3], theirs.target_lane[1:3])
            assert int(ours.target_lane[starter]) == 1
            seen.append(int(ours.target_lane[changer]))
        assert seen == [0, 1]

    def test_ties_between_neighbours(self, make_world):
        """Side by side counts as ahead for both; of equals ahead the last, behind the first."""
        world = make_world([-9, 50, 50, 20, 20, 20], [0] * 6, y=[0, 0, 1.5, -1.5, 0, 1.5],
                           speed=np.arange(1.0, 7.0))  # fmt: skip
        seen = look(world)
        own = neighbours_on(world, seen, seen.lane)
        assert float(own.front.velocity_x[4]) == 6.0
        assert float(own.front.velocity_x[3]) == 6.0
        assert float(own.front.velocity_x[5]) == 5.0
        assert float(own.rear.speed[1]) == 4.0
        assert_equal(*both(world))

    def test_a_changing_vehicle_is_on_two_lanes(self, make_world):
        for offset, found in ((3.0, True), (3.001, False)):
            world = make_world([0.0, 40.0], [1, 0], y=[4.0, 4.0 - offset])
            seen = look(world)
            own = neighbours_on(world, seen, seen.lane)
            assert bool(own.front.exists[0]) == found

    def test_target_speed_is_clipped_to_the_limit(self, make_world):
        world = make_world([-90, 0], [0, 0], 29, settings=DriverSettings(target_speed=50.0))
        ours, theirs = both(world)
        assert_equal(ours, theirs)
        np.testing.assert_allclose(ours.acceleration[1], 0.5 * (1 - (29 / 30) ** 4))

    def test_predicted_hit_moves_and_crashes_on_the_next_tick(self, make_world):
        world = make_world([0.0, 5.5], [0, 0], [25.0, 5.0], kinds=[0, 1], y=[0.0, 0.3])
        world = change(world, x=[-2.4, 5.5])
        for ticks, impacted, crashed in ((1, [True] * 2, [False] * 2), (2, None, [True] * 2)):
            ours, theirs = both(world, ticks)
            assert_equal(ours, theirs, ("x", "y", "speed", "crashed", "impacted", "impact_x"))
            assert impacted is None or ours.impacted.tolist() == impacted
            assert ours.crashed.tolist() == crashed

    def test_a_push_apart_is_a_crash_though_nothing_touches_any_more(self, make_world):
        """One pulls out of the way of the other, a little too late."""
        world = make_world(
            [0.0, 5.5], [0, 0], [25.0, 5.0], kinds=[0, 1], y=[0.0, 1.9], heading=[0.0, 0.1]
        )
        world = change(world, x=[-2.4, 5.5])
        for ticks, impacted, crashed in ((1, True, False), (2, False, True)):
            ours, theirs = both(world, ticks)
            assert_equal(ours, theirs, ("x", "y", "speed", "crashed", "impacted"))
            assert ours.impacted.tolist() == [impacted] * 2
            assert ours.crashed.tolist() == [crashed] * 2

    def test_last_impact_wins(self, make_world):
        world = make_world([0.0, 6.4, -6.4], [0, 0, 0], [25, 2, 39], kinds=[0, 1, 1])
        world = change(world, x=[-2.5, 6.4 - 0.2, -6.2 - 3.9])
        ours, theirs = both(world)
        assert ours.impacted.tolist() == theirs.impacted.tolist() == [True] * 3
        np.testing.assert_allclose(ours.impact_x, theirs.impact_x, atol=1e-12)
        assert float(ours.impact_x[0]) > 0

    def test_clipped_command_persists(self, make_world):
        world = make_world([0.0, 500.0], [0, 0], [39.95, 5.0], kinds=[0, 1])
        world = bicycle.command(world, 1.0, 0.0)
        ours, theirs = both(world, 10)
        assert_equal(ours, theirs, ("speed", "acceleration"))
        assert float(ours.speed[0]) > 40
        assert float(ours.acceleration[0]) < 0

    def test_crashed_vehicles_neither_steer_nor_decide(self, make_world):
        world = make_world([0, 90], [0, 0], [20, 10], heading=[0.1, 0.1], timer=[1, 3])
        world = change(bicycle.command(world, 1.0, 0.3), crashed=[True, True], target_lane=[0, 1])
        ours, theirs = both(world, 3)
        assert_equal(ours, theirs)
        np.testing.assert_allclose(ours.speed[0], 20 * 0.9**3)
        np.testing.assert_allclose(ours.heading, 0.1)
        np.testing.assert_allclose(ours.timer[1], 3.3)

    def test_a_crashed_driver_keeps_a_lane_that_it_would_leave(self, make_world):
        world = make_world([-90, 0, 14], [1, 1, 1], [5, 8, 2], timer=[1, 2, 1], kinds=[0, 2, 1])
        for crashed in (False, True):
            ours, theirs = both(change(world, crashed=[False, crashed, False]))
            assert_equal(ours, theirs, ("x", "y", "speed", "target_lane"))
            assert float(ours.timer[1]) == theirs.timer[1]
            assert (int(ours.target_lane[1]) == 1) == crashed

    def test_absent_vehicles_influence_nothing(self, make_world):
        x, lane = [0.0, 15.0, 31.0], [0, 0, 1]
        alone = step(make_world(x, lane, maximum=None), 0.1).vehicles
        world = make_world(x, lane, maximum=5)
        world = change(world, x=[*x, 16.0, 1.0], speed=[12.5] * 3 + [3.0, 3.0])
        padded = step(world, 0.1).vehicles
        for name, value in vars(alone).items():
            np.testing.assert_array_equal(value, getattr(padded, name)[:3], name)
        assert padded.x[3:].tolist() == [16.0, 1.0]

    def test_float32_actions(self, make_world):
        table = command_table(build_env(make_world([0, 90], [0, 0])))
        assert table[2, 1] != np.pi / 50
        np.testing.assert_allclose(table[2, 1], np.pi / 50, rtol=1e-7)

    def test_constructor_zeros(self, make_world):
        """A timer or target speed of zero survives the way to highway-env and back."""
        world = change(make_world([0, 90], [0, 0]), timer=[0.5, 0.0])
        zero = world.drivers.target_speed.at[1].set(0.0)
        world = replace(world, drivers=replace(world.drivers, target_speed=zero))
        again = read_world(build_env(world))
        assert again.vehicles.timer[1] == again.drivers.target_speed[1] == 0
