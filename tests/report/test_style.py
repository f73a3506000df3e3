"""The shared look: which style whose, and files that depend on nothing but their data."""

import matplotlib
import pytest
from fabricate import make_recording, make_training
from looking import check_words
from matplotlib import cbook
from matplotlib.figure import Figure
from PIL import Image

from lanewise.config.settings import Settings
from lanewise.errors import LanewiseError
from lanewise.report import (
    film_strip,
    framework,
    goal_track,
    profiles,
    start_ranges,
    style,
    training_curves,
    trap_schematic,
    two_steps,
)

RECORDINGS = {"single-level": make_recording(goals=False), "hierarchical": make_recording()}
FIGURES = {
    "training": (training_curves, {"single-level": make_training()}),
    "profiles": (profiles, {title: [one] for title, one in RECORDINGS.items()}),
    "strip": (film_strip, RECORDINGS),
    "goals": (goal_track, RECORDINGS["hierarchical"]),
    "trap": (trap_schematic, Settings().scenario),
    "starts": (start_ranges, Settings().scenario),
    "framework": (framework, Settings()),
    "two steps": (two_steps, Settings()),
}


def test_controllers_keep_their_style_and_others_take_what_is_left():
    alone = style.styles(["hierarchical"])
    among = style.styles(["mine", "h-DQN", "hierarchical", "yours"])
    assert alone["hierarchical"] == among["hierarchical"] == style.STYLES[1]
    assert among["mine"] == style.STYLES[0]
    assert among["yours"] == style.STYLES[2]
    assert len(set(among.values())) == 4


def test_styles_differ_in_colour_in_dashes_and_in_marker():
    for column in zip(*style.STYLES, strict=True):
        assert len(set(column)) == len(style.STYLES)


def test_more_curves_than_can_be_told_apart_are_refused():
    with pytest.raises(LanewiseError, match="7 curves apart, not 8"):
        style.styles([str(number) for number in range(8)])


def test_a_wrong_suffix_is_refused_before_anything_is_drawn(tmp_path):
    def never() -> Figure:
        raise AssertionError

    with pytest.raises(LanewiseError, match=r"\.png or \.svg"):
        style.write(tmp_path / "a.pdf", never)
    assert not list(tmp_path.iterdir())


def test_a_dollar_in_a_title_is_a_dollar():
    arms = {"costs $5 or $x^2$": make_training()}
    label = training_curves.draw(arms).legends[0].get_texts()[0].get_text()
    assert label == r"costs \$5 or \$x^2\$ (2 seeds)"
    assert not cbook.is_math_text(label)


@pytest.mark.parametrize("name", FIGURES)
def test_every_figure_in_both_formats(tmp_path, name):
    """The same data give the same bytes, whatever the user's own settings; words stand apart."""
    module, data = FIGURES[name]
    check_words(module.draw(data))
    module.write(data, tmp_path / "a.png")
    module.write(data, tmp_path / "a.svg")
    before = dict(matplotlib.rcParams)
    with matplotlib.rc_context({"font.size": 20.0, "text.color": "red", "savefig.dpi": 50}):
        module.write(data, tmp_path / "b.svg")
    assert dict(matplotlib.rcParams) == before
    image = Image.open(tmp_path / "a.png")
    assert image.width == round(style.WIDTH * style.DPI)
    vector = (tmp_path / "a.svg").read_text(encoding="utf-8")
    assert vector == (tmp_path / "b.svg").read_text(encoding="utf-8")
    assert "dc:date" not in vector
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a.png", "a.svg", "b.svg"]
