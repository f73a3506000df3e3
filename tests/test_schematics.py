"""The schematics of the pages, SVG files written by hand, say the settings' own numbers."""

from math import pi
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest

from lanewise.config.settings import Settings
from lanewise.controllers import goals
from lanewise.driving import actions, observation
from lanewise.scenario import trap

IMAGES = Path(__file__).parents[1] / "docs" / "images"
SVG = "{http://www.w3.org/2000/svg}"
SETTINGS = Settings()
MINUS, TIMES = "\N{MINUS SIGN}", "\N{MULTIPLICATION SIGN}"
TURN = round(pi / SETTINGS.driving.actions.steering)
TRAP, TRAFFIC = SETTINGS.scenario, SETTINGS.scenario.traffic


def read(name):
    """The drawing, and its texts."""
    root = ElementTree.parse(IMAGES / f"{name}.svg").getroot()
    return root, ["".join(text.itertext()) for text in root.iter(f"{SVG}text")]


def number(value):
    return f"{value:g}".replace("-", MINUS)


def steps(values):
    return ", ".join(f"+{number(v)}" if v > 0 else number(v) for v in sorted(set(values)))


@pytest.mark.parametrize("name", ["trap-schematic", "start-ranges"])
def test_vehicles_stand_where_a_test_starts(name):
    """One unit of the drawing is a metre; traffic stands at its mean places."""
    root, _ = read(name)
    places = {
        use.get("id"): (float(use.get("x")), float(use.get("y"))) for use in root.iter(f"{SVG}use")
    }
    world = trap.sample(TRAP, trap.start_key(0, "test", 0), "test")
    x, y = np.asarray(world.vehicles.x), np.asarray(world.vehicles.y)
    for number_, vehicle in enumerate(("ego", "trap-1", "trap-2")):
        assert places[vehicle] == pytest.approx((x[number_], y[number_]), abs=1e-5)
    if name == "trap-schematic":
        drawn = [places["traffic-1"][0], places["traffic-2"][0]]
        first = TRAP.test_front_distance + TRAFFIC.first_gap
        assert drawn == pytest.approx([first, first + TRAFFIC.spacing])


def test_ranges_are_drawn_to_scale():
    root, _ = read("start-ranges")
    ends = (TRAP.training_front_distance, TRAP.training_side_distance)
    for number_, (low, high) in enumerate(ends, 1):
        (bar,) = [r for r in root.iter(f"{SVG}rect") if r.get("id") == f"range-{number_}"]
        assert (float(bar.get("x")), float(bar.get("width"))) == pytest.approx((low, high - low))
    ghosts = [float(u.get("x")) for u in root.iter(f"{SVG}use") if u.get("href") == "#ghost"]
    assert ghosts == pytest.approx([*ends[0], *ends[1]])


LOOP = (
    " → ".join(map(str, (observation.SIZE, *SETTINGS.high_level.learner.hidden, 9))),
    " → ".join(
        map(
            str,
            (observation.SIZE + goals.FEATURES, *SETTINGS.low_level.learner.hidden, actions.COUNT),
        )
    ),
    f"lane {steps(lane for lane, _ in goals.ACTION_SETS[SETTINGS.goals.action_set])}",
    f"{TIMES} speed "
    + steps(SETTINGS.goals.speed_step * v for _, v in goals.ACTION_SETS[SETTINGS.goals.action_set])
    + " m/s",
    f"acceleration {steps(a * SETTINGS.driving.actions.acceleration for a in (-1, 0, 1))} m/s²",
    f"{TIMES} steering {MINUS}π/{TURN}, 0, +π/{TURN} rad",
    f"|Δd| < {number(SETTINGS.goals.lateral_tolerance)} m, "
    f"|Δv| < {number(SETTINGS.goals.speed_tolerance)} m/s",
    f"at {SETTINGS.driving.decision_frequency} Hz",
    f"observation: {observation.SIZE} features of",
    f"the ego and {observation.NEIGHBOURS} vehicles",
)
SAID = {
    "trap-schematic": (
        f"D₁ = {TRAP.test_front_distance:g} m",
        f"D₂ = {TRAP.test_side_distance:g} m",
        f"{TRAFFIC.first_gap:g} ± {TRAFFIC.spacing_jitter:g} m",
        f"{TRAFFIC.spacing:g} ± {TRAFFIC.spacing_jitter:g} m",
        f"ego (E), {TRAP.ego_speed:g} m/s at the start",
        f"trap cars (1, 2), {TRAP.trap_speed:g} m/s throughout",
        f"traffic, {TRAFFIC.speed:g} m/s at the start, {TRAFFIC.vehicles_ahead} vehicles",
    ),
    "start-ranges": (
        f"D₁ = {TRAP.test_front_distance:g} m in tests",
        f"D₂ = {TRAP.test_side_distance:g} m in tests",
        "D₁ in training: {:g} to {:g} m".format(*TRAP.training_front_distance),
        "D₂ in training: {:g} to {:g} m".format(*TRAP.training_side_distance),
    ),
    "framework": LOOP,
    "two-steps": (
        *LOOP,
        f"looks {SETTINGS.planner.preview} decisions ahead",
        f"Step 1: the high level learns, {SETTINGS.high_level.decisions:,} decisions",
        f"Step 2: the low level learns, {SETTINGS.low_level.decisions:,} decisions",
        f"otherwise after {SETTINGS.goals.time_limit:g} s",
        f"reward {MINUS} (|Δd| / {goals.LATERAL_RANGE:g} m + |Δv| / {goals.SPEED_RANGE:g} m/s)",
    ),
}


@pytest.mark.parametrize("name", SAID)
def test_the_words_say_the_settings(name):
    _, words = read(name)
    assert set(SAID[name]) <= set(words)


def test_what_the_words_take_for_granted():
    """No number stands for these in a drawing, but its words do."""
    assert TRAFFIC.vehicles_behind == 0
    assert SETTINGS.goals.test_renewal == SETTINGS.goals.training_renewal == "timestep"
    assert SETTINGS.high_level.discount_across_goal == "per-goal"
    assert (SETTINGS.low_level.tracking_weight, SETTINGS.low_level.approach_weight) == (1.0, 0.0)
    assert SETTINGS.high_level.episodes == SETTINGS.low_level.episodes == 0
