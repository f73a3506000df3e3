"""A sweep on disk: its map, its page and every start."""

import json
import re
from xml.etree import ElementTree

import pytest
from fabricate import make_sweep
from PIL import Image

from lanewise.evaluation.grid import Grid, fold, pool
from lanewise.report import sweep_map, sweep_page
from lanewise.report.sweep_map import MapAxes

SMALL = Grid((8.0, 13.0), (8.0, 9.0), (3, 4), (14.8, 16.44), (4.06,))


def drawn(grid=SMALL):
    return sweep_map.draw(make_sweep(grid).cells, MapAxes())


def test_every_field_shows_its_share_of_winnable_starts():
    panels = [axes for axes in drawn().axes if axes.patches]
    assert len(panels) == 4
    for row, rate in ((0, "success_rate"), (1, "accident_rate")):
        for column, lanes in enumerate((3, 4)):
            axes = panels[2 * row + column]
            cells = [cell for cell in make_sweep(SMALL).cells if cell.point.lanes == lanes]
            groups = fold(cells, "ego_speed", "trap_speed").values()
            shares = [share for own in groups if (share := pool(own, "winnable")).episodes]
            shown = [text.get_text() for text in axes.texts]
            wanted = [sweep_map.figure_of(100.0 * getattr(share, rate)) for share in shares]
            assert [text for text in shown if "/" not in text] == wanted
            # At 13 m/s: none of two starts behind 8 m/s, one of two behind 9 m/s can be won.
            assert [text for text in shown if "/" in text] == ["1/2"]
            assert len([patch for patch in axes.patches if patch.get_hatch()]) == 2


@pytest.mark.parametrize(
    ("percent", "text"), [(0.0, "0"), (100.0, "100"), (99.97, "99.9"), (0.02, "0.1")]
)
def test_only_all_and_nothing_are_written_as_such(percent, text):
    assert sweep_map.figure_of(percent) == text


def test_a_sweep_on_disk(tmp_path):
    sweep = make_sweep(Grid((8.0, 13.0), (8.0, 9.0), (3,), (14.8, 16.44), (4.06,), (17.0, 25.0)))
    page = sweep_page.write_sweep(tmp_path, sweep)
    names = {path.name for path in tmp_path.iterdir()}
    maps = {f"{name}.{kind}" for name in sweep_page.MAPS for kind in ("png", "svg")}
    assert names == maps | {"map.json", "map.md"}
    document = json.loads((tmp_path / "map.json").read_text())
    rows = [dict(zip(document["columns"], row, strict=True)) for row in document["starts"]]
    assert [row["successes"] for row in rows] == [cell.outcome.successes for cell in sweep.cells]
    assert [row["spacing"] for row in rows] == [cell.point.spacing for cell in sweep.cells]
    assert document["totals"]["all"]["starts"] == 16
    assert document["totals"]["all"]["escapes"] == sum(c.outcome.escapes for c in sweep.cells)
    # 13 behind 8: none of 4; 13 behind 9: the two with the longer D1, without clearance.
    assert document["totals"]["winnable"]["starts"] == 10
    assert document["totals"]["winnable_with_clearance"]["starts"] == 8
    assert document["axes"]["spacing"] == [17.0, 25.0]
    assert document["trained_by"] == sweep.trained_by
    assert document["settings"]["scenario.trap_speed"] == 10.0
    text = page.read_text()
    assert set(re.findall(r"\]\((.*?)\)", text)) <= names
    assert "| over | starts | episodes | success (paper) | success | accidents |" in text
    assert "| winnable starts | 10 | 200 |" in text
    assert "spacing: 17, 25" in text
    with Image.open(tmp_path / "map.png") as image:
        assert image.width > 400
    assert ElementTree.parse(tmp_path / "map.svg").getroot().tag.endswith("svg")


def test_the_same_cells_give_the_same_files_and_one_traffic_no_map_of_it(tmp_path):
    for name in ("a", "b"):
        sweep = make_sweep(Grid((8.0,), (8.0,), (3,), (14.8,), (4.06, 5.0)))
        sweep_page.write_sweep(tmp_path / name, sweep)
    names = {path.name for path in (tmp_path / "a").iterdir()}
    assert "map-distances.png" in names
    assert "map-traffic.png" not in names
    for name in names - {"map.json", "map.md"}:  # these two have a date
        assert (tmp_path / "a" / name).read_bytes() == (tmp_path / "b" / name).read_bytes()
