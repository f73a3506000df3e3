"""Starts drawn over ranges, in each split, and starts with given numbers in a padded world."""

from dataclasses import replace
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from lanewise import config
from lanewise.driving import episode, percept
from lanewise.driving.settings import DrivingSettings
from lanewise.evaluation import evaluator
from lanewise.evaluation.evaluator import EvaluationConfig
from lanewise.scenario import trap
from lanewise.scenario.settings import TrafficSettings, TrapSettings
from lanewise.world import build, road
from lanewise.world.settings import FARTHEST, PAPER_DRIVER, TOP_SPEED
from lanewise.world.state import CONSTANT, EXTERNAL, RULE_BASED, World

DRIVING = DrivingSettings()
PLAIN = TrapSettings(
    lanes=4,
    lane_width=3.5,
    speed_limit=25.0,
    ego_speed=11.0,
    trap_speed=9.0,
    test_front_distance=20.0,
    test_side_distance=-3.0,
    missing_target_speed=False,
    traffic=TrafficSettings(vehicles_ahead=4, vehicles_behind=3),
)
WIDE = replace(
    PLAIN,
    training_ego_speed=(8.0, 13.0),
    training_trap_speed=(8.0, 11.0),
    training_lanes=(3, 5),
    training_front_distance=(14.8, 16.44),
    training_side_distance=(4.06, 7.43),
)
RANGES = ((8.0, 13.0), (8.0, 11.0), (14.8, 16.44), (4.06, 7.43))
"""Of the speeds of ego and trap, D1 and D2."""
COUNT, SEED = 2000, 7


@partial(jax.jit, static_argnums=(0, 1))
def starts(settings, split):
    return jax.vmap(lambda i: trap.sample(settings, trap.start_key(SEED, split, i), split))(
        jnp.arange(COUNT)
    )


@pytest.fixture(scope="module")
def training():
    return jax.device_get(starts(WIDE, "training"))


@pytest.fixture(scope="module")
def test():
    return jax.device_get(starts(WIDE, "test"))


def same(a, b):
    return all(
        np.array_equal(x, y) for x, y in zip(jax.tree.leaves(a), jax.tree.leaves(b), strict=True)
    )


def lanes_of(world):
    return np.asarray(world.road.present).sum(axis=-1)


def test_a_start_is_the_same_in_batches_of_any_size(training):
    config = EvaluationConfig(WIDE, DRIVING, None, 50, "training")
    for index in (0, 1, 101):
        own = evaluator.start(config, SEED, index)
        assert same(own, jax.tree.map(lambda leaf: leaf[index], training))  # noqa: B023


def test_indices_seeds_and_splits_differ():
    starts = [(0, split, index) for split in trap.SPLITS for index in (0, 1)] + [(1, "test", 0)]
    keys = {tuple(np.asarray(jax.random.key_data(trap.start_key(*at)))) for at in starts}
    assert len(keys) == 7


@pytest.mark.parametrize("split", ["training", "validation"])
def test_numbers_fill_their_ranges_each_on_its_own(split, training):
    """Uniform: 2000 draws come near both ends, and the mean is the middle."""
    world = training if split == "training" else jax.device_get(starts(WIDE, split))
    speed, x, y = world.vehicles.speed, world.vehicles.x, world.vehicles.y
    assert (x[:, 0] == 0).all()
    numbers = np.stack([speed[:, 0], speed[:, 1], x[:, 1], x[:, 2], lanes_of(world)])
    for drawn, (low, high) in zip(numbers, RANGES, strict=False):
        near = 0.01 * (high - low)
        assert low - 1e-5 <= drawn.min() < low + near
        assert high + 1e-5 >= drawn.max() > high - near
        assert drawn.mean() == pytest.approx((low + high) / 2, abs=3 * near)
    assert np.abs(np.corrcoef(numbers) - np.eye(5)).max() < 0.08
    np.testing.assert_array_equal(speed[:, 1], speed[:, 2])
    assert (speed[:, 3:] == 12.5).all()
    np.testing.assert_array_equal(world.drivers.target_speed[:, :3], speed[:, :3])
    assert (world.drivers.target_speed[:, 3:] == 12.5).all()
    np.testing.assert_allclose(y, 3.5 * world.vehicles.target_lane)


def test_every_number_of_lanes_is_drawn_and_traffic_keeps_to_them(training):
    lanes, present = lanes_of(training), training.road.present
    assert present.shape[1] == 5 == trap.of_split(WIDE, "training").lanes
    shares = np.bincount(lanes, minlength=6)[3:] / COUNT
    np.testing.assert_allclose(shares, 1 / 3, atol=0.04)
    assert (present[:, :-1] >= present[:, 1:]).all()
    lane = training.vehicles.target_lane[:, 3:]
    for count in (3, 4, 5):
        assert set(lane[lanes == count].ravel()) == set(range(count))


