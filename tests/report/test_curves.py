"""The learning-curve figure and the small sums behind it."""

import xml.etree.ElementTree as ElementTree

import numpy as np
import pytest
from PIL import Image

from lanewise.errors import LanewiseError
from lanewise.report import curves


def test_running_mean_by_hand():
    values = np.array([np.nan, 2.0, 4.0, np.nan, 9.0])
    smooth = curves.running_mean(values, 2)
    np.testing.assert_array_equal(smooth, [np.nan, 2.0, 3.0, 4.0, 9.0])


def test_png_and_svg(tmp_path, rows):
    curves.write_curves(rows, tmp_path / "c.png")
    curves.write_curves(rows, tmp_path / "c.svg", against="episodes")
    assert Image.open(tmp_path / "c.png").width > 1000
    words = "".join(ElementTree.parse(tmp_path / "c.svg").getroot().itertext())
    for label in ("success (paper), %", "average speed, m/s", "episodes of the stage"):
        assert label in words
    assert "high-level" in words
    assert sorted(p.name for p in tmp_path.iterdir()) == ["c.png", "c.svg"]


def test_same_rows_same_file(tmp_path, rows):
    for name in ("a.svg", "b.svg"):
        curves.write_curves(rows, tmp_path / name)
    assert (tmp_path / "a.svg").read_bytes() == (tmp_path / "b.svg").read_bytes()


def test_each_stage_has_its_own_line_style_and_mark(rows):
    panel = curves.draw(rows).axes[0]
    thick = [line for line in panel.lines if line.get_linewidth() > 1.5]
    assert [line.get_label() for line in thick] == ["single-level", "high-level", "hierarchical"]
    assert len({line.get_linestyle() + line.get_color() for line in thick}) == 3
    assert len([line for line in panel.lines if list(line.get_xdata()) == [32000.0] * 2]) == 3


def test_rows_from_before_both_successes_have_ours_alone(rows):
    def labels():
        return [axes.get_ylabel().split("\n")[0] for axes in curves.draw(rows).axes]

    assert labels()[:2] == ["success (paper), %", "success, %"]
    for row in rows:
        del row["escape_rate"]
    assert labels() == ["success, %", "reward per episode,", "average speed, m/s"]


def test_one_row_is_enough(tmp_path, rows):
    curves.write_curves(rows[:1], tmp_path / "c.png")


def test_nothing_to_draw_and_wrong_suffix_are_refused(tmp_path, rows):
    with pytest.raises(LanewiseError, match="no metrics"):
        curves.write_curves([], tmp_path / "c.png")
    with pytest.raises(LanewiseError, match=r"\.png or \.svg"):
        curves.write_curves(rows, tmp_path / "c.jpg")
    assert not list(tmp_path.iterdir())
