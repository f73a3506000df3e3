"""Figures: what is drawn is what the data say, and words stand apart."""

import dataclasses
from itertools import combinations

import matplotlib
import numpy as np
import pytest
from matplotlib import cbook
from matplotlib.collections import PolyCollection
from matplotlib.colors import to_hex
from matplotlib.text import Text
from PIL import Image

from fabricate import FLAT, OURS, make_arm, make_recording, make_rows, make_sweep, make_training
from lanewise.errors import LanewiseError
from lanewise.evaluation.cells import fold, pool
from lanewise.evaluation.grid import Grid
from lanewise.report import (
    figure_style,
    film_strip,
    goal_figure,
    profiles,
    road_shapes,
    seed_figure,
    sweep_map,
    training_curves,
)
from lanewise.report.figure_style import STYLES
from lanewise.report.sweep_result import figure_of

RECORDING = make_recording()
CRASHED = make_recording(accident=1, seconds=12.0)
PAIR = {"single-level": make_recording(goals=False), "hierarchical": RECORDING}
CELLS = make_sweep(Grid((8.0, 13.0), (8.0, 9.0), (3, 4), (14.8, 16.44), (4.06,))).cells
FIGURES = {
    "training": lambda: training_curves.draw({"single-level": make_training()}),
    "stages": lambda: training_curves.draw_stages(make_rows()),
    "profiles": lambda: profiles.draw({"a": crashing(4.0, 6.5), "hierarchical": [RECORDING]}),
    "film strip": lambda: film_strip.draw(PAIR, times=(1.0, 18.0)),
    "goals": lambda: goal_figure.draw(CRASHED),
    "seeds": lambda: seed_figure.draw([OURS, FLAT], "lanewise"),
}


def words(figure):
    """Every text a reader sees, with its box (left, bottom, right, top) in pixels and its look."""
    figure.draw_without_rendering()
    hidden = set()
    for axes in figure.axes:
        for axis in (axes.xaxis, axes.yaxis):
            low, high = sorted(axis.get_view_interval())
            for tick in [*axis.get_major_ticks(), *axis.get_minor_ticks()]:
                outside = not low - 1e-9 <= tick.get_loc() <= high + 1e-9
                if outside or not axes.axison:
                    hidden |= {tick.label1, tick.label2}
    return [
        (text.get_text(), text.get_window_extent().extents.tolist(), text.get_color())
        for text in figure.findobj(Text)
        if text not in hidden and text.get_visible() and text.get_text().strip()
    ]


def check_words(figure, slack=0.5):
    """The words, none of which leaves the figure or runs into another."""
    seen = words(figure)
    assert seen
    width, height = figure.bbox.width, figure.bbox.height
    for name, (left, bottom, right, top), _ in seen:
        inside = -slack <= min(left, bottom) and right <= width + slack and top <= height + slack
        assert inside, f"{name!r} leaves the figure"
    for (name, a, _), (other, b, _) in combinations(seen, 2):
        apart = a[2] <= b[0] + slack or b[2] <= a[0] + slack
        apart = apart or a[3] <= b[1] + slack or b[3] <= a[1] + slack
        assert apart, f"{name!r} runs into {other!r}"
    return seen


def lines(axes, **look):
    """The lines with this colour, marker or width."""
    return [
        line
        for line in axes.lines
        if all(getattr(line, f"get_{name}")() == value for name, value in look.items())
    ]


@pytest.mark.parametrize("name", FIGURES)
def test_words_stand_apart_whatever_the_users_own_settings(name):
    with matplotlib.rc_context({"font.size": 20.0, "text.color": "red", "figure.dpi": 50}):
        before = dict(matplotlib.rcParams)
        figure = FIGURES[name]()
        assert dict(matplotlib.rcParams) == before
    assert figure.dpi == figure_style.DPI
    assert "red" not in {colour for *_, colour in check_words(figure)}