def test_traffic_spacing_lies_in_its_range(training):
    """Ahead of the trap and behind the ego: a first gap of 45 m, then of 25 m, each to 5 m."""
    x = training.vehicles.x
    ahead = np.diff(x[:, 3:7], axis=1, prepend=x[:, 1:3].max(axis=1)[:, None])
    behind = -np.diff(x[:, 7:], axis=1, prepend=0.0)
    for gaps in (ahead, behind):
        for gap, mean in zip(gaps.T, (45.0, 25.0, 25.0, 25.0), strict=False):
            assert (np.abs(gap - mean) <= 5.0 + 1e-3).all()
            assert gap.max() - mean > 4.5
            assert mean - gap.min() > 4.5
    correlation = np.corrcoef(np.hstack([ahead, behind]), rowvar=False)
    assert np.abs(correlation - np.eye(7)).max() < 0.1


def test_a_range_changes_nothing_else(training):
    """Traffic, D1 and D2 come from key streams that the new draws do not touch."""
    plain, kept = jax.device_get(starts(PLAIN, "training")), lanes_of(training) == PLAIN.lanes
    assert plain.road.present.shape == (COUNT, 4)
    np.testing.assert_array_equal(plain.vehicles.speed[:, :3], [[11.0, 9.0, 9.0]] * COUNT)
    other = ~np.isin(np.arange(10), [1, 2])
    for name in ("x", "y", "target_lane", "timer"):
        ours, theirs = getattr(training.vehicles, name)[kept], getattr(plain.vehicles, name)[kept]
        np.testing.assert_array_equal(ours[:, other], theirs[:, other])


def test_tests_start_as_set(test):
    np.testing.assert_allclose(test.vehicles.x[:, :3], [[0.0, 20.0, -3.0]] * COUNT)
    np.testing.assert_allclose(test.vehicles.y[:, :3], [[0.0, 0.0, 3.5]] * COUNT)
    np.testing.assert_array_equal(test.vehicles.speed[:, :3], [[11.0, 9.0, 9.0]] * COUNT)
    np.testing.assert_allclose(test.road.centre, [[0.0, 3.5, 7.0, 10.5]] * COUNT)
    assert (test.road.speed_limit == 25.0).all()
    assert test.drivers.kind[0].tolist() == [EXTERNAL, CONSTANT, CONSTANT] + [RULE_BASED] * 7
    one = jax.tree.map(lambda leaf: leaf[0], test)
    assert trap.roles(one).tolist() == [0, 1, 1] + [2] * 7
    assert test.vehicles.x.shape[1] == 10


def test_linear_traffic():
    """All traffic has the model of its setting, the trap cars never."""
    settings = config.compose(flags={"scenario.traffic.driver.model": "linear"}).scenario
    world = trap.sample(settings, jax.random.key(0), "test")
    kind = np.asarray(world.drivers.kind)
    assert world.drivers.linear.applies.tolist() == (kind == RULE_BASED).tolist()
    assert trap.sample(TrapSettings(), jax.random.key(0), "test").drivers.linear is None


ESCAPED = jax.jit(trap.escaped)


@pytest.mark.parametrize("others", [1, 4])
def test_the_ego_must_get_past_as_many_trap_cars_as_there_are(others):
    kinds = [EXTERNAL] + [CONSTANT] * others + [RULE_BASED] * (6 - others)
    x = np.r_[100.0, 90.0 - 10.0 * np.arange(others), np.full(6 - others, 200.0)]
    world = World(
        road=road.straight_road(3),
        drivers=build.make_drivers([PAPER_DRIVER] * 7, kinds),
        vehicles=build.make_vehicles(x, 0.0 * x, 0.0 * x, np.zeros(7, np.int32)),
    )
    assert trap.roles(world).tolist() == [0] + [1] * others + [2] * (6 - others)
    assert ESCAPED(world)
    for car in range(1, others + 1):
        ahead = world.vehicles.x.at[car].set(120.0)
        there = replace(world, vehicles=replace(world.vehicles, x=ahead))
        assert not ESCAPED(there)
        absent = there.vehicles.present.at[car].set(False)
        assert ESCAPED(replace(there, vehicles=replace(there.vehicles, present=absent)))


def test_everybody_is_on_the_road_as_far_as_a_drive_can_go():
    """100 vehicles 205 m apart, and 1600 s at the top speed, as long as an episode may last."""
    farthest = 45.0 + 100 * 205.0 + TOP_SPEED * 1600.0
    assert farthest + road.END_MARGIN < FARTHEST
    ours = road.straight_road(3)
    assert (ours.start == -FARTHEST).all()
    assert (ours.end == FARTHEST).all()


BUSY = TrapSettings(lanes=5, traffic=TrafficSettings(vehicles_ahead=1, vehicles_behind=2))
NUMBERS = trap.Start.of(
    replace(BUSY, lanes=3), ego_speed=11.0, trap_speed=9.0, front_distance=15.0, side_distance=5.0,
    spacing=17.0,
)  # fmt: skip
PLACE = jax.jit(trap.place, static_argnums=0)


