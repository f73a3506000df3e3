"""The report folder, and what a missing package or a hostile string does to it."""

import importlib
import json
import sys

import pytest
from fabricate import make_recording

from lanewise.errors import LanewiseError
from lanewise.evaluation.metrics import Paired, summarise
from lanewise.report import escape, extras, files, report


@pytest.fixture
def full(episodes, rows):
    return report.Report(
        title="Quick | reproduction",
        command="lanewise reproduce --out 'a`b'",
        summaries=[summarise(episodes, controller="hierarchical", world="lanewise")],
        settings={"scenario.trap_speed": 10.0, "odd|name": "<b>`x`"},
        curves=rows,
        recording=make_recording(seconds=1.0),
        paired={"hierarchical": Paired(100, (3, 7))},
        notes=["Fell short: <script>alert(1)</script>"],
        times={"training": 12.345},
        machine={"accelerator": float("nan")},
    )


def test_folder_is_complete(tmp_path, full):
    path = report.write_report(tmp_path / "out", full)
    names = sorted(p.name for p in path.parent.iterdir())
    assert names == ["clip.gif", "curves.png", "curves.svg", "report.json", "report.md"]
    for name in ("curves.png", "clip.gif"):
        assert f"({name})" in path.read_text()


def test_markdown_tells_how_it_was_made(tmp_path, full):
    words = report.write_report(tmp_path, full).read_text()
    assert "98.00 % of 100 outcomes identical; different at start 3, 7" in words
    assert "numpy" in words
    assert "12.3 s" in words
    assert "scenario.trap\\_speed" in words


def test_strings_are_escaped(tmp_path, full):
    words = report.write_report(tmp_path, full).read_text()
    assert "# Quick \\| reproduction" in words
    assert "\\<script\\>" in words
    assert "| odd\\|name | `` <b>`x` `` |" in words
    assert "``lanewise reproduce --out 'a`b'``" in words


def test_json_is_strict_and_repeatable(tmp_path, full):
    report.write_report(tmp_path, full)

    def refuse(word):
        raise AssertionError(word)

    stored = json.loads((tmp_path / "report.json").read_text(), parse_constant=refuse)
    assert stored["command"] == full.command
    assert stored["machine"]["accelerator"] is None
    assert stored["settings"]["scenario.trap_speed"] == 10.0
    assert stored["tests"][1]["success_rate"] == pytest.approx(293 / 300)
    assert stored["versions"]["python"]
    assert stored["date"].endswith("+00:00")


def test_tables_alone_need_no_figures(tmp_path, episodes, monkeypatch):
    monkeypatch.setitem(sys.modules, "PIL", None)
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    summaries = [summarise(episodes, controller="hierarchical", world="lanewise")]
    path = report.write_report(tmp_path, report.Report("Title", "command", summaries))
    assert "![" not in path.read_text()


@pytest.mark.parametrize(
    ("part", "package"), [("scene", "PIL"), ("clip", "PIL"), ("curves", "matplotlib")]
)
def test_missing_package_says_what_to_install(monkeypatch, part, package):
    monkeypatch.setitem(sys.modules, package, None)
    for name in [name for name in sys.modules if name.startswith("lanewise.report.")]:
        if name.endswith(("scene", "clip", "curves", "style")):
            monkeypatch.delitem(sys.modules, name)
    with pytest.raises(LanewiseError, match=r'pip install "lanewise\[report\]"'):
        importlib.import_module(f"lanewise.report.{part}")


def test_check_of_extras(monkeypatch):
    extras.check()
    monkeypatch.setattr(extras, "find_spec", lambda name: None)
    with pytest.raises(LanewiseError, match=r"lanewise\[report\]"):
        extras.check()


@pytest.mark.parametrize("value", ["`", "``a`", "", " x ", "a\nb|c"])
def test_code_keeps_one_line_and_closes(value):
    shown = escape.code(value)
    assert "\n" not in shown
    fence = shown[: len(shown) - len(shown.lstrip("`"))]
    assert shown.endswith(fence)


def test_failed_text_leaves_no_trace(tmp_path):
    path = tmp_path / "t.txt"
    path.write_text("old")

    def fails():
        with files.replacing(path) as beside:
            beside.write_text("half")
            raise OSError(28, "No space left on device")

    with pytest.raises(LanewiseError, match="No space left"):
        fails()
    assert path.read_text() == "old"
    assert list(tmp_path.iterdir()) == [path]


def test_csv_file(tmp_path, episodes):
    files.write_csv(tmp_path / "e.csv", episodes)
    assert len((tmp_path / "e.csv").read_text().splitlines()) == 301
