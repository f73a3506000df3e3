"""Conditions on disk: every figure of the page and the map is one of the cells'."""

import json
import re
import shlex

import pytest

from fabricate import make_robust
from lanewise.cli import watch_command
from lanewise.cli.command_line import parse
from lanewise.evaluation.cells import KINDS
from lanewise.evaluation.conditions import HORIZONS, JUDGED, ConditionGrid
from lanewise.evaluation.statistics import clopper_pearson
from lanewise.report import robust_map, robust_page, robust_tables
from lanewise.report.sweep_result import figure_of

GRID = ConditionGrid(
    population=("paper", "timid", "highd"),
    density=("empty", "light", "dense"),
    speeds=((12.0, 10.0), (13.0, 11.0)),
    lanes=(2, 3),
    noise=(0.0, 0.05),
    latency=(0.0,),
)
RESULT = make_robust(GRID)


@pytest.fixture(scope="module")
def written(tmp_path_factory):
    """(the document, the page) of a result on disk."""
    folder = tmp_path_factory.mktemp("robust")
    page = robust_page.write(folder, RESULT)
    names = sorted(path.name for path in folder.iterdir())
    assert names == ["robust.json", "robust.md", "robust.png", "robust.svg"]
    return json.loads((folder / "robust.json").read_text()), page.read_text()


def test_the_rows_hold_every_cell_and_the_totals_add_them_up(written):
    document, _ = written
    rows = [dict(zip(document["columns"], row, strict=True)) for row in document["cells"]]
    assert len(rows) == (1 + 3 * 2) * 4 * 2
    assert sum(row["winnable"] is True for row in rows) == len(rows) / 4
    assert all((row["winnable"] is None) == (row["lanes"] == 2) for row in rows)
    sorts = {"nobody": "no traffic", "paper": "seen in training"}
    by_sort = document["totals_by_sort"]
    assert set(by_sort) == {"seen in training", "held out", "no traffic"}
    for sort, totals in [*by_sort.items(), ("all", document["totals"])]:
        own = [r for r in rows if sort in (sorts.get(r["population"], "held out"), "all")]
        for seconds in HORIZONS:
            total = totals[str(seconds)]
            hits = sum(row[f"{kind}_{seconds}"] for row in own for kind in KINDS)
            assert total["all"]["accidents"] == hits == sum(total["all"]["kinds"].values())
            assert total["all"]["accidents_interval"] == pytest.approx(
                clopper_pearson(hits, 20 * len(own))
            )
            won = sum(row[f"successes_{seconds}"] for row in own if row["winnable"])
            assert total["winnable"]["successes"] == won
    by_population = document["totals_by_population"]
    assert (
        sum(by_population[name]["60"]["all"]["accidents"] for name in by_population)
        == (document["totals"]["60"]["all"]["accidents"])
    )
    assert document["seen_in_training"] == ["paper"]
    assert document["horizons"] == list(HORIZONS)
    assert document["trained_by"] == RESULT.trained_by


def rows_of(page, heading):
    """Cells of the first table after a heading."""
    text = page[page.index(heading) :]
    lines = re.search(r"(?:^\|.*\n?)+", text, re.MULTILINE)[0].splitlines()
    return [[cell.strip() for cell in line.strip("|").split("|")] for line in lines[2:]]


def test_the_tables_hold_the_pooled_shares(written):
    document, page = written
    by_population = {row[0]: row for row in rows_of(page, "## By population")}
    assert set(by_population) == {"nobody", "paper", "timid", "highd"}
    for name, row in by_population.items():
        totals = document["totals_by_population"][name]
        rates = [totals[str(seconds)]["all"]["accidents_rate"] for seconds in HORIZONS]
        rates += [
            totals[str(seconds)]["winnable"][f"{outcome}_rate"]
            for outcome in ("escapes", "successes")
            for seconds in HORIZONS
        ]
        assert row[3:] == [figure_of(100.0 * rate) for rate in rates]
    lanes = {row[0]: row for row in rows_of(page, "## By lanes")}
    assert lanes["2"][-1] == "-"  # in two lanes nothing can be won
    kinds = rows_of(page, "## Accidents by kind")
    assert kinds[-1][0] == "any"
    rate = document["totals"]["60"]["all"]["accidents_rate"]
    assert kinds[-1][2] == figure_of(100.0 * rate)


def test_the_worst_cells_come_first_and_can_be_watched(written):
    _, page = written
    ranked = robust_tables.ranked(RESULT.cells)
    hits = [cell.outcome.at(JUDGED).accidents for cell in ranked]
    assert hits == sorted(hits, reverse=True)
    lines = re.findall(r"^\d+\. `(.*)`$", page, re.MULTILINE)
    assert len(lines) == robust_tables.WORST
    for line, cell in zip(lines, ranked, strict=False):
        words = shlex.split(line)
        assert words[:3] == ["lanewise", "watch", "runs/h0"]
        watch = parse(watch_command.Watch, words[2:]).command
        own = {n: v for n, v in cell.place.settings.items() if v != RESULT.settings[n]}
        assert watch.test == own | {"evaluation.duration": HORIZONS[JUDGED]}
        assert (watch.episode, watch.seed) == (3, RESULT.seed)


def test_the_map_shows_every_field_once():
    figure = robust_map.draw(RESULT)
    maps = [axes for axes in figure.axes if axes.patches]
    assert len(maps) == 2
    fields = 2 + 3 * (2 * 2 + 1)
    for axes in maps:
        assert len(axes.patches) == fields
        # A number in each field, and above them the names of the densities.
        names = [text.get_text() for text in axes.texts][fields:]
        assert names == ["empty", "light", "dense", "all"]
        rows = [label.get_text() for label in axes.get_yticklabels()]
        assert rows == ["paper (seen)", "timid", "highd"]
    accidents = [text.get_text() for text in maps[0].texts][:fields]
    cells = [c for c in RESULT.cells if c.place.population == "highd"]
    hits = sum(cell.outcome.at(JUDGED).accidents for cell in cells)
    assert accidents[-1] == figure_of(100.0 * (hits / (20 * len(cells))))
    assert [text.get_text() for text in maps[1].texts][:fields].count("-") == 1 + 3 * 2


@pytest.mark.parametrize(
    "grid",
    [
        ConditionGrid(density=("empty",), lanes=(2,)),
        ConditionGrid(population=("timid",), density=("dense",), lanes=(5,), speeds=((10.0, 8.0),)),
    ],
)
def test_small_grids_have_a_page_too(grid, tmp_path, monkeypatch):
    monkeypatch.setattr(robust_page, "save", lambda figure, path: None)
    page = robust_page.write(tmp_path, make_robust(grid)).read_text()
    assert "## Accidents by kind" in page
