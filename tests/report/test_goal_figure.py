"""The goals figure: which goal stood when, and how each ended."""

import numpy as np
import pytest
from fabricate import make_recording
from looking import check_words

from lanewise.errors import LanewiseError
from lanewise.report import goal_figure
from lanewise.report.goal_figure import GOAL, REACHED, SET, TIMED_OUT, draw


def marks(axes, look):
    (line,) = [
        line
        for line in axes.lines
        if line.get_marker() == look["marker"] and line.get_color() == look["color"]
    ]
    return np.column_stack(line.get_data()).tolist()


def test_events_fall_on_the_decision_that_noticed_them(recording):
    """The made-up goals change in the frames that end at 3 s and at 9 s."""
    found = goal_figure.events(recording)
    assert recording.time[found.set].tolist() == [0.0, 2.5, 8.5]
    assert recording.time[found.timed_out].tolist() == [2.5]
    assert recording.time[found.reached].tolist() == [8.5]


def test_tracks_and_marks_are_the_recording(recording):
    across, speed = draw(recording).axes
    for axes, goal, ego in (
        (across, recording.lane_centre[recording.goal_lane], recording.y[:, 0]),
        (speed, recording.goal_speed, recording.speed[:, 0]),
    ):
        by_style = {
            line.get_drawstyle(): line for line in axes.lines if len(line.get_xdata()) == 51
        }
        np.testing.assert_array_equal(by_style["steps-pre"].get_ydata(), goal)
        np.testing.assert_array_equal(by_style["default"].get_ydata(), ego)
        assert by_style["steps-pre"].get_color() == GOAL.colour
        assert marks(axes, SET) == [[0.0, goal[1]], [2.5, goal[6]], [8.5, goal[18]]]
        assert marks(axes, TIMED_OUT) == [[2.5, ego[5]]]
        assert marks(axes, REACHED) == [[8.5, ego[17]]]


def test_an_accident_is_named_and_marked():
    crashed = make_recording(accident=1, seconds=12.0)
    figure = draw(crashed)
    assert "collision" in [text.get_text() for text in figure.legends[0].get_texts()]
    for axes, height in zip(figure.axes, (crashed.y[-1, 0], crashed.speed[-1, 0]), strict=True):
        assert marks(axes, {"marker": "X", "color": "black"}) == [[12.0, height]]
    check_words(figure)


@pytest.mark.parametrize(
    ("recording", "message"),
    [
        (make_recording(goals=False), "hierarchical sets no goals"),
        (make_recording(seconds=0.0), "without a decision"),
    ],
)
def test_what_cannot_be_drawn_is_refused(recording, message):
    with pytest.raises(LanewiseError, match=message):
        draw(recording)
