"""Files of a report, what a missing package does to them, and text made safe for them."""

import importlib
import json
import math
import sys

import numpy as np
import pytest

from lanewise.errors import LanewiseError, RunError
from lanewise.report import markup, output_files
from lanewise.system import extras


def test_what_json_knows_keeps_its_type():
    kept = {"a": [True, None, 3, 0.5, "x"], "b": math.nan}
    assert markup.finite(kept) == {"a": kept["a"], "b": None}
    numpy = [np.bool_(False), np.int32(3), np.float32(0.5), np.float64("inf")]
    assert json.dumps(markup.finite(numpy)) == "[false, 3, 0.5, null]"
    with pytest.raises(TypeError, match="ndarray"):
        markup.finite([np.zeros(2)])


@pytest.mark.parametrize(("part", "package"), [("training_curves", "matplotlib")])
def test_missing_package_says_what_to_install(monkeypatch, part, package):
    monkeypatch.setitem(sys.modules, package, None)
    for name in ("frame", "clip", "training_curves", "figure_style"):
        monkeypatch.delitem(sys.modules, f"lanewise.report.{name}", raising=False)
    with pytest.raises(LanewiseError, match=r'pip install "\.\[report\]" in your clone'):
        importlib.import_module(f"lanewise.report.{part}")
    with pytest.raises(LanewiseError, match=r"\.\[report\]"):
        extras.check()


@pytest.mark.parametrize(
    ("place", "said"),
    [
        ("file/a.csv", "Not a directory"),
        (".", "a folder has that name"),
        ("x" * 256, "File name too long"),
    ],
)
def test_what_cannot_be_written_is_refused_beforehand(tmp_path, place, said):
    (tmp_path / "file").write_text("kept")
    with pytest.raises(LanewiseError, match=f"cannot write .*{said}"):
        output_files.check_writable(tmp_path / place)
    output_files.check_writable(tmp_path / "new" / "folder" / "a.csv")
    assert [path.name for path in tmp_path.iterdir()] == ["file"]


def test_nothing_is_written_into_a_run(tmp_path):
    """Be it damaged, and whatever name leads there; a `run.json` of something else is no run."""
    run = tmp_path / "run"
    (run / "stages").mkdir(parents=True)
    (run / "run.json").write_text('{"format": "lanewise-run", "se')
    (tmp_path / "link").symlink_to(run / "stages")
    for place in (run / "run.json", run / "new" / "a.csv", tmp_path / "link" / "a.csv"):
        with pytest.raises(RunError, match=r"belongs to the run in .*/run; choose another"):
            output_files.check_writable(place)
        with pytest.raises(RunError, match="belongs to the run"):
            output_files.write_text(place, "lost")
    assert {path.name for path in run.rglob("*")} == {"stages", "run.json"}
    (tmp_path / "run.json").write_text('{"runner": "mine"}')
    output_files.check_writable(tmp_path / "a.csv")


def test_one_file_holds_one_result(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(LanewiseError, match="is named for two results; give each its own file"):
        output_files.check_writable("a.md", tmp_path / "new" / ".." / "a.md")
    output_files.check_writable("a.md", "a.csv")


def test_files_are_written_beside_and_a_failure_leaves_no_trace(tmp_path):
    path, other = tmp_path / "a.txt", tmp_path / "b.txt"
    path.write_text("old")

    def fails():
        with output_files.replacing(path) as beside, output_files.replacing(other) as second:
            assert beside != second
            assert (beside.parent, beside.suffix, beside.name[0]) == (tmp_path, ".txt", ".")
            beside.write_text("half")
            raise OSError(28, "No space left on device")

    with pytest.raises(LanewiseError, match="No space left"):
        fails()
    assert path.read_text() == "old"
    assert list(tmp_path.iterdir()) == [path]
