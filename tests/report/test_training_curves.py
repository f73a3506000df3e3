"""The learning curves: what is drawn is what the rows say."""

import numpy as np
import pytest
from fabricate import make_training

from lanewise.errors import LanewiseError
from lanewise.report import figure_style as style
from lanewise.report import training_curves
from lanewise.report.training_curves import draw, draw_stages


def means(rows, column, window, factor=1.0):
    """Running means by their definition, one at a time."""
    values = [factor * float(row[column]) for row in rows]
    return [np.mean(values[max(0, n - window) : n]) for n in range(1, len(values) + 1)]


def lines(axes, own):
    """Lines drawn in a style, curves first, then the edges of the band."""
    found = [line for line in axes.lines if line.get_color() == own.colour]
    return sorted(found, key=lambda line: -line.get_linewidth())


def test_curves_and_bands_are_mean_lowest_and_highest_of_the_running_means():
    seeds = make_training((70, 60, 90))
    figure = draw({"hierarchical": seeds})
    columns = (("escaped", 100.0), ("success", 100.0), ("reward", 1.0), ("speed", 1.0))
    for axes, (column, factor) in zip(figure.axes, columns, strict=True):
        table = [means(rows, column, 50, factor)[:60] for rows in seeds]
        curve, low, high = lines(axes, style.STYLES[1])
        for line in (curve, low, high):
            np.testing.assert_array_equal(line.get_xdata(), np.arange(1, 61))
        np.testing.assert_allclose(curve.get_ydata(), np.mean(table, axis=0))
        np.testing.assert_allclose(low.get_ydata(), np.min(table, axis=0))
        np.testing.assert_allclose(high.get_ydata(), np.max(table, axis=0))
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
    for axes in draw(arms, settled={"a": 20.0, "b": 41.0}).axes:
        marks = [line for line in axes.lines if line.get_marker() != "None"]
        curve = lines(axes, style.STYLES[0])[0]
        (mark,) = marks  # b ended before its epsilon settled
        assert list(mark.get_xdata()) == [20.0]
        assert mark.get_ydata()[0] == pytest.approx(curve.get_ydata()[19])


def test_each_stage_has_its_own_line_style_and_mark(rows):
    panel = draw_stages(rows).axes[1]
    thick = [line for line in panel.lines if line.get_linewidth() > 1.5]
    assert [line.get_label() for line in thick] == ["single-level", "high-level", "hierarchical"]
    assert len({line.get_linestyle() + line.get_color() for line in thick}) == 3
    assert len([line for line in panel.lines if list(line.get_xdata()) == [32000.0] * 2]) == 3
    np.testing.assert_allclose(thick[1].get_ydata(), means(rows[100:200], "success_rate", 5, 100.0))
    draw_stages(rows[:1])


@pytest.mark.parametrize(
    ("arms", "message"),
    [
        ({}, "no training"),
        ({"a": []}, "a: a training without a finished episode"),
        ({"a": [*make_training((5,)), []]}, "without a finished episode"),
    ],
)
def test_what_cannot_be_drawn_is_refused(arms, message):
    with pytest.raises(LanewiseError, match=message):
        draw(arms)
    with pytest.raises(LanewiseError, match="no metrics"):
        draw_stages([])