def test_the_same_data_give_the_same_files(tmp_path):
    for name, settings in (("a", {}), ("b", {"font.size": 20.0, "savefig.dpi": 50})):
        with matplotlib.rc_context(settings):
            figure_style.save(FIGURES["seeds"](), tmp_path / name)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a.png", "a.svg", "b.png", "b.svg"]
    for suffix in (".png", ".svg"):
        first, second = (tmp_path / f"{name}{suffix}" for name in "ab")
        assert first.read_bytes() == second.read_bytes()
    width = round(figure_style.WIDTH * figure_style.DPI)
    assert Image.open(tmp_path / "a.png").width == width
    assert "dc:date" not in (tmp_path / "a.svg").read_text(encoding="utf-8")


def test_controllers_keep_their_style_and_others_take_what_is_left():
    alone = figure_style.styles(["hierarchical"])
    among = figure_style.styles(["mine", "h-DQN", "hierarchical", "yours"])
    assert alone["hierarchical"] == among["hierarchical"] == STYLES[1]
    assert (among["mine"], among["yours"]) == (STYLES[0], STYLES[2])
    assert len(set(among.values())) == 4
    for column in zip(*STYLES, strict=True):  # colours, dashes, markers
        assert len(set(column)) == len(STYLES)


def test_a_dollar_in_a_title_is_a_dollar():
    arms = {"costs $5 or $x^2$": make_training()}
    label = training_curves.draw(arms).legends[0].get_texts()[0].get_text()
    assert label == r"costs \$5 or \$x^2\$ (2 seeds)"
    assert not cbook.is_math_text(label)


def test_what_cannot_be_drawn_is_refused():
    with pytest.raises(LanewiseError, match="a: a training without a finished episode"):
        training_curves.draw({"a": [*make_training((5,)), []]})
    with pytest.raises(LanewiseError, match="hierarchical sets no goals"):
        goal_figure.draw(PAIR["single-level"])


# The learning curves.


def means(rows, column, window, factor=1.0):
    """Running means by their definition, one at a time."""
    values = [factor * float(row[column]) for row in rows]
    return [np.mean(values[max(0, n - window) : n]) for n in range(1, len(values) + 1)]


def test_curves_and_bands_are_mean_lowest_and_highest_of_the_running_means():
    seeds = make_training((70, 60, 90))
    figure = training_curves.draw({"hierarchical": seeds})
    columns = (("escaped", 100.0), ("success", 100.0), ("reward", 1.0), ("speed", 1.0))
    for axes, (column, factor) in zip(figure.axes, columns, strict=True):
        table = [means(rows, column, 50, factor)[:60] for rows in seeds]
        expected = [function(table, axis=0) for function in (np.mean, np.min, np.max)]
        # The curve, then the edges of the band.
        own = sorted(lines(axes, color=STYLES[1].colour), key=lambda line: -line.get_linewidth())
        for line, values in zip(own, expected, strict=True):
            np.testing.assert_array_equal(line.get_xdata(), np.arange(1, 61))
            np.testing.assert_allclose(line.get_ydata(), values)
        (band,) = axes.collections
        np.testing.assert_allclose(band.get_paths()[0].get_extents().y1, np.max(table))


def test_long_trainings_are_thinned_evenly_and_keep_their_end():
    places = training_curves.drawn_places(4273)
    assert len(places) <= training_curves.POINTS
    assert places[-1] == 4272
    assert len(set(np.diff(places))) == 1
    np.testing.assert_array_equal(training_curves.drawn_places(1000), np.arange(1000))


def test_the_mark_stands_on_the_curve_where_epsilon_settled():
    arms = {"a": make_training((60, 60)), "b": make_training((40,))}
    for axes in training_curves.draw(arms, settled={"a": 20.0, "b": 41.0}).axes:
        (mark,) = [line for line in axes.lines if line.get_marker() != "None"]
        assert list(mark.get_xdata()) == [20.0]  # b ended before its epsilon settled
        (curve,) = lines(axes, color=STYLES[0].colour, linewidth=figure_style.DRAWN)
        assert mark.get_ydata()[0] == pytest.approx(curve.get_ydata()[19])


