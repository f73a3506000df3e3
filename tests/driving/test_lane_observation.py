import jax
import numpy as np
import pytest

from lanewise.driving import lane_observation as lanes
from lanewise.driving.observation import features, surroundings
from lanewise.driving.settings import ObservationSettings
from lanewise.interop.highway_env import build_env
from small_worlds import make_world, scattered

IN_JAX = jax.jit(features, static_argnums=0)
LANES = ObservationSettings(variant="lanes")
NAMES = [feature.name for feature in lanes.FEATURES]


def observed(world):
    """The features by name, in their units, of NumPy; those of JAX are the same."""
    found = lanes.observe(np, surroundings(world))
    assert found.shape == (LANES.size,)
    np.testing.assert_allclose(IN_JAX(LANES, world), found, atol=1e-5)
    divisors = [feature.divisor for feature in lanes.FEATURES]
    return dict(zip(NAMES, found * divisors, strict=True))


@pytest.mark.parametrize("count", [2, 8])
def test_neighbours_are_those_of_highway_env_on_random_worlds(count):
    rng, found = np.random.default_rng(count), 0
    for _ in range(20):
        world = scattered(rng, count)
        seen, env = observed(world), build_env(world)
        ego, own = env.vehicle, round(float(np.clip(world.vehicles.y[0] / 4.0, 0, 2)))
        for side, step in lanes.SIDES:
            assert seen[f"{side}: exists"] == (0 <= own + step <= 2)
            if not 0 <= own + step <= 2:
                assert not any(seen[name] for name in NAMES if name.startswith(side))
                continue
            there = env.road.neighbour_vehicles(ego, ("0", "1", own + step))
            for place, other in zip(("ahead", "behind"), there, strict=True):
                got = [seen[f"{side}: {place}: {each.name}"] for each in lanes.NEIGHBOUR]
                if other is None or abs(other.position[0] - ego.position[0]) - 5.0 > lanes.RANGE:
                    assert got == [lanes.LIMIT * 40.0, 0.0, 0.0, 0.0]
                    continue
                found += 1
                gap = abs(other.position[0] - ego.position[0]) - 5.0
                offset = other.position[1] - 4.0 * (own + step)
                relative, across = other.velocity[0] - ego.velocity[0], other.velocity[1]
                np.testing.assert_allclose(got, [gap, relative, offset, across], atol=1e-5)
        env.close()
    assert found > 5 * count


def test_the_ego_is_observed_relative_to_its_lane():
    world = make_world([1000.0], [1], 12.0, y=[4.6], heading=0.05, size=8)
    seen = observed(world)
    wanted = {"speed": 12.0, "lateral speed": 12.0 * np.sin(0.05), "lane offset": 0.6}
    for name, value in (wanted | {"lanes left": 1.0, "lanes right": 1.0}).items():
        assert seen[name] == pytest.approx(value, abs=1e-5)


def test_where_it_is_along_the_road_is_not_observed():
    world = scattered(np.random.default_rng(3), 8)
    seen = surroundings(world)
    moved = lanes.observe(np, seen._replace(x=seen.x + 5000.0))
    np.testing.assert_allclose(moved, lanes.observe(np, seen), atol=1e-9)


def test_somebody_alongside_has_a_negative_gap_and_is_ahead_if_level():
    world = make_world([0.0, 2.0, 0.0], [1, 2, 0], 10.0, kinds=[0, 1, 1], size=8)
    seen = observed(world)
    assert seen["right: ahead: gap"] == pytest.approx(-3.0)
    assert seen["left: ahead: gap"] == pytest.approx(-5.0)
    assert seen["own: ahead: gap"] == lanes.LIMIT * 40.0
