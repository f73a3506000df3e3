"""The film strip: who stands where in each frame, and the figures below it."""

import dataclasses

import numpy as np
import pytest
from fabricate import make_recording
from looking import check_words, words
from matplotlib.collections import PolyCollection
from matplotlib.colors import to_hex

from lanewise.errors import LanewiseError
from lanewise.report import road_shapes
from lanewise.report.film_strip import draw

PAIR = {"single-level": make_recording(goals=False), "hierarchical": make_recording()}


def shapes(axes, colour):
    """Corners of the polygons in a colour."""
    (drawn,) = [each for each in axes.collections if isinstance(each, PolyCollection)]
    pairs = zip(drawn.get_paths(), drawn.get_facecolors(), strict=True)
    return [path.vertices[:4] for path, own in pairs if to_hex(own) == colour.lower()]


def captions(axes):
    return [text.get_text() for text in axes.texts if len(text.get_text()) > 1]


def test_frames_are_in_rows_of_time_and_columns_of_controllers():
    axes = draw(PAIR, times=(1.0, 9.0)).axes
    names = [f"{title}, {t} s" for title in PAIR for t in (1, 9)]
    assert [each.get_label() for each in axes] == names
    boxes = [each.get_position() for each in axes]
    assert boxes[0].x0 == boxes[1].x0 < boxes[2].x0 == boxes[3].x0
    assert boxes[0].y0 == boxes[2].y0 > boxes[1].y0 == boxes[3].y0
    box, (left, right), (bottom, top) = (
        axes[0].get_window_extent(),
        axes[0].get_xlim(),
        axes[0].get_ylim(),
    )
    assert bottom > top  # left is up
    assert box.width / (right - left) == pytest.approx(box.height / (bottom - top))


def test_vehicles_stand_where_the_recording_says():
    recording = PAIR["hierarchical"]
    for t, axes in zip((2.0, 5.0), draw({"a": recording}, times=(2.0, 5.0)).axes, strict=True):
        index = round(2 * t)
        (ego,) = shapes(axes, road_shapes.BODIES[0])
        place = (recording.x[index, 0], recording.y[index, 0])
        np.testing.assert_allclose(ego.mean(axis=0), place)
        along = ego[1] - ego[0]
        assert np.hypot(*along) == pytest.approx(5.0)
        assert np.arctan2(along[1], along[0]) == pytest.approx(recording.heading[index, 0])
        centres = sorted(corners.mean(axis=0)[0] for corners in shapes(axes, road_shapes.BODIES[1]))
        np.testing.assert_allclose(centres, sorted(recording.x[index, 1:3]))
        assert {"E", "1", "2"} <= {text.get_text() for text in axes.texts}


def test_the_caption_says_what_has_become_of_the_ego():
    recording = PAIR["hierarchical"]
    first, last = draw({"a": recording}, times=(4.0, 25.0)).axes
    reward, total = recording.reward[8], recording.accumulated_reward[8]
    assert captions(first) == [f"$r_t$ = {reward:+.2f}   $R_t$ = {total:.2f}   8.0 m/s"]
    gap = recording.x[-1, 0] - 2.5 - (recording.x[-1, 1:3] + 2.5).max()
    assert captions(last)[1] == f"{gap:.0f} m past the trap"
    crashed = make_recording(accident=1, seconds=3.5)
    before, after = draw({"a": crashed}, times=(3.0, 18.0)).axes
    assert captions(before)[1:] == []
    assert captions(after)[1] == "collision at 3.5 s"
    assert captions(after)[0].startswith("$r_t$ = -   ")
    assert len(shapes(after, road_shapes.CRASH)) == 12  # the ego and a trap car, six strokes each
    assert not shapes(before, road_shapes.CRASH)
    short = draw({"a": make_recording(seconds=5.0)}, times=(9.0,)).axes[0]
    assert captions(short)[1] == "ended at 5.0 s"
    alone = dataclasses.replace(recording, role=np.where(recording.role == 1, 2, recording.role))
    free = dataclasses.replace(alone, escaped=alone.time > 1.0)
    assert "succeeded" in captions(draw({"a": free}, times=(2.0,)).axes[0])


@pytest.mark.parametrize("columns", [2])
def test_words_stand_apart(columns):
    worst = dataclasses.replace(
        make_recording(accident=2, seconds=15.0),
        accumulated_reward=np.full(31, -100.0),
        escaped=np.ones(31, bool),
    )
    figure = draw({f"controller {n}": worst for n in range(columns)})
    check_words(figure)
    assert sum(name == "off road at 15.0 s" for name, _ in words(figure)) == columns


def test_what_cannot_be_drawn_is_refused():
    for columns, times in (({}, (1.0,)), (PAIR, ())):
        with pytest.raises(LanewiseError, match="a recording and a moment"):
            draw(columns, times=times)
    with pytest.raises(LanewiseError, match="2 recordings, not 3"):
        draw({str(n): PAIR["hierarchical"] for n in range(3)})