def test_each_stage_has_its_own_line_style_and_mark():
    rows = make_rows()
    panel = training_curves.draw_stages(rows).axes[1]
    thick = lines(panel, linewidth=figure_style.DRAWN)
    assert [line.get_label() for line in thick] == ["single-level", "high-level", "hierarchical"]
    assert len({line.get_linestyle() + line.get_color() for line in thick}) == 3
    assert len([line for line in panel.lines if list(line.get_xdata()) == [32000.0] * 2]) == 3
    np.testing.assert_allclose(thick[1].get_ydata(), means(rows[100:200], "success_rate", 5, 100.0))
    training_curves.draw_stages(rows[:1])


# The profiles.


def crashing(*ends):
    """Recordings of different speeds, with an accident at each of the times given."""
    runs = [make_recording(seconds=20.0), make_recording(seconds=20.0)]
    shifted = []
    for number, run in enumerate([*runs, *(make_recording(1, seconds=end) for end in ends)]):
        reward, sums = run.reward + 0.01 * number, run.accumulated_reward + 0.1 * number
        if run.accident:
            reward[-1] = -10.0
            sums[-1] = sums[-2] - 10.0
        changes = {"speed": run.speed + number, "reward": reward, "accumulated_reward": sums}
        shifted.append(dataclasses.replace(run, **changes))
    return shifted


def curve_of(axes):
    (line,) = lines(axes, linewidth=figure_style.DRAWN)
    return line


def crosses(axes):
    return [(line.get_xdata()[0], line.get_ydata()[0]) for line in lines(axes, marker="x")]


def test_profiles_are_means_over_the_episodes_still_under_way():
    runs = crashing(4.0, 6.5)
    speed, instant, accumulated = profiles.draw({"a": runs}).axes
    for number, t in enumerate(np.arange(0.0, 20.5, 0.5)):
        driving = [run for run in runs if t <= run.time[-1]]
        expected = np.mean([run.speed[number, 0] for run in driving])
        assert curve_of(speed).get_ydata()[number] == pytest.approx(expected)
        if number:
            unharmed = [run for run in driving if not run.accident or t < run.time[-1]]
            expected = np.mean([run.reward[number] for run in unharmed])
            assert curve_of(instant).get_ydata()[number - 1] == pytest.approx(expected)
        last = [min(number, len(run.time) - 1) for run in runs]
        sums = [run.accumulated_reward[i] for run, i in zip(runs, last, strict=True)]
        assert curve_of(accumulated).get_ydata()[number] == pytest.approx(np.mean(sums))
    assert curve_of(instant).get_xdata()[0] == 0.5


def test_accidents_are_crosses_at_their_time_speed_and_sum():
    runs = crashing(4.0, 6.5)
    speed, instant, accumulated = profiles.draw({"a": runs}).axes
    ends = [(run.time[-1], run.speed[-1, 0]) for run in runs[2:]]
    np.testing.assert_allclose(crosses(speed), ends)
    sums = [(run.time[-1], run.accumulated_reward[-1]) for run in runs[2:]]
    np.testing.assert_allclose(crosses(accumulated), sums)
    assert crosses(instant) == []
    assert instant.get_ylim()[0] > -1.0  # the penalty does not squash the rewards of driving
    ended = [make_recording(seconds=6.0), make_recording(1, seconds=6.5)]
    assert crosses(profiles.draw({"a": ended}).axes[0]) == []


def test_an_arm_ends_with_its_shortest_recording_that_had_no_accident():
    runs = [make_recording(seconds=9.0), make_recording(seconds=12.0)]
    lost = [make_recording(accident=2, seconds=end) for end in (3.0, 5.0)]
    for arm, end in ((runs, 9.0), (lost, 5.0)):
        assert curve_of(profiles.draw({"a": arm}).axes[0]).get_xdata()[-1] == end


# The goals.


def marks(axes, look):
    (line,) = lines(axes, marker=look["marker"], color=look["color"])
    return np.column_stack(line.get_data()).tolist()


