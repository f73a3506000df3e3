"""The shared look: which style whose, and files that depend on nothing but their data."""

import matplotlib
import pytest
from fabricate import make_recording, make_rows, make_training
from looking import check_words
from matplotlib import cbook
from PIL import Image

from lanewise.errors import LanewiseError
from lanewise.report import figure_style as style
from lanewise.report import film_strip, goal_figure, profiles, training_curves

RECORDINGS = {"single-level": make_recording(goals=False), "hierarchical": make_recording()}
FIGURES = {
    "training": (training_curves.draw, {"single-level": make_training()}),
    "stages": (training_curves.draw_stages, make_rows()),
    "profiles": (profiles.draw, {title: [one] for title, one in RECORDINGS.items()}),
    "strip": (film_strip.draw, RECORDINGS),
    "goals": (goal_figure.draw, RECORDINGS["hierarchical"]),
}


def test_controllers_keep_their_style_and_others_take_what_is_left():
    alone = style.styles(["hierarchical"])
    among = style.styles(["mine", "h-DQN", "hierarchical", "yours"])
    assert alone["hierarchical"] == among["hierarchical"] == style.STYLES[1]
    assert (among["mine"], among["yours"]) == (style.STYLES[0], style.STYLES[2])
    assert len(set(among.values())) == 4
    for column in zip(*style.STYLES, strict=True):  # colours, dashes, markers
        assert len(set(column)) == len(style.STYLES)
    with pytest.raises(LanewiseError, match="7 curves apart, not 8"):
        style.styles([str(number) for number in range(8)])


def test_a_dollar_in_a_title_is_a_dollar():
    arms = {"costs $5 or $x^2$": make_training()}
    label = training_curves.draw(arms).legends[0].get_texts()[0].get_text()
    assert label == r"costs \$5 or \$x^2\$ (2 seeds)"
    assert not cbook.is_math_text(label)


@pytest.mark.parametrize("name", FIGURES)
def test_every_figure_in_both_formats(tmp_path, name):
    """The same data give the same bytes, whatever the user's own settings; words stand apart."""
    draw, data = FIGURES[name]
    check_words(draw(data))
    style.save(draw(data), tmp_path / "a")
    before = dict(matplotlib.rcParams)
    with matplotlib.rc_context({"font.size": 20.0, "text.color": "red", "savefig.dpi": 50}):
        style.save(draw(data), tmp_path / "b")
    assert dict(matplotlib.rcParams) == before
    assert Image.open(tmp_path / "a.png").width == round(style.WIDTH * style.DPI)
    vector = (tmp_path / "a.svg").read_text(encoding="utf-8")
    assert vector == (tmp_path / "b.svg").read_text(encoding="utf-8")
    assert "dc:date" not in vector
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a.png", "a.svg", "b.png", "b.svg"]
