"""Where highway-env breaks laws of docs/numerics.md, and our world with it."""

from dataclasses import replace

import numpy as np
import pytest
from test_quirks import assert_equal, targets

from lanewise.world.settings import LINEAR_DRIVER, PAPER_DRIVER
from lanewise.world.state import CONSTANT, RULE_BASED
from small_worlds import both, change, make_world, mirrored, mirrored_vehicles, reordered, taken


def assert_broken(world, copy, name, vehicle):
    """Both worlds break the law in the same way: `name` of a vehicle differs after a tick."""
    for ours, theirs in (world, copy):
        assert_equal(ours, theirs, (name,))
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
def test_breaks_of_the_mirror(vehicles, name, vehicle):
    world = make_world(**vehicles)
    lanes = int(world.road.present.sum())
    back = [mirrored_vehicles(each, lanes) for each in both(mirrored(world))]
    assert_broken(both(world), back, name, vehicle)


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
def test_breaks_of_the_order(vehicles, target, order, name, vehicle):
    world = make_world(**vehicles)
    world = change(world, target_lane=target) if target else world
    order = np.array(order)
    whole = np.concatenate([order, np.arange(len(order), len(world.vehicles.x))])
    back = [taken(each, order.argsort()) for each in both(reordered(world, whole))]
    assert_broken(both(world), back, name, vehicle)


@pytest.mark.parametrize("distance", [200.0, 5000.0])
@pytest.mark.parametrize(
    ("kind", "speed"), [(CONSTANT, 12.5), (RULE_BASED, 25.0)],
    ids=["missing-target-speed", "speeding-car-behind"],
)  # fmt: skip
def test_a_car_behind_matters_at_any_distance(distance, kind, speed):
    """A driver would pass a slow car; a plain or speeding one behind keeps it back.

    One that is rule-based and not above its target speed does not.
    """
    for behind, lane in (((kind, speed), 0), ((RULE_BASED, 12.0), 1)):
        world = make_world([6000, 6000, 6022, 6000 - distance], [2, 0, 0, 1],
                           [12.5, 12.5, 8.0, behind[1]], timer=[1, 2, 1, 1],
                           kinds=[0, 2, 1, behind[0]])  # fmt: skip
        assert targets(world)[1] == lane


@pytest.mark.parametrize("settings", [PAPER_DRIVER, LINEAR_DRIVER], ids=["idm", "linear"])
def test_drivers_may_reverse(settings):
    """Nearer than the jam distance to a standing car they drive backwards."""
    settings = replace(settings, target_speed=12.5)
    world = make_world([-90, 0, 7], [0, 0, 0], [5, 0, 0], kinds=[0, 2, 1], settings=settings)
    for vehicles in both(world):
        assert vehicles.speed[1] < -0.01