def test_given_numbers_are_where_they_belong():
    world = PLACE(BUSY, replace(NUMBERS, lanes=4), trap.start_key(1, "test", 0))
    x = np.asarray(world.vehicles.x)
    np.testing.assert_allclose(x[:3], [0.0, 15.0, 5.0])
    assert world.vehicles.speed[:3].tolist() == [11.0, 9.0, 9.0]
    # Plain vehicles seem to want to stop.
    assert world.drivers.target_speed.tolist() == [0.0] * 3 + [12.5] * 3
    assert world.road.present.tolist() == [True] * 4 + [False]
    # The first gap is 45 m whatever the spacing, then one every 17 m; jitter 5 m.
    gaps = [x[3] - 15.0, -x[4], x[4] - x[5]]
    assert (np.abs(np.array(gaps) - [45, 45, 17]) <= 5.0).all()


def test_as_much_traffic_as_the_start_has():
    start = replace(NUMBERS, vehicles_ahead=0, vehicles_behind=1)
    world = PLACE(BUSY, start, trap.start_key(0, "test", 0))
    assert world.vehicles.present.tolist() == [True] * 3 + [False] + [True, False]


@partial(jax.jit, static_argnums=0)
def drive(settings, start, seed, chosen):
    """Worlds and features along an episode of given actions."""
    key = trap.start_key(seed, "test", 0)
    state = episode.begin(trap.place(settings, start, key))

    def decide(state, action):
        seen = percept.perceive(DRIVING.observation, state.world)
        state = episode.step(DRIVING, state, action, 50)
        return state, (state.world.vehicles, seen.features, state.outcome)

    return state.world, jax.lax.scan(decide, state, chosen)[1]


@pytest.mark.parametrize("seed", range(1, 4))
def test_absent_lanes_change_nothing_to_the_last_bit(seed):
    """Three lanes of five driven beside a world that has but three: traffic changes lanes, the
    ego wanders, and vehicles, features, rewards and endings are the same bits."""
    chosen = np.random.default_rng(seed).integers(0, 9, 50)
    # The speed at which the trap drives lets traffic from behind catch up and change lanes.
    start = replace(NUMBERS, trap_speed=6.0, ego_speed=8.0)
    padded, along = drive(BUSY, start, seed, chosen)
    plain, theirs = drive(replace(BUSY, lanes=3), start, seed, chosen)
    assert padded.road.present.tolist() == [True, True, True, False, False]
    assert plain.road.present.tolist() == [True, True, True]
    assert same(padded.vehicles, plain.vehicles)
    assert same(along, theirs)
    lane = np.asarray(along[0].target_lane)
    assert (lane[0] != lane[-1]).any()
    assert lane.max() == 2


ALL = replace(
    PLAIN,
    training_trap_speed_difference=(0.0, 2.0),
    training_traffic_speed=(11.0, 15.0),
    training_spacing=(15.0, 40.0),
    training_vehicles_ahead=(0, 6),
    training_vehicles_behind=(0, 4),
    training_gap_behind=(20.0, 60.0),
)


def test_traffic_and_the_second_trap_car_fill_their_ranges_in_training_alone():
    world = jax.device_get(starts(ALL, "training"))
    vehicles = world.vehicles
    assert vehicles.x.shape == (COUNT, 3 + 6 + 4)
    ahead, behind = vehicles.present[:, 3:9].sum(axis=1), vehicles.present[:, 9:].sum(axis=1)
    for counts, most in ((ahead, 6), (behind, 4)):
        np.testing.assert_allclose(np.bincount(counts) / COUNT, 1 / (most + 1), atol=0.03)
    x, speed = vehicles.x, vehicles.speed
    # The jitter of 5 m is around the mean.
    drawn = {
        (0.0, 2.0): speed[:, 2] - speed[:, 1],
        (11.0, 15.0): speed[:, 3],
        (15.0, 40.0): np.diff(x[:, 3:9]).mean(axis=1),
        (20.0, 60.0): -x[:, 9],
    }
    for (low, high), values in drawn.items():
        assert values.mean() == pytest.approx((low + high) / 2, abs=0.02 * (high - low))
        assert values.min() >= low - 5.0
        assert values.max() <= high + 5.0
        assert values.std() == pytest.approx((high - low) / np.sqrt(12), rel=0.15)
    assert (world.drivers.target_speed[:, 3:] == 12.5).all()
    fast = replace(ALL, training_ego_speed=(8.0, 13.0), training_braking=0.5)
    braked = jax.device_get(starts(fast, "training")).vehicles
    free = jax.device_get(starts(replace(fast, training_braking=0.0), "training")).vehicles
    # v^2 - u^2 = 2 b s: so fast that it comes 1 m close, or as drawn.
    limit = 9.0 + np.sqrt(2 * 0.5 * (braked.x[:, 1] - 6.0))
    np.testing.assert_allclose(braked.speed[:, 0], np.minimum(free.speed[:, 0], limit), rtol=1e-5)
    assert 0.1 < (braked.speed[:, 0] < free.speed[:, 0]).mean() < 0.9
    test = jax.device_get(starts(ALL, "test"))
    assert test.vehicles.x.shape == (COUNT, 10)
    assert (test.vehicles.speed[:, 3:] == 12.5).all()
