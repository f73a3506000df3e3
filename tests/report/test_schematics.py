"""The schematics: to scale, in the scenario's own places, with the settings' own numbers."""

from dataclasses import replace

import numpy as np
import pytest
from looking import check_words, words
from matplotlib.colors import to_hex
from matplotlib.patches import FancyBboxPatch, Polygon

from lanewise.config import compose
from lanewise.config.settings import Settings
from lanewise.report import framework, road, start_ranges, trap_schematic, two_steps
from lanewise.scenario import trap
from lanewise.scenario.settings import TrafficSettings, TrapSettings

OTHER = TrapSettings(
    lanes=5,
    ego_speed=12.25,
    trap_speed=8.5,
    test_front_distance=8.0,
    test_side_distance=-3.0,
    training_front_distance=(6.0, 20.0),
    training_side_distance=(-9.0, 2.0),
    traffic=TrafficSettings(vehicles_ahead=4, vehicles_behind=2, spacing_jitter=0.0),
)
PAPER = compose(
    preset="paper",
    flags={
        "goals.action_set": "single-5",
        "goals.test_renewal": "critic",
        "goals.training_renewal": "decision",
        "goals.time_limit": 1000.0,
        "goals.speed_step": 2.5,
        "high_level.learner.hidden": (1024, 1024, 1024, 1024, 1024),
        "low_level.tracking_weight": 0.0,
        "low_level.decisions": 1_000_000,
        "driving.actions.steering": 0.0625,
        "scenario.traffic.vehicles_ahead": 0,
    },
)


def vehicles(axes, role):
    """Centres of the vehicles of a role, m."""
    colour = road.BODIES[role].lower()
    return [
        patch.get_xy()[:4].mean(axis=0)
        for patch in axes.patches
        if isinstance(patch, Polygon) and to_hex(patch.get_facecolor()) == colour
    ]


def text_of(figure):
    return "\n".join(name for name, _ in words(figure))


@pytest.mark.parametrize("settings", [TrapSettings(), OTHER])
def test_the_trap_is_drawn_where_the_scenario_puts_it(settings):
    """Against a start as it is driven; without jitter the traffic's places along the road too."""
    world = trap.sample(settings, trap.start_key(0, "test", 0), "test")
    x, y = np.asarray(world.vehicles.x), np.asarray(world.vehicles.y)
    (axes,) = trap_schematic.draw(settings).axes
    np.testing.assert_allclose(vehicles(axes, 0), [(x[0], y[0])], atol=1e-5)
    np.testing.assert_allclose(vehicles(axes, 1), np.c_[x[1:3], y[1:3]], atol=1e-5)
    drawn = np.array(vehicles(axes, 2))[:, 0]
    behind = [3 + settings.traffic.vehicles_ahead] if settings.traffic.vehicles_behind else []
    jitter = 2.0 * settings.traffic.spacing_jitter
    np.testing.assert_allclose(drawn, x[[3, 4, *behind]], atol=jitter + 1e-4)


@pytest.mark.parametrize("settings", [TrapSettings(), OTHER, replace(OTHER, lanes=2)])
@pytest.mark.parametrize("schematic", [trap_schematic, start_ranges])
def test_roads_are_to_scale_and_words_stand_apart(schematic, settings):
    figure = schematic.draw(settings)
    check_words(figure)
    (axes,) = figure.axes
    box, (left, right) = axes.get_window_extent(), axes.get_xlim()
    bottom, top = axes.get_ylim()
    assert box.width / (right - left) == pytest.approx(box.height / (bottom - top))


def test_the_trap_says_its_settings():
    said = text_of(trap_schematic.draw(TrapSettings()))
    for words_of_it in (
        "$D_1$ = 15.62 m",
        "$D_2$ = 6.61 m",
        "45 ± 5 m",
        "25 ± 5 m",
        "12.5 m/s at the start, 9 vehicles",
        "10 m/s throughout",
    ):
        assert words_of_it in said
    other = text_of(trap_schematic.draw(OTHER))
    assert "$D_2$ = \N{MINUS SIGN}3 m" in other
    assert "8.5 m/s throughout" in other
    assert "way out" not in text_of(trap_schematic.draw(replace(OTHER, lanes=2)))