def test_tracks_and_marks_are_the_recording():
    """The made-up goals change in the frames that end at 3 s and at 9 s."""
    across, speed = goal_figure.draw(RECORDING).axes
    for axes, goal, ego in (
        (across, RECORDING.lane_centre[RECORDING.goal_lane], RECORDING.y[:, 0]),
        (speed, RECORDING.goal_speed, RECORDING.speed[:, 0]),
    ):
        tracks = {line.get_drawstyle(): line for line in axes.lines if len(line.get_xdata()) == 51}
        np.testing.assert_array_equal(tracks["steps-pre"].get_ydata(), goal)
        np.testing.assert_array_equal(tracks["default"].get_ydata(), ego)
        assert tracks["steps-pre"].get_color() == goal_figure.GOAL.colour
        set_ = [[0.0, goal[1]], [2.5, goal[6]], [8.5, goal[18]]]
        assert marks(axes, goal_figure.MARKERS["set"]) == set_
        assert marks(axes, goal_figure.MARKERS["timed out"]) == [[2.5, ego[5]]]
        assert marks(axes, goal_figure.MARKERS["reached"]) == [[8.5, ego[17]]]


def test_an_accident_is_named_and_marked():
    figure = goal_figure.draw(CRASHED)
    assert "ran into the car ahead" in [text.get_text() for text in figure.legends[0].get_texts()]
    for axes, height in zip(figure.axes, (CRASHED.y[-1, 0], CRASHED.speed[-1, 0]), strict=True):
        assert marks(axes, {"marker": "X", "color": "black"}) == [[12.0, height]]


# The film strip.


def shapes(axes, colour):
    """Corners of the polygons in a colour."""
    (drawn,) = [each for each in axes.collections if isinstance(each, PolyCollection)]
    pairs = zip(drawn.get_paths(), drawn.get_facecolors(), strict=True)
    return [path.vertices[:4] for path, own in pairs if to_hex(own) == colour.lower()]


def captions(axes):
    return [text.get_text() for text in axes.texts if len(text.get_text()) > 1]


def test_frames_are_in_rows_of_time_and_columns_of_controllers():
    axes = film_strip.draw(PAIR, times=(1.0, 9.0)).axes
    assert [each.get_label() for each in axes] == [
        f"{title}, {t} s" for title in PAIR for t in (1, 9)
    ]
    boxes = [each.get_position() for each in axes]
    assert boxes[0].x0 == boxes[1].x0 < boxes[2].x0 == boxes[3].x0
    assert boxes[0].y0 == boxes[2].y0 > boxes[1].y0 == boxes[3].y0
    box, (bottom, top) = axes[0].get_window_extent(), axes[0].get_ylim()
    left, right = axes[0].get_xlim()
    assert bottom > top  # left is up
    assert box.width / (right - left) == pytest.approx(box.height / (bottom - top))


def test_vehicles_stand_where_the_recording_says():
    strip = film_strip.draw({"a": RECORDING}, times=(2.0, 5.0))
    for t, axes in zip((2.0, 5.0), strip.axes, strict=True):
        index = round(2 * t)
        (ego,) = shapes(axes, road_shapes.BODIES[0])
        place = (RECORDING.x[index, 0], RECORDING.y[index, 0])
        np.testing.assert_allclose(ego.mean(axis=0), place)
        along = ego[1] - ego[0]
        assert np.hypot(*along) == pytest.approx(5.0)
        assert np.arctan2(along[1], along[0]) == pytest.approx(RECORDING.heading[index, 0])
        centres = sorted(corners.mean(axis=0)[0] for corners in shapes(axes, road_shapes.BODIES[1]))
        np.testing.assert_allclose(centres, sorted(RECORDING.x[index, 1:3]))
        assert {"E", "1", "2"} <= {text.get_text() for text in axes.texts}


