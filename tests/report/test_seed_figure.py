"""The figure of all seeds: every test is a dot where its number says."""

import numpy as np
from test_experiment_tables import FLAT, OURS, arm

from lanewise.report import figure_style as style
from lanewise.report import seed_figure

SEARCH = arm("search", "search", [100])


def dots(axes, own):
    """Values of the dots in a colour, row by row."""
    return [
        list(line.get_xdata())
        for line in axes.lines
        if line.get_color() == own.colour and line.get_marker() not in ("None", "")
    ]


def test_every_seed_is_a_dot_and_the_mean_a_line():
    figure = seed_figure.draw([OURS, FLAT, SEARCH], "lanewise")
    success = figure.axes[1]
    (ours,) = dots(success, style.STYLES[style.OWN["hierarchical"]])
    np.testing.assert_allclose(ours, [98, 99, 100, 100, 90])
    means = [line.get_xdata()[0] for line in success.lines if line.get_linewidth() == style.DRAWN]
    np.testing.assert_allclose(means, [97.4, 0.2, 100.0])
    names = [label.get_text() for label in figure.axes[0].get_yticklabels()]
    assert names == ["two levels", "flat | one", "search"]


def test_published_values_stand_beside_what_they_are_of():
    figure = seed_figure.draw([OURS, FLAT], "lanewise")
    papers, ours, reward = (
        sorted(line.get_xdata()[0] for line in axes.lines if line.get_linewidth() == 0.9)
        for axes in figure.axes
    )
    np.testing.assert_allclose(papers, [0.0, 97.67])
    assert ours == []
    np.testing.assert_allclose(reward, [3.32, 13.2])
