"""Starts drawn over ranges, and starts with given numbers in a padded world."""

from dataclasses import replace
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from lanewise.driving import episode, percept
from lanewise.driving.settings import DrivingSettings
from lanewise.scenario import trap
from lanewise.scenario.settings import TrafficSettings, TrapSettings

SETTINGS = TrapSettings()
WIDE = replace(
    SETTINGS,
    training_ego_speed=(8.0, 13.0),
    training_trap_speed=(8.0, 11.0),
    training_lanes=(3, 5),
    missing_target_speed=False,
)
DRIVING = DrivingSettings()
COUNT = 2000


@partial(jax.jit, static_argnums=(0, 1, 2))
def starts(settings, split, count=COUNT, seed=7):
    return jax.vmap(lambda i: trap.sample(settings, trap.start_key(seed, split, i), split))(
        jnp.arange(count)
    )


def same(a, b):
    return all(
        np.array_equal(x, y) for x, y in zip(jax.tree.leaves(a), jax.tree.leaves(b), strict=True)
    )


@pytest.mark.parametrize("split", ["training", "validation"])
def test_speeds_fill_their_ranges_each_on_its_own(split):
    world = starts(WIDE, split)
    speed, x = np.asarray(world.vehicles.speed), np.asarray(world.vehicles.x)
    for drawn, (low, high) in ((speed[:, 0], (8.0, 13.0)), (speed[:, 1], (8.0, 11.0))):
        assert low <= drawn.min() < low + 0.01 * (high - low)
        assert high >= drawn.max() > high - 0.01 * (high - low)
        assert drawn.mean() == pytest.approx((low + high) / 2, abs=0.03 * (high - low))
    np.testing.assert_array_equal(speed[:, 1], speed[:, 2])
    assert (speed[:, 3:] == 12.5).all()
    np.testing.assert_array_equal(world.drivers.target_speed[:, :3], speed[:, :3])
    lanes = np.asarray(world.road.present).sum(axis=1)
    numbers = np.stack([speed[:, 0], speed[:, 1], x[:, 1], x[:, 2], lanes])
    assert np.abs(np.corrcoef(numbers) - np.eye(5)).max() < 0.08


def test_every_number_of_lanes_is_drawn_and_traffic_keeps_to_them():
    world = starts(WIDE, "training")
    lanes = np.asarray(world.road.present).sum(axis=1)
    assert world.road.present.shape[1] == 5 == trap.lanes_max(WIDE, "training")
    shares = np.bincount(lanes, minlength=6)[3:] / COUNT
    np.testing.assert_allclose(shares, 1 / 3, atol=0.04)
    present = np.asarray(world.road.present)
    assert (present[:, :-1] >= present[:, 1:]).all()
    lane = np.asarray(world.vehicles.target_lane)[:, 3:]
    for count in (3, 4, 5):
        assert set(lane[lanes == count].ravel()) == set(range(count))


def test_a_range_changes_nothing_else():
    """Traffic, D1 and D2 come from key streams that the new draws do not touch."""
    plain = starts(replace(SETTINGS, missing_target_speed=False), "training", 200)
    wide = starts(replace(WIDE, training_lanes=()), "training", 200)
    for name in ("x", "y", "target_lane", "timer"):
        np.testing.assert_array_equal(getattr(plain.vehicles, name), getattr(wide.vehicles, name))
    assert (np.asarray(plain.vehicles.speed[:, :3]) == 10.0).all()


def test_a_range_changes_no_test_start():
    assert same(
        starts(replace(SETTINGS, missing_target_speed=False), "test", 200),
        starts(WIDE, "test", 200),
    )


def test_without_a_range_training_follows_the_test_speeds():
    world = starts(replace(SETTINGS, ego_speed=12.0, trap_speed=9.0, lanes=4), "training", 20)
    np.testing.assert_array_equal(world.vehicles.speed[:, :3], [[12.0, 9.0, 9.0]] * 20)
    assert world.road.present.shape == (20, 4)


def numbers(**changes):
    plain = trap.Start(
        lanes=3,
        ego_speed=11.0,
        trap_speed=9.0,
        front_distance=15.0,
        side_distance=5.0,
        spacing=17.0,
        vehicles_ahead=9,
        vehicles_behind=3,
    )
    return replace(plain, **changes)