@pytest.mark.parametrize("settings", [TrapSettings(), OTHER])
def test_ranges_are_drawn_on_the_road(settings):
    (axes,) = start_ranges.draw(settings).axes
    ghosts = [
        float(patch.get_xy()[:4].mean(axis=0)[0])
        for patch in axes.patches
        if isinstance(patch, Polygon) and patch.get_facecolor()[3] == 0.0
    ]
    ends = [*settings.training_front_distance, *settings.training_side_distance]
    assert ghosts == pytest.approx(ends)
    tests = [settings.test_front_distance, settings.test_side_distance]
    assert [x for x, _ in vehicles(axes, 1)] == pytest.approx(tests)
    bars = [bar.get_paths()[0].get_extents() for bar in axes.collections]
    assert [end for bar in bars for end in (bar.x0, bar.x1)] == pytest.approx(ends)


@pytest.mark.parametrize("settings", [Settings(), PAPER])
@pytest.mark.parametrize("schematic", [framework, two_steps])
def test_words_stand_apart_and_inside_their_boxes(schematic, settings):
    figure = schematic.draw(settings)
    check_words(figure)
    boxes = [
        patch.get_window_extent()
        for patch in figure.axes[0].patches
        if isinstance(patch, FancyBboxPatch)
    ]
    inside = 0
    for name, (left, bottom, right, top) in words(figure):
        for box in boxes:
            touches = left < box.x1 and box.x0 < right and bottom < box.y1 and box.y0 < top
            if touches:
                held = box.x0 <= left and right <= box.x1 and box.y0 <= bottom and top <= box.y1
                assert held, f"{name!r} leaves its box"
                inside += 1
    assert inside >= 3 * len(boxes)


def test_the_framework_says_its_settings():
    said = text_of(framework.draw(Settings()))
    for words_of_it in (
        "26 → 512 → 512 → 9",
        "28 → 512 → 512 → 9",
        "+π/50 rad",
        "at 2 Hz",
        "< 0.3 m, ",
        "otherwise after 1 s",
        "IDM, MOBIL",
    ):
        assert words_of_it in said
    other = text_of(framework.draw(PAPER))
    assert "26 → 1024 → 1024 → 1024 → 1024 → 1024 → 5" in other
    assert "or speed \N{MINUS SIGN}2.5, 0, +2.5 m/s" in other
    assert "+0.0625 rad" in other
    assert "otherwise after 1000 s" in other
    assert "MOBIL" not in other


def test_the_two_steps_say_their_settings():
    said = text_of(two_steps.draw(Settings()))
    assert "Step 1: the high level learns, 120,000 decisions" in said
    assert "Step 2: the low level learns, 240,000 decisions" in said
    assert "otherwise after 3 s" in said
    assert "otherwise after 1 s" in said
    assert "reward \N{MINUS SIGN} ($|\\Delta d|$ / 4 m + $|\\Delta v|$ / 2 m/s)" in said
    other = text_of(two_steps.draw(PAPER))
    assert "the high level learns, 1,000 episodes" in other
    assert "2,000 episodes or 1,000,000 decisions" in other
    assert "otherwise after 1000 s" in other  # in step 1 the critic always holds the goal
    assert "otherwise at the next decision" in other
    assert "Delta v|$ / 2" not in other
    settings = compose(flags={"low_level.tracking_weight": 0.0, "low_level.approach_weight": 5.0})
    paid = "reward + 5 \N{MULTIPLICATION SIGN} fall of ($|\\Delta d|$ / 4 m"
    assert paid in text_of(two_steps.draw(settings))
