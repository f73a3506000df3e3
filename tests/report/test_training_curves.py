"""The training figure: what is drawn is what the rows say."""

import numpy as np
import pytest
from fabricate import make_training
from looking import check_words

from lanewise.errors import LanewiseError
from lanewise.report import style, training_curves
from lanewise.report.training_curves import draw


def means(rows, column, window, factor=1.0):
    """Running means by their definition, one at a time."""
    values = [factor * float(row[column]) for row in rows]
    return [np.mean(values[max(0, n - window) : n]) for n in range(1, len(values) + 1)]


def lines(axes, own):
    """Lines drawn in a style, curves first, then the edges of the band."""
    found = [line for line in axes.lines if line.get_color() == own.colour]
    return sorted(found, key=lambda line: -line.get_linewidth())


@pytest.mark.parametrize("reward", ["reward", "timestep_reward"])
def test_curves_and_bands_are_mean_lowest_and_highest_of_the_running_means(reward):
    seeds = make_training((70, 60, 90))
    figure = draw({"hierarchical": seeds}, window=7, reward=reward)
    columns = (("escaped", 100.0), ("success", 100.0), (reward, 1.0), ("speed", 1.0))
    for axes, (column, factor) in zip(figure.axes, columns, strict=True):
        table = [means(rows, column, 7, factor)[:60] for rows in seeds]
        curve, low, high = lines(axes, style.STYLES[1])
        for line in (curve, low, high):
            np.testing.assert_array_equal(line.get_xdata(), np.arange(1, 61))
        np.testing.assert_allclose(curve.get_ydata(), np.mean(table, axis=0))
        np.testing.assert_allclose(low.get_ydata(), np.min(table, axis=0))
        np.testing.assert_allclose(high.get_ydata(), np.max(table, axis=0))
        (band,) = axes.collections
        np.testing.assert_allclose(band.get_paths()[0].get_extents().y1, np.max(table))


def without_escapes(seeds):
    """As a training from before the paper's success stood beside ours left them."""
    return [[{n: v for n, v in row.items() if n != "escaped"} for row in rows] for rows in seeds]


def test_the_papers_success_is_drawn_above_ours_as_far_as_the_rows_tell_it():
    labels = [axes.get_ylabel().split("\n")[0] for axes in draw({"a": make_training()}).axes]
    assert labels == ["success (paper), %", "success, %", "reward per episode,", *labels[3:]]
    old = without_escapes(make_training())
    assert [a.get_ylabel().split("\n")[0] for a in draw({"a": old}).axes] == labels[1:]
    both = draw({"a": old, "b": make_training()}, settled={"a": 20.0, "b": 20.0})
    papers, ours = both.axes[:2]
    assert np.isnan(lines(papers, style.STYLES[0])[0].get_ydata()).all()
    assert np.isfinite(lines(papers, style.STYLES[1])[0].get_ydata()).all()
    assert np.isfinite(lines(ours, style.STYLES[0])[0].get_ydata()).all()
    check_words(both)


def test_each_arm_ends_with_its_shortest_seed():
    axes = draw({"a": make_training((30, 40)), "b": make_training((50,))}).axes[0]
    assert lines(axes, style.STYLES[0])[0].get_xdata()[-1] == 30
    assert lines(axes, style.STYLES[1])[0].get_xdata()[-1] == 50


def test_one_seed_has_no_band():
    figure = draw({"a": make_training((30,))})
    assert not any(axes.collections for axes in figure.axes)
    labels = [text.get_text() for text in figure.legends[0].get_texts()]
    assert labels == ["a (1 seed)"]


def test_long_trainings_are_thinned_evenly_and_keep_their_end():
    places = training_curves.drawn_places(4273)
    assert len(places) <= training_curves.POINTS
    assert places[-1] == 4272
    assert len(set(np.diff(places))) == 1
    np.testing.assert_array_equal(training_curves.drawn_places(1000), np.arange(1000))


def test_the_mark_stands_on_the_curve_where_epsilon_settled():
    arms = {"a": make_training((60, 60)), "b": make_training((40,))}
    figure = draw(arms, settled={"a": 20.0, "b": 41.0})
    for axes in figure.axes:
        marks = [line for line in axes.lines if line.get_marker() != "None"]
        curve = lines(axes, style.STYLES[0])[0]
        (mark,) = marks  # b ended before its epsilon settled
        assert list(mark.get_xdata()) == [20.0]
        assert mark.get_ydata()[0] == pytest.approx(curve.get_ydata()[19])


def test_a_missing_value_is_a_gap_not_a_mean_over_fewer_seeds():
    seeds = make_training((30, 30))
    for row in seeds[0][:5]:
        row["reward"] = None
    curve = lines(draw({"a": seeds}, window=3).axes[2], style.STYLES[0])[0]
    assert np.isnan(curve.get_ydata()[:5]).all()
    assert np.isfinite(curve.get_ydata()[5:]).all()


@pytest.mark.parametrize(
    ("arms", "more", "message"),
    [
        ({}, {}, "no training"),
        ({"a": []}, {}, "a: a training without a finished episode"),
        ({"a": [*make_training((5,)), []]}, {}, "without a finished episode"),
        ({"a": make_training((5,))}, {"settled": {"b": 3.0}}, "b: no such training"),
        ({"a": make_training((5,))}, {"window": 0}, "at least one episode"),
        ({"a": make_training((5,))}, {"reward": "speed"}, "reward or timestep_reward"),
    ],
)
def test_what_cannot_be_drawn_is_refused(tmp_path, arms, more, message):
    with pytest.raises(LanewiseError, match=message) as error:
        training_curves.write(arms, tmp_path / "a.png", **more)
    assert "\n" not in str(error.value)
    assert not list(tmp_path.iterdir())
