"""Live environments and our world at every tick; each difference has a name, where it may."""

from dataclasses import replace

import gymnasium
import jax
import numpy as np
import parity_names
import pytest
from parity_compare import at, errors_but_flags, errors_of
from parity_drive import commanded, compare, drive, follow
from parity_environments import draw, make
from parity_states import fit, paper_traffic

import parity
from lanewise.interop.highway_env import build_env, read_world

pytestmark = pytest.mark.usefixtures("float64")
ROOM, LANES = parity.RUN_ROOM, 8
"""One compiled size for most tests here."""


def explained(numbers, seconds, most, room=ROOM):
    """The names of the differences of some configurations, all of which must have one."""
    names = set()
    for number in numbers:
        configuration = draw(0, number, seconds, most)
        found = compare(make(0, configuration), seconds, room)
        assert found["unexplained"] == [], configuration
        names |= set(found["names"])
    return names


def test_a_few_live_environments():
    explained((3, 7, 19, 31, 38), 3.0, 8)


@pytest.mark.slow
def test_many_live_environments():
    assert explained(range(40), 10.0, 12, room=16)


def test_a_free_run_of_paper_traffic():
    found = parity.paper_run(1, 0, None)
    assert found["exceptions"] == []
    assert max(found["largest_errors"].values()) < 1e-9


def test_a_free_run_of_linear_drivers_among_others():
    found = parity.linear_run(1, 0, None, others=ROOM - 1)
    assert found["exceptions"] == []
    assert max(found["largest_errors"].values()) < 1e-9


@pytest.mark.parametrize("kind", ["LinearVehicle", "AggressiveVehicle", "DefensiveVehicle"])
def test_highway_v0_with_other_vehicles_type(kind):
    """As users give it; highway-env randomises the gains of each."""
    others = f"highway_env.vehicle.behavior.{kind}"
    action = {"type": "DiscreteAction"}
    config = {"other_vehicles_type": others, "vehicles_count": ROOM - 1, "action": action}
    env = gymnasium.make("highway-v0", config=config | {"vehicles_density": 1.5})
    env.reset(seed=3)
    env.action_space.seed(3)
    found = compare(env, 5.0, ROOM)
    assert (found["names"], found["unexplained"]) == ({}, [])
    assert max(found["largest_errors"].values()) < 1e-9


@pytest.mark.slow
@pytest.mark.parametrize("number", range(2))
@pytest.mark.parametrize("run", [parity.paper_run, parity.default_run, parity.linear_run])
def test_free_runs(run, number):
    assert run(2, number, None)["exceptions"] == []


def test_every_rate_and_every_number_of_lanes_is_drawn():
    drawn = [draw(0, number) for number in range(330)]
    assert len({(one.rate, one.lanes) for one in drawn}) == 88
    assert {one.controlled for one in drawn} == {1, 2, 3, 4}
    assert min(one.others for one in drawn) == 0
    assert max(one.others for one in drawn) == 80


@pytest.fixture(scope="module")
def driven():
    """Two seconds of traffic behind a trap."""
    with jax.enable_x64(True):
        return drive(build_env(paper_traffic(np.random.default_rng(1))), 2.0)


def test_what_is_read_and_does_not_drive_alike_has_no_name(driven):
    drivers = driven.start.drivers
    other = replace(drivers, time_gap=drivers.time_gap + 0.1)
    wrong = replace(driven, start=replace(driven.start, drivers=other))
    found, *_ = follow(wrong, ROOM)
    assert [difference["names"] for difference in found] == [(None,)] * len(driven.number)


def one_tick_apart(driven, change):
    """The name of a difference that a change of ours makes after rounding of earlier ticks."""
    wanted = at(driven.vehicles, 1)
    errors = errors_of(change(wanted), wanted, driven.start.drivers.kind == 2)
    world = commanded(driven, 0, fit(driven.start, ROOM, LANES))
    return parity_names.name(world, wanted, errors, 1e-9, driven.rate)


