"""Files of a report, and what a missing package or a hostile string does to them."""

import importlib
import sys

import pytest

from lanewise.errors import LanewiseError, RunError
from lanewise.report import escape, extras, files, table


def test_names_and_values_are_escaped():
    words = table.listing({"odd|name": "<b>`x`", "scenario.trap_speed": 10.0})
    assert "| odd\\|name | `` <b>`x` `` |" in words
    assert "| scenario.trap\\_speed | `10.0` |" in words


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


def test_what_cannot_be_written_is_refused_beforehand(tmp_path):
    (tmp_path / "file").write_text("kept")
    for place, said in (
        (tmp_path / "file" / "a.csv", "Not a directory"),
        (tmp_path, "a folder has that name"),
    ):
        with pytest.raises(LanewiseError, match=f"cannot write .*{said}"):
            files.check_writable(place)
    files.check_writable(tmp_path / "new" / "folder" / "a.csv")
    assert [path.name for path in tmp_path.iterdir()] == ["file"]


@pytest.mark.parametrize("text", ['{"format": "lanewise-run"}', '{"format": "lanewise-run", "se'])
def test_nothing_is_written_into_a_run(tmp_path, text):
    """Be it damaged, and whatever name leads there."""
    run = tmp_path / "run"
    (run / "stages").mkdir(parents=True)
    (run / "run.json").write_text(text)
    (tmp_path / "link").symlink_to(run / "stages")
    for place in (run / "run.json", run / "new" / "a.csv", tmp_path / "link" / "a.csv"):
        for write in (files.check_writable, lambda place: files.write_text(place, "lost")):
            with pytest.raises(RunError, match=r"belongs to the run in .*/run; choose another"):
                write(place)
    assert (run / "run.json").read_text() == text
    assert {path.name for path in run.rglob("*")} == {"stages", "run.json"}


def test_a_run_json_of_something_else_is_no_run(tmp_path):
    (tmp_path / "run.json").write_text('{"runner": "mine"}')
    files.check_writable(tmp_path / "a.csv")


def test_one_file_holds_one_result(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(LanewiseError, match="is named for two results; give each its own file"):
        files.check_writable("a.md", tmp_path / "new" / ".." / "a.md")
    files.check_writable("a.md", "a.csv")


@pytest.mark.parametrize("name", ["x" * 251 + ".csv", "." + "x" * 254, "ä" * 125 + ".txt"])
def test_a_name_as_long_as_a_folder_bears_can_be_written(tmp_path, name):
    files.check_writable(tmp_path / name)
    files.write_text(tmp_path / name, "kept")
    assert (tmp_path / name).read_text() == "kept"
    assert len(list(tmp_path.iterdir())) == 1


def test_a_longer_name_is_refused_beforehand(tmp_path):
    for place in (tmp_path / ("x" * 256), tmp_path / ("x" * 256) / "a.csv"):
        with pytest.raises(LanewiseError, match=r"cannot write .*: File name too long"):
            files.check_writable(place)


def test_two_files_are_written_beside_under_names_of_their_own(tmp_path):
    with files.replacing(tmp_path / "a.gif") as one, files.replacing(tmp_path / "b.gif") as other:
        assert one != other
        assert {place.parent for place in (one, other)} == {tmp_path}
        assert {place.suffix for place in (one, other)} == {".gif"}
        for place in (one, other):
            assert place.name.startswith(".")
            place.write_text(place.name)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a.gif", "b.gif"]


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
