import dataclasses
import itertools
import json
import re
from xml.etree import ElementTree

import pytest
from PIL import Image
from sweeps import only, sweep_of

from lanewise.errors import LanewiseError
from lanewise.evaluation.grid import Grid, fold, pool
from lanewise.report import map as maps
from lanewise.report import sweep as files
from lanewise.report.map import View

SMALL = Grid((8.0, 13.0), (8.0, 9.0), (3, 4), (14.8, 16.44), (4.06,))


def texts_of(axes):
    return [text.get_text() for text in axes.texts]


def panels(figure):
    return [axes for axes in figure.axes if axes.patches]


def test_every_field_shows_its_share_of_winnable_starts():
    sweep = sweep_of(SMALL)
    figure = maps.draw(sweep.cells, View())
    drawn = panels(figure)
    assert len(drawn) == 4
    for row, rate in ((0, "success_rate"), (1, "accident_rate")):
        for column, lanes in enumerate((3, 4)):
            shown = texts_of(drawn[2 * row + column])
            shares = [
                pool(cells, "winnable")
                for cells in fold(
                    only(sweep, lanes=lanes).cells, "ego_speed", "trap_speed"
                ).values()
            ]
            wanted = [maps.figure_of(100.0 * getattr(s, rate)) for s in shares if s.episodes]
            assert [text for text in shown if "/" not in text] == wanted
            # At 13 m/s: none of two starts behind 8 m/s, one of two behind 9 m/s can be won.
            assert [text for text in shown if "/" in text] == ["1/2"]
            hatched = [patch for patch in drawn[2 * row + column].patches if patch.get_hatch()]
            assert len(hatched) == 2


def test_the_key_names_what_occurs():
    def key(grid):
        legend = maps.draw(sweep_of(grid).cells, View()).legends[0]
        return [text.get_text() for text in legend.get_texts()]

    assert key(SMALL) == ["some cannot be won (winnable/all)", "none can be won"]
    assert key(Grid((13.0,), (9.0,), (3,))) == ["some cannot be won (winnable/all)"]
    assert key(Grid((13.0,), (8.0, 10.0), (3,))) == ["none can be won"]


def test_nothing_is_hatched_where_all_can_be_won():
    sweep = sweep_of(Grid((8.0, 9.0), (9.0,), (3,), (14.8,), (4.06,)))
    figure = maps.draw(sweep.cells, View())
    assert not any(patch.get_hatch() for axes in figure.axes for patch in axes.patches)
    assert not figure.legends


def test_bright_is_good_in_both_rows():
    """Luma of the fields rises with success and falls with accidents."""
    figure = maps.draw(sweep_of(SMALL).cells, View())
    bars = [axes for axes in figure.axes if axes.get_label() == "<colorbar>"]
    assert [axes.get_ylabel() for axes in bars] == [label for label, _, _ in maps.ROWS]
    for (_, _, name), rising in zip(maps.ROWS, (True, False), strict=True):
        colours = maps.matplotlib.colormaps[name]
        luma = [0.299 * r + 0.587 * g + 0.114 * b for r, g, b, _ in map(colours, range(256))]
        steps = [b - a for a, b in itertools.pairwise(luma)]
        assert all(step > -1e-3 for step in steps) if rising else all(s < 1e-3 for s in steps)


@pytest.mark.parametrize(
    ("percent", "text"),
    [(0.0, "0"), (100.0, "100"), (99.97, "99.9"), (0.02, "0.1"), (50.0, "50.0"), (7.26, "7.3")],
)
def test_only_all_and_nothing_are_written_as_such(percent, text):
    assert maps.figure_of(percent) == text


def test_no_cells_and_wrong_names_are_refused(tmp_path):
    with pytest.raises(LanewiseError, match="no starts to draw"):
        maps.write_map([], tmp_path / "map.png")
    with pytest.raises(LanewiseError, match=r"must end in \.png or \.svg"):
        maps.write_map(sweep_of(SMALL).cells, tmp_path / "map.pdf")


def test_a_sweep_on_disk(tmp_path):
    sweep = sweep_of(Grid((8.0, 13.0), (8.0, 9.0), (3,), (14.8, 16.44), (4.06,), (17.0, 25.0)))
    page = files.write_sweep(tmp_path, sweep)
    names = {path.name for path in tmp_path.iterdir()}
    drawn = {f"{name}.{kind}" for name in files.VIEWS for kind in ("png", "svg")}
    assert names == drawn | {"map.json", "map.md"}
    document = json.loads((tmp_path / "map.json").read_text())
    assert files.cells_of(document) == list(sweep.cells)
    assert document["totals"]["all"]["starts"] == 16
    # 13 behind 8: none of 4; 13 behind 9: the two with the longer D1, without clearance.
    assert document["totals"]["winnable"]["starts"] == 10
    assert document["totals"]["winnable_with_clearance"]["starts"] == 8
    assert document["axes"]["spacing"] == [17.0, 25.0]
    assert document["trained_by"] == sweep.trained_by
    assert document["settings"]["scenario.trap_speed"] == 10.0
    text = page.read_text()
    for target in re.findall(r"\]\((.*?)\)", text):
        assert target in names
    assert "| winnable starts | 10 | 200 |" in text
    assert "spacing: 17, 25" in text
    with Image.open(tmp_path / "map.png") as image:
        assert image.width > 400
    assert ElementTree.parse(tmp_path / "map.svg").getroot().tag.endswith("svg")


def test_a_map_from_before_both_successes_is_read_and_the_papers_is_a_dash(tmp_path):
    sweep = sweep_of(SMALL)
    files.write_sweep(tmp_path, sweep)
    document = json.loads((tmp_path / "map.json").read_text())
    assert document["totals"]["all"]["escapes"] == sum(c.outcome.escapes for c in sweep.cells)
    told = files.table(sweep.cells).splitlines()
    assert told[0] == "| over | starts | episodes | success (paper) | success | accidents |"
    page = (tmp_path / "map.md").read_text()
    assert "| winnable starts | success (paper) | success | accidents |" in page
    place = document["columns"].index("escapes")
    document["columns"].pop(place)
    for row in document["starts"]:
        row.pop(place)
    old = files.cells_of(document)
    assert all(cell.outcome.escapes is None for cell in old)
    for new, row in zip(files.table(old).splitlines()[2:], told[2:], strict=True):
        cells, wanted = new.split("|"), row.split("|")
        assert cells == [*wanted[:4], " - ", *wanted[5:]]
    files.write_sweep(tmp_path / "again", dataclasses.replace(sweep, cells=old))
    assert re.search(r"\| 8 \| 8 \| 3 \| 2 \| - \| ", (tmp_path / "again/map.md").read_text())


def test_the_same_cells_give_the_same_picture(tmp_path):
    cells = sweep_of(SMALL).cells
    for name in ("a.svg", "b.svg", "a.png", "b.png"):
        maps.write_map(cells, tmp_path / name)
    for kind in ("svg", "png"):
        assert (tmp_path / f"a.{kind}").read_bytes() == (tmp_path / f"b.{kind}").read_bytes()


def test_a_map_of_one_traffic_leaves_its_picture_out(tmp_path):
    files.write_sweep(tmp_path, sweep_of(Grid((8.0,), (8.0,), (3,), (14.8,), (4.06, 5.0))))
    names = {path.name for path in tmp_path.iterdir()}
    assert "map-distances.png" in names
    assert "map-traffic.png" not in names