def test_rounding_that_has_grown_is_named_by_where_it_grew(driven):
    def moved(vehicles):
        return replace(vehicles, x=vehicles.x + 2e-6)

    def hit(vehicles):
        return replace(vehicles, impacted=~vehicles.impacted)

    assert one_tick_apart(driven, moved) == ("amplified-rounding",)
    assert one_tick_apart(driven, hit) == ("amplified-rounding",)


@pytest.mark.parametrize(
    ("crashed", "push", "counts"),
    [(True, 1e-12, False), (False, 1e-12, True), (True, 1e-3, True)],
)
def test_only_an_empty_push_of_a_wreck_is_no_difference(driven, crashed, push, counts):
    vehicles = at(driven.vehicles, 0)
    vehicles = replace(vehicles, crashed=np.full_like(vehicles.crashed, crashed))
    pushed = replace(
        vehicles, impacted=np.ones_like(vehicles.impacted), impact_x=vehicles.impact_x + push
    )
    errors = errors_but_flags(pushed, vehicles, driven.start.drivers.kind == 2)
    assert (errors["impacted"] > 0).all() == counts


@pytest.mark.parametrize(("bounds", "named"), [(0.5, "cancelled-free-road-term"), (3.0, None)])
def test_a_gain_within_its_rounding_of_the_threshold_is_named(bounds, named):
    """A driver would get past a slow car, and its old rear vehicle is the ego."""
    start = paper_traffic(np.random.default_rng(1))
    kind = np.where(np.arange(12) == 1, 2, 0).astype(np.int32)
    vehicles = replace(
        start.vehicles,
        x=np.array([0.0, 30.3, 52.0, *(1e3 + 50 * np.arange(9))]),
        y=np.zeros(12),
        speed=np.where(np.arange(12) == 2, 8.0, 12.3),
        target_lane=np.zeros(12, np.int32),
        timer=np.full(12, 1.5),
    )
    drivers = replace(start.drivers, kind=kind, target_speed=np.where(kind == 2, 12.5, 0.0))

    def with_threshold(gain):
        other = replace(drivers, minimum_gain=np.full(12, gain))
        return fit(replace(start, vehicles=vehicles, drivers=other), ROOM, LANES)

    def changes(gain):
        worlds = parity_names.stack([with_threshold(gain)] * (3 + parity_names.NUDGES))
        return int(parity_names.one_tick(worlds, 0.1).target_lane[0, 1]) == 1

    low, high = -50.0, 50.0
    while high - low > 1e-12:
        middle = (low + high) / 2
        low, high = (middle, high) if changes(middle) else (low, middle)
    bound = parity_names.gain_bound(with_threshold(low))[1]
    env = build_env(with_threshold(low - 5 * bound))
    env.road.act()
    env.road.step(0.1)
    wanted = read_world(env).vehicles
    assert wanted.target_lane[1] == 1
    errors = errors_of(wanted, wanted, kind == 2)
    world = with_threshold(low + bounds * bound)
    assert parity_names.name(world, wanted, errors, 0.0, 10) == (named,)


def test_a_campaign_goes_on_from_what_is_done(tmp_path):
    path, task = tmp_path / "parity.partial", ("live_environments", 0, 3)
    parity.Done(path, {"state": "a"}).add(task, {"names": ("amplified-rounding",)})
    assert parity.Done(path, {"state": "a"}).parts == {task: {"names": ["amplified-rounding"]}}
    assert parity.Done(path, {"state": "b"}).parts == {}


def test_what_fails_a_campaign():
    parts = [{"exceptions": []}, {"exceptions": [{}]}, {"unexplained": []}, {"unexplained": [{}]}]
    assert parity.faults(parts) == 2


def test_the_result_names_every_difference():
    row = {
        "number": 1,
        "names": {"amplified-rounding": 2},
        "examples": {"amplified-rounding": {"tick": 3}},
    }
    assert parity.named([row, row | {"number": 2}]) == {
        "amplified-rounding": {
            "differences": 4,
            "configurations": 2,
            "example": {"number": 1, "tick": 3},
        }
    }
