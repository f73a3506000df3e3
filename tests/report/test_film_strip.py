"""The film strip: who stands where in each frame, and the figures below it."""

import dataclasses

import numpy as np
import pytest
from fabricate import make_recording
from looking import check_words, words
from matplotlib.colors import to_hex
from matplotlib.patches import Polygon

from lanewise.errors import LanewiseError
from lanewise.report import film_strip, road
from lanewise.report.film_strip import draw

PAIR = {"single-level": make_recording(goals=False), "hierarchical": make_recording()}


def bodies(axes, role):
    colour = road.BODIES[role].lower()
    return [
        patch.get_xy()[:4]
        for patch in axes.patches
        if isinstance(patch, Polygon) and to_hex(patch.get_facecolor()) == colour
    ]


def captions(axes):
    return [text.get_text() for text in axes.texts if len(text.get_text()) > 1]


def test_frames_are_in_rows_of_time_and_columns_of_controllers():
    figure = draw(PAIR, times=(1.0, 9.0))
    assert [axes.get_label() for axes in figure.axes] == [
        "single-level, 1 s",
        "single-level, 9 s",
        "hierarchical, 1 s",
        "hierarchical, 9 s",
    ]
    boxes = [axes.get_position() for axes in figure.axes]
    assert boxes[0].x0 == boxes[1].x0 < boxes[2].x0 == boxes[3].x0
    assert boxes[0].y0 == boxes[2].y0 > boxes[1].y0 == boxes[3].y0


def test_vehicles_stand_where_the_recording_says():
    recording = PAIR["hierarchical"]
    for t, axes in zip((2.0, 5.0), draw({"a": recording}, times=(2.0, 5.0)).axes, strict=True):
        (ego,) = bodies(axes, 0)
        index = round(2 * t)
        x, y, heading = (
            values[index, 0] for values in (recording.x, recording.y, recording.heading)
        )
        np.testing.assert_allclose(ego.mean(axis=0), (x, y))
        along = ego[1] - ego[0]
        assert np.hypot(*along) == pytest.approx(5.0)
        assert np.arctan2(along[1], along[0]) == pytest.approx(heading)
        centres = [corners.mean(axis=0) for corners in bodies(axes, 1)]
        np.testing.assert_allclose(centres, np.c_[recording.x[index, 1:3], recording.y[index, 1:3]])


def test_scales_are_equal_and_left_is_up():
    axes = draw(PAIR, times=(1.0,)).axes[0]
    box, (left, right), (bottom, top) = axes.get_window_extent(), axes.get_xlim(), axes.get_ylim()
    assert bottom > top
    assert box.width / (right - left) == pytest.approx(box.height / (bottom - top))


def test_figures_below_a_frame():
    recording = PAIR["hierarchical"]
    (axes,) = draw({"a": recording}, times=(4.0,)).axes
    reward, total = recording.reward[8], recording.accumulated_reward[8]
    assert captions(axes)[0] == f"$r_t$ = {reward:+.2f}   $R_t$ = {total:.2f}   8.0 m/s"


def test_what_has_become_of_the_ego():
    recording = PAIR["hierarchical"]
    first, last = draw({"a": recording}, times=(1.0, 25.0)).axes
    assert captions(first)[1:] == []
    gap = recording.x[-1, 0] - 2.5 - (recording.x[-1, 1:3] + 2.5).max()
    assert captions(last)[1] == f"{gap:.0f} m past the trap"


def test_an_episode_that_ended_stands_still_and_says_so():
    crashed = make_recording(accident=1, seconds=3.5)
    before, after = draw({"a": crashed}, times=(3.0, 18.0)).axes
    assert captions(before)[1:] == []
    assert captions(after)[1] == "collision at 3.5 s"
    assert captions(after)[0].startswith("$r_t$ = -   ")
    thick = [line for line in after.lines if line.get_linewidth() == 1.6]
    assert len(thick) == 4  # the ego and a trap car, two strokes each
    assert not [line for line in before.lines if line.get_linewidth() == 1.6]
    short = draw({"a": make_recording(seconds=5.0)}, times=(9.0,)).axes[0]
    assert captions(short)[1] == "ended at 5.0 s"