BUSY = replace(SETTINGS, lanes=5, traffic=TrafficSettings(vehicles_behind=3))
PLACE = jax.jit(trap.place, static_argnums=(0, 3))


@partial(jax.jit, static_argnums=(0, 3))
def drive(settings, start, seed, lanes, chosen):
    """Worlds and features along an episode of given actions."""
    key = trap.start_key(seed, "test", 0)
    state = episode.begin(trap.place(settings, start, key, lanes))

    def decide(state, action):
        seen = percept.perceive(DRIVING.observation, state.world)
        state = episode.step(DRIVING, state, action, 50)
        return state, (state.world.vehicles, seen.features, state.outcome)

    return state.world, jax.lax.scan(decide, state, chosen)[1]


@pytest.mark.parametrize("seed", range(4))
def test_absent_lanes_change_nothing_to_the_last_bit(seed):
    """Three lanes of five driven beside a world that has but three: traffic changes lanes, the
    ego wanders, and vehicles, features, rewards and endings are the same bits."""
    chosen = jax.random.randint(jax.random.key(seed), (50,), 0, 9)
    # The speed at which the trap drives lets traffic from behind catch up and change lanes.
    start = numbers(trap_speed=6.0, ego_speed=8.0)
    padded, along = drive(BUSY, start, seed, 5, chosen)
    plain, theirs = drive(BUSY, start, seed, 3, chosen)
    assert padded.road.present.tolist() == [True, True, True, False, False]
    assert plain.road.present.tolist() == [True, True, True]
    assert same(padded.vehicles, plain.vehicles)
    assert same(along, theirs)
    lane = np.asarray(along[0].target_lane)
    assert (lane[0] != lane[-1]).any()
    assert lane.max() == 2


@pytest.mark.slow
def test_absent_traffic_is_not_there():
    """Fewer vehicles than the arrays hold: absent ones neither move, nor are seen, nor matter."""
    chosen = jnp.full(50, 4)
    start = numbers(vehicles_ahead=0, vehicles_behind=0, ego_speed=9.0, trap_speed=9.0)
    empty, along = drive(BUSY, start, 0, 3, chosen)
    small = replace(SETTINGS, traffic=TrafficSettings(vehicles_ahead=0))
    alone, theirs = drive(small, start, 0, 3, chosen)
    assert np.asarray(empty.vehicles.present).sum() == 3
    np.testing.assert_array_equal(along[1], theirs[1])
    np.testing.assert_array_equal(along[0].x[:, :3], theirs[0].x)
    np.testing.assert_array_equal(empty.road.start, alone.road.start)


def test_as_much_traffic_as_the_start_has():
    start = numbers(vehicles_ahead=2, vehicles_behind=1)
    world = PLACE(BUSY, start, trap.start_key(0, "test", 0), 5)
    assert world.vehicles.present.tolist() == [True] * 5 + [False] * 7 + [True, False, False]


def test_sample_places_what_it_draws():
    key = trap.start_key(3, "training", 11)
    start = trap.draw(WIDE, key, "training")
    assert same(
        trap.place(WIDE, start, key, trap.lanes_max(WIDE, "training")),
        trap.sample(WIDE, key, "training"),
    )


def test_given_numbers_are_where_they_belong():
    world = PLACE(BUSY, numbers(lanes=4), trap.start_key(1, "test", 0), 5)
    x = np.asarray(world.vehicles.x)
    np.testing.assert_allclose(x[:3], [0.0, 15.0, 5.0])
    assert world.vehicles.speed[:3].tolist() == [11.0, 9.0, 9.0]
    assert world.road.present.tolist() == [True] * 4 + [False]
    # The first gap is 45 m whatever the spacing, then one every 17 m; jitter 5 m.
    assert abs(x[3] - 15.0 - 45.0) <= 5.0
    assert (np.abs(np.diff(x[3:12]) - 17.0) <= 5.0).all()
    assert abs(x[12] + 45.0) <= 5.0
    assert (np.abs(np.diff(x[12:]) + 17.0) <= 5.0).all()
    assert (np.asarray(world.road.start) <= x.min()).all()
