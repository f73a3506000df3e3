"""Where highway-env breaks a law itself: an example in highway-env and in our world.

By the name of the quirk in docs/numerics.md.
"""

import numpy as np
import pytest
from highway_env.road.road import Road, RoadNetwork
from highway_env.vehicle.behavior import IDMVehicle
from law_worlds import SIZE, after, change, fit, mirrored, mirrored_vehicles, reordered, taken

from lanewise.interop.highway_env import build_env, read_world
from lanewise.world.state import CONSTANT, RULE_BASED

pytestmark = pytest.mark.usefixtures("float64")


def both(world):
    """Vehicles a tick later, in our world and in highway-env."""
    count = len(world.vehicles.x)
    env = build_env(world)
    env.road.act()
    env.road.step(0.1)
    return taken(after(fit(world, SIZE)), slice(count)), read_world(env).vehicles


def mirror_both(world):
    """As `both`, of the mirrored world, mirrored back."""
    lanes = len(world.road.present)
    return [mirrored_vehicles(vehicles, lanes) for vehicles in both(mirrored(world))]


def reorder_both(world, order):
    """As `both`, of the world in another order, brought back."""
    order = np.array(order)
    return [taken(vehicles, order.argsort()) for vehicles in both(reordered(world, order))]


def assert_broken(world, copy, name, vehicle):
    """Both worlds break the law in the same way: `name` of a vehicle differs after a tick."""
    for ours, theirs in (world, copy):
        np.testing.assert_allclose(getattr(ours, name), getattr(theirs, name), atol=1e-12)
    for mine, its in zip(world, copy, strict=True):
        before, other = (float(getattr(vehicles, name)[vehicle]) for vehicles in (mine, its))
        assert abs(before - other) > 1e-3


@pytest.mark.parametrize(
    ("vehicles", "name", "vehicle"),
    [
        pytest.param(
            {"x": [-90, 0, 25], "lane": [1, 1, 1], "speed": [5, 12, 5], "timer": [1, 2, 1],
             "kinds": [0, 2, 1]},
            "target_lane", 1, id="right-overwrites-left",
        ),
        # Exactly between two lanes is in the left one: its driver follows another leader.
        pytest.param(
            {"x": [-90, 0, 18], "lane": [2, 0, 1], "speed": [5, 12, 2], "y": [8, 2, 5.5],
             "kinds": [0, 2, 1]},
            "acceleration", 1, id="ties-between-lanes",
        ),
        # Level with one another, the earlier one is pushed to the left, whichever way that is.
        pytest.param(
            {"x": [0, 1], "lane": [1, 1], "speed": [5, 5], "kinds": [0, 1]},
            "impact_y", 0, id="push-of-equals",
        ),
    ],
)  # fmt: skip
def test_breaks_of_the_mirror(make_world, vehicles, name, vehicle):
    world = make_world(**vehicles)
    assert_broken(both(world), mirror_both(world), name, vehicle)


@pytest.mark.parametrize(
    ("vehicles", "target", "order", "name", "vehicle"),
    [
        pytest.param(
            {"x": [-90, 0, 30, 30], "lane": [2, 0, 0, 0], "speed": [5, 12, 2, 11],
             "y": [8, 0, -1, 1], "kinds": [0, 2, 1, 1]},
            None, [0, 1, 3, 2], "acceleration", 1, id="ties-between-neighbours",
        ),
        pytest.param(
            {"x": [-300.0, 0, 20, 40], "lane": [2, 0, 0, 0]},
            [2, 1, 1, 1], [0, 3, 2, 1], "target_lane", 1, id="decisions-in-list-order",
        ),
        # The fast one reaches the slow one ahead; if that comes first in the list, it does not.
        pytest.param(
            {"x": [-300, 0, 11.0], "lane": [0, 0, 0], "speed": [5, 35, 0], "kinds": [0, 1, 1]},
            None, [0, 2, 1], "impacted", 1, id="lower-index-reach",
        ),
        pytest.param(
            {"x": [-2.5, 6.2, -10.1], "lane": [0, 0, 0], "speed": [25, 2, 39],
             "kinds": [0, 1, 1]},
            None, [0, 2, 1], "impact_x", 0, id="last-impact-wins",
        ),
        pytest.param(
            {"x": [-300, 0, 1], "lane": [0, 1, 1], "speed": [5, 5, 5], "kinds": [0, 1, 1]},
            None, [0, 2, 1], "impact_y", 1, id="push-of-equals",
        ),
    ],
)  # fmt: skip
def test_breaks_of_the_order(make_world, vehicles, target, order, name, vehicle):
    world = make_world(**vehicles)
    if target:
        world = change(world, target_lane=target)
    assert_broken(both(world), reorder_both(world, order), name, vehicle)


@pytest.mark.parametrize("distance", [200.0, 5000.0])
@pytest.mark.parametrize(
    ("kind", "speed"), [(CONSTANT, 12.5), (RULE_BASED, 25.0)],
    ids=["missing-target-speed", "speeding-car-behind"],
)  # fmt: skip
def test_a_car_behind_matters_at_any_distance(make_world, distance, kind, speed):
    """A driver would pass a slow car; a plain or speeding one behind keeps it back.

    One that is rule-based and not above its target speed does not.
    """
    x = np.array([6000.0, 6000, 6022, 6000 - distance])
    for behind, passes in (((kind, speed), False), ((RULE_BASED, 12.0), True)):
        world = make_world(x, [2, 0, 0, 1], [12.5, 12.5, 8.0, behind[1]], timer=[1, 2, 1, 1],
                           kinds=[0, 2, 1, behind[0]])  # fmt: skip
        for vehicles in both(world):
            assert vehicles.target_lane[1] == (1 if passes else 0)


def test_drivers_may_reverse(make_world):
    """Nearer than the jam distance to a standing car the IDM drives backwards."""
    world = make_world([-90, 0, 7], [0, 0, 0], [5, 0, 0], kinds=[0, 2, 1])
    for vehicles in both(world):
        assert vehicles.speed[1] < -0.01


def test_timer_from_place():
    """A timer begins by x and y: the same traffic elsewhere changes lanes at other times."""
    road = Road(RoadNetwork.straight_road_network(2), [])
    first, second = (IDMVehicle(road, [x, 0.0]).timer for x in (100.0, 101.0))
    assert abs(first - second) > 0.1


def test_absolute_ego_place(make_world):
    """The ego's x is over 200 m and cut at 1, its y counts from the leftmost lane."""
    observed = []
    for x, lane in ((50, 0), (250, 0), (450, 0), (50, 2)):
        env = build_env(make_world([x, x + 20], [lane, lane]))
        observed.append(env.observation_type.observe()[0, 1:3].tolist())
    np.testing.assert_allclose(observed, [[0.25, 0], [1, 0], [1, 0], [0.25, 8 / 12]], atol=1e-6)