def test_the_goal_lane_is_shown_for_a_controller_with_goals():
    flat, with_goals = draw(PAIR, times=(1.0,)).axes
    tint = [p for p in with_goals.patches if to_hex(p.get_facecolor()) == road.TINT.lower()]
    assert [p.get_y() for p in tint] == [-2.0]  # lane 1
    assert not [p for p in flat.patches if to_hex(p.get_facecolor()) == road.TINT.lower()]


def test_the_legend_names_only_what_is_seen():
    near = draw(PAIR, times=(1.0,)).legends[0]
    assert [text.get_text() for text in near.get_texts()] == [
        "ego (E)",
        "trap cars (1, 2)",
        "lane of the goal",
    ]
    x = PAIR["hierarchical"].x.copy()
    x[:, 3] = x[:, 0] + 40.0
    met = draw({"a": dataclasses.replace(PAIR["hierarchical"], x=x)}, times=(1.0,)).legends[0]
    assert "traffic" in [text.get_text() for text in met.get_texts()]


def with_roles(*role):
    """The ego is where it was; the first vehicles are of these roles."""
    made = PAIR["hierarchical"]
    return dataclasses.replace(made, role=np.r_[role, made.role[len(role) :]].astype(np.int8))


def test_as_many_trap_cars_are_numbered_and_named_as_there_are():
    for count, said in ((1, "trap car (1)"), (2, "trap cars (1, 2)"), (3, "trap cars (1 to 3)")):
        figure = draw({"a": with_roles(0, *[1] * count, *[2] * (3 - count))}, times=(2.0,))
        names = [text.get_text() for text in figure.legends[0].get_texts()]
        assert said in names
    one = make_recording()
    twelve = {
        name: np.repeat(getattr(one, name)[..., :2], [1, 12], axis=-1)
        for name in ("x", "y", "heading", "speed", "crashed", "present", "length", "width")
    }
    draw({"a": dataclasses.replace(one, **twelve, role=np.r_[0, [1] * 12])}, times=(2.0,))


def test_success_without_a_trap_is_no_way_past_it():
    alone = with_roles(0, 2, 2)
    figure = draw({"a": dataclasses.replace(alone, escaped=alone.time > 1.0)}, times=(2.0,))
    assert "succeeded" in captions(figure.axes[0])


def test_absent_vehicles_are_not_drawn():
    recording = dataclasses.replace(PAIR["hierarchical"], present=np.arange(8) == 0)
    axes = draw({"a": recording}, times=(1.0,)).axes[0]
    assert len(bodies(axes, 0)) == 1
    assert not bodies(axes, 1)


@pytest.mark.parametrize("columns", [1, 2])
def test_words_stand_apart(columns):
    worst = dataclasses.replace(
        make_recording(accident=2, seconds=15.0),
        accumulated_reward=np.full(31, -100.0),
        escaped=np.ones(31, bool),
    )
    figure = draw({f"controller {n}": worst for n in range(columns)})
    check_words(figure)
    assert sum(name == "off road at 15.0 s" for name, _ in words(figure)) == columns


def test_what_cannot_be_drawn_is_refused(tmp_path):
    for columns, times in (({}, (1.0,)), (PAIR, ())):
        with pytest.raises(LanewiseError, match="a recording and a moment"):
            film_strip.write(columns, tmp_path / "a.png", times=times)
    with pytest.raises(LanewiseError, match="2 recordings, not 3"):
        film_strip.write({str(n): PAIR["hierarchical"] for n in range(3)}, tmp_path / "a.png")
    assert not list(tmp_path.iterdir())