def test_the_caption_says_what_has_become_of_the_ego():
    first, last = film_strip.draw({"a": RECORDING}, times=(4.0, 25.0)).axes
    reward, total = RECORDING.reward[8], RECORDING.accumulated_reward[8]
    assert captions(first) == [f"$r_t$ = {reward:+.2f}   $R_t$ = {total:.2f}   8.0 m/s"]
    gap = RECORDING.x[-1, 0] - 2.5 - (RECORDING.x[-1, 1:3] + 2.5).max()
    assert captions(last)[1] == f"{gap:.0f} m past the trap"
    before, after = film_strip.draw({"a": CRASHED}, times=(11.0, 18.0)).axes
    assert "collision at 12.0 s" not in captions(before)
    assert captions(after)[1] == "collision at 12.0 s"
    assert captions(after)[0].startswith("$r_t$ = -   ")
    assert len(shapes(after, road_shapes.CRASH)) == 12  # the ego and a trap car, six strokes each
    assert not shapes(before, road_shapes.CRASH)
    short = film_strip.draw({"a": make_recording(seconds=5.0)}, times=(9.0,)).axes[0]
    assert captions(short)[1] == "ended at 5.0 s"
    alone = np.where(RECORDING.role == 1, 2, RECORDING.role)
    free = dataclasses.replace(RECORDING, role=alone, escaped=RECORDING.time > 1.0)
    assert "succeeded" in captions(film_strip.draw({"a": free}, times=(2.0,)).axes[0])


def test_the_longest_captions_stand_apart():
    long = {"accumulated_reward": np.full(31, -100.0), "escaped": np.ones(31, bool)}
    worst = dataclasses.replace(make_recording(accident=2, seconds=15.0), **long)
    figure = film_strip.draw({f"controller {n}": worst for n in range(2)}, times=(9.0, 18.0))
    seen = [name for name, *_ in check_words(figure)]
    assert seen.count("off road at 15.0 s") == 2


# All seeds, and the map of a sweep.


def test_every_seed_is_a_dot_and_the_mean_a_line():
    figure = seed_figure.draw([OURS, FLAT, make_arm("search", "search", [100])], "lanewise")
    success, own = figure.axes[1], STYLES[figure_style.OWN["hierarchical"]]
    (dots,) = lines(success, marker=own.marker, color=own.colour)
    np.testing.assert_allclose(dots.get_xdata(), [98, 99, 100, 100, 90])
    thick = lines(success, linewidth=figure_style.DRAWN)
    np.testing.assert_allclose([line.get_xdata()[0] for line in thick], [97.4, 0.2, 100.0])
    names = [label.get_text() for label in figure.axes[0].get_yticklabels()]
    assert names == ["two levels", "flat | one", "search"]
    papers, ours, reward = (
        sorted(line.get_xdata()[0] for line in lines(axes, linewidth=0.9)) for axes in figure.axes
    )
    np.testing.assert_allclose(papers, [0.0, 97.67])
    assert ours == []
    np.testing.assert_allclose(reward, [3.32, 13.2])


def test_every_field_shows_its_share_of_winnable_starts():
    panels = [axes for axes in sweep_map.draw(CELLS, sweep_map.MapAxes()).axes if axes.patches]
    assert len(panels) == 4
    for row, outcome in ((0, "successes"), (1, "accidents")):
        for column, lanes in enumerate((3, 4)):
            axes = panels[2 * row + column]
            cells = [cell for cell in CELLS if cell.place.lanes == lanes]
            groups = fold(cells, "ego_speed", "trap_speed").values()
            shares = [share for own in groups if (share := pool(own, 0, "winnable")).episodes]
            shown = [text.get_text() for text in axes.texts]
            wanted = [figure_of(100.0 * share.rate(outcome)) for share in shares]
            assert [text for text in shown if "/" not in text] == wanted
            # At 13 m/s: none of two starts behind 8 m/s, one of two behind 9 m/s can be won.
            assert [text for text in shown if "/" in text] == ["1/2"]
            assert len([patch for patch in axes.patches if patch.get_hatch()]) == 2


def test_only_all_and_nothing_are_written_as_such():
    found = [figure_of(percent) for percent in (0.0, 100.0, 99.97, 0.02)]
    assert found == ["0", "100", "99.9", "0.1"]
