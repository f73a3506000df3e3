"""The laws of the world, on small worlds that Hypothesis makes and on the campaign's random ones.

And where highway-env breaks one itself: an example in highway-env and in our world.
`campaigns/laws.py` holds the same functions against thousands of worlds; docs/numerics.md lists
the laws. The first test of a process compiles the one shape of batch that all use.
"""

import laws
import numpy as np
import pytest
from highway_env.road.road import Road, RoadNetwork
from highway_env.vehicle.behavior import IDMVehicle
from hypothesis import given, settings
from hypothesis import strategies as st
from law_pairs import assert_broken, both, change, mirror_both, reorder_both
from law_worlds import random_worlds
from laws_strategies import BATCH, SIZE, worlds

from lanewise.interop.highway_env import build_env
from lanewise.world.state import CONSTANT, RULE_BASED

EXAMPLES = 12
DEAR = ("halve-bicycle", "halve-idm")
"""140 ticks an example."""
ONE_SHAPE = [law for law in laws.WORLD_LAWS + laws.DRIVING_LAWS if law.name != "alone"]


def named(them):
    return pytest.mark.parametrize("law", them, ids=[law.name for law in them])


@named([law for law in ONE_SHAPE if law.name not in DEAR])
@settings(derandomize=True, deadline=None, max_examples=EXAMPLES, database=None)
@given(batch=worlds(), seed=st.integers(0, 2**32 - 1))
def test_law_on_worlds_of_hypothesis(law, batch, seed):
    assert law.check(batch, np.random.default_rng(seed)).broken == []


@named(ONE_SHAPE)
def test_law_on_random_worlds(law):
    rng = np.random.default_rng(11)
    for _ in range(1 if law.name in DEAR else 4):
        found = law.check(random_worlds(rng, BATCH, SIZE), rng)
        assert found.broken == []
        assert found.examples >= BATCH // 2


@pytest.mark.slow
@named([law for law in laws.LAWS if law.name in ("alone", "success", "batch")])
def test_law_in_batches_of_other_sizes(law):
    found = laws.hold(law, 1, seed=3)
    assert found.broken == []
    assert found.examples > 0


@pytest.mark.usefixtures("float64")
class TestBreaks:
    """By the name of the quirk in docs/numerics.md."""

    def test_right_overwrites_left_breaks_the_mirror(self, make_world):
        world = make_world([-90, 0, 25], [1, 1, 1], [5, 12, 5], timer=[1, 2, 1], kinds=[0, 2, 1])
        assert_broken(both(world), mirror_both(world), "target_lane", 1)

    def test_ties_between_lanes_break_the_mirror(self, make_world):
        """Exactly between two lanes is in the left one: its driver heeds another leader."""
        world = make_world([-90, 0, 18], [2, 0, 1], [5, 12, 2], y=[8, 2, 5.5], kinds=[0, 2, 1])
        assert_broken(both(world), mirror_both(world), "acceleration", 1)

    def test_push_of_equals_breaks_the_mirror(self, make_world):
        """Level with one another, the earlier one is pushed to the left, whichever way that is."""
        world = make_world([0, 1], [1, 1], [5, 5], kinds=[0, 1])
        assert_broken(both(world), mirror_both(world), "impact_y", 0)

    def test_ties_between_neighbours_break_the_order(self, make_world):
        world = make_world([-90, 0, 30, 30], [2, 0, 0, 0], [5, 12, 2, 11], y=[8, 0, -1, 1],
                           kinds=[0, 2, 1, 1])  # fmt: skip
        assert_broken(both(world), reorder_both(world, [0, 1, 3, 2]), "acceleration", 1)

    def test_decisions_in_list_order_break_the_order(self, make_world):
        world = make_world([-300.0, 0, 20, 40], [2, 0, 0, 0], y=[8.0, 0.0, 0.0, 0.0])
        world = change(world, target_lane=[2, 1, 1, 1])
        assert_broken(both(world), reorder_both(world, [0, 3, 2, 1]), "target_lane", 1)

    def test_lower_index_reach_breaks_the_order(self, make_world):
        """The fast one reaches the slow one ahead; if that comes first in the list, it does not."""
        world = make_world([-300, 0, 11.0], [0, 0, 0], [5, 35, 0], kinds=[0, 1, 1])
        assert_broken(both(world), reorder_both(world, [0, 2, 1]), "impacted", 1)

    def test_last_impact_wins_breaks_the_order(self, make_world):
        world = make_world([-2.5, 6.2, -10.1], [0, 0, 0], [25, 2, 39], kinds=[0, 1, 1])
        assert_broken(both(world), reorder_both(world, [0, 2, 1]), "impact_x", 0)

    def test_push_of_equals_breaks_the_order(self, make_world):
        world = make_world([-300, 0, 1], [0, 1, 1], [5, 5, 5], kinds=[0, 1, 1])
        assert_broken(both(world), reorder_both(world, [0, 2, 1]), "impact_y", 1)

    @pytest.mark.parametrize("distance", [200.0, 5000.0])
    @pytest.mark.parametrize(
        ("kind", "speed"), [(CONSTANT, 12.5), (RULE_BASED, 25.0)],
        ids=["missing-target-speed", "speeding-car-behind"],
    )  # fmt: skip
    def test_a_car_behind_matters_at_any_distance(self, make_world, distance, kind, speed):
        """A driver would pass a slow car; a plain or speeding one behind keeps it back.

        One that is rule-based and not above its target speed does not.
        """
        x = np.array([6000.0, 6000, 6022, 6000 - distance])
        for behind, passes in (((kind, speed), False), ((RULE_BASED, 12.0), True)):
            world = make_world(x, [2, 0, 0, 1], [12.5, 12.5, 8.0, behind[1]], timer=[1, 2, 1, 1],
                               kinds=[0, 2, 1, behind[0]])  # fmt: skip
            for vehicles in both(world):
                assert vehicles.target_lane[1] == (1 if passes else 0)

    def test_drivers_may_reverse(self, make_world):
        """Nearer than the jam distance to a standing car the IDM drives backwards."""
        world = make_world([-90, 0, 7], [0, 0, 0], [5, 0, 0], kinds=[0, 2, 1])
        for vehicles in both(world):
            assert vehicles.speed[1] < -0.01

    def test_a_timer_from_the_place_breaks_the_shift_of_a_start(self):
        """A timer begins by x and y: the same traffic elsewhere thinks at other times."""
        road = Road(RoadNetwork.straight_road_network(2), [])
        first, second = (IDMVehicle(road, [x, 0.0]).timer for x in (100.0, 101.0))
        assert abs(first - second) > 0.1

    def test_the_egos_place_is_absolute_in_what_it_sees(self, make_world):
        """The ego's x is over 200 m and cut at 1, its y counts from the leftmost lane."""
        seen = []
        for x, lane in ((50, 0), (250, 0), (450, 0), (50, 2)):
            env = build_env(make_world([x, x + 20], [lane, lane]))
            seen.append(env.observation_type.observe()[0, 1:3].tolist())
        np.testing.assert_allclose(seen, [[0.25, 0], [1, 0], [1, 0], [0.25, 8 / 12]], atol=1e-6)
