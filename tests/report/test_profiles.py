"""The profiles: means and bands of those still driving, and accidents where they happened."""

import dataclasses

import numpy as np
import pytest
from fabricate import make_recording
from looking import check_words

from lanewise.errors import LanewiseError
from lanewise.report import figure_style as style
from lanewise.report.profiles import draw


def episodes(*ends, accident=1):
    """Recordings of different speeds, with an accident at each of the times given."""
    runs = [make_recording(seconds=20.0), make_recording(seconds=20.0)]
    runs += [make_recording(accident=accident, seconds=end) for end in ends]
    shifted = []
    for number, run in enumerate(runs):
        reward, accumulated = run.reward + 0.01 * number, run.accumulated_reward + 0.1 * number
        if run.accident:
            reward[-1] = -10.0
            accumulated[-1] = accumulated[-2] - 10.0
        shifted.append(
            dataclasses.replace(
                run, speed=run.speed + number, reward=reward, accumulated_reward=accumulated
            )
        )
    return shifted


def curve_of(axes):
    (line,) = [line for line in axes.lines if line.get_linewidth() == style.DRAWN]
    return line


def crosses(axes):
    return [
        (float(line.get_xdata()[0]), float(line.get_ydata()[0]))
        for line in axes.lines
        if line.get_marker() == "x"
    ]


def test_curves_are_means_over_the_episodes_still_under_way():
    runs = episodes(4.0, 6.5)
    speed, instant, accumulated = draw({"a": runs}).axes
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
    runs = episodes(4.0, 6.5)
    speed, instant, accumulated = draw({"a": runs}).axes
    ends = [(run.time[-1], run.speed[-1, 0]) for run in runs[2:]]
    np.testing.assert_allclose(crosses(speed), ends)
    sums = [(run.time[-1], run.accumulated_reward[-1]) for run in runs[2:]]
    np.testing.assert_allclose(crosses(accumulated), sums)
    assert crosses(instant) == []
    assert instant.get_ylim()[0] > -1.0  # the penalty does not squash the rewards of driving
    check_words(draw({"a": runs}))
    assert crosses(draw({"a": episodes(6.5)}, seconds=6.0).axes[0]) == []


def test_an_arm_ends_with_its_shortest_recording_that_had_no_accident():
    runs = [make_recording(seconds=9.0), make_recording(seconds=12.0)]
    assert curve_of(draw({"a": runs}).axes[0]).get_xdata()[-1] == 9.0
    lost = [make_recording(accident=2, seconds=end) for end in (3.0, 5.0)]
    assert curve_of(draw({"a": lost}).axes[0]).get_xdata()[-1] == 5.0
    assert curve_of(draw({"a": runs}, seconds=4.0).axes[0]).get_xdata()[-1] == 4.0


@pytest.mark.parametrize(
    ("arms", "message"),
    [
        ({}, "no recording"),
        ({"a": []}, "a: there is no recording"),
        (
            {
                "a": [
                    make_recording(),
                    dataclasses.replace(make_recording(), time=np.arange(51) / 4.0),
                ]
            },
            "different decision rates",
        ),
    ],
)
def test_what_cannot_be_drawn_is_refused(arms, message):
    with pytest.raises(LanewiseError, match=message):
        draw(arms)
