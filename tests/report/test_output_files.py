"""Result files: whole or not at all, never into a run, and which code made them."""

import importlib
import json
import math
import subprocess
import sys

import numpy as np
import pytest

from lanewise.errors import LanewiseError, RunError
from lanewise.report import markup, output_files, provenance
from lanewise.system import extras, version


def test_what_json_knows_keeps_its_type():
    kept = {"a": [True, None, 3, 0.5, "x"], "b": math.nan}
    assert markup.finite(kept) == {"a": kept["a"], "b": None}
    numpy = [np.bool_(False), np.int32(3), np.float32(0.5), np.float64("inf")]
    assert json.dumps(markup.finite(numpy)) == "[false, 3, 0.5, null]"
    with pytest.raises(TypeError, match="ndarray"):
        json.dumps(markup.finite([np.zeros(2)]))


def test_missing_package_says_what_to_install(monkeypatch):
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    for name in ("training_curves", "figure_style"):
        monkeypatch.delitem(sys.modules, f"lanewise.report.{name}", raising=False)
    with pytest.raises(LanewiseError, match=r'pip install "\.\[report\]" in your clone'):
        importlib.import_module("lanewise.report.training_curves")
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
def test_what_cannot_be_written_is_refused_beforehand(tmp_path, place, said, monkeypatch):
    (tmp_path / "file").write_text("kept")
    with pytest.raises(LanewiseError, match=f"cannot write .*{said}"):
        output_files.check_writable(tmp_path / place)
    output_files.check_writable(tmp_path / "new" / "folder" / "a.csv", tmp_path / "a.csv")
    monkeypatch.chdir(tmp_path)
    with pytest.raises(LanewiseError, match="is named for two results; give each its own file"):
        output_files.check_writable("a.md", tmp_path / "new" / ".." / "a.md")
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


def git(place, *words):
    command = ["git", "-C", str(place), "-c", "user.name=a", "-c", "user.email=a@b", *words]
    return subprocess.run(command, check=True, capture_output=True, text=True).stdout.strip()


def test_the_commit_of_a_checkout(tmp_path, monkeypatch):
    git(tmp_path, "init", "-q")
    git(tmp_path, "commit", "-qm", "one", "--allow-empty")
    head, unknown = git(tmp_path, "rev-parse", "HEAD"), {"commit": None, "clean_tree": None}
    assert version.checkout_commit(tmp_path) == {"commit": head, "clean_tree": True}
    (tmp_path / "another").write_text("two")
    assert version.checkout_commit(tmp_path) == {"commit": head, "clean_tree": False}
    assert version.checkout_commit(tmp_path.parent) == unknown
    monkeypatch.setenv("PATH", "")
    assert version.checkout_commit(tmp_path) == unknown
    # A package that cannot say its commit.
    (tmp_path / version.BUILT_FROM).write_text("{")
    monkeypatch.setattr(version, "PACKAGE", tmp_path)
    assert version.commit.__wrapped__() == unknown
    assert list(provenance.source()) == ["commit", "clean_tree", "training"]
    assert provenance.source()["training"] == version.training()


def code(commit, training, clean=True):
    return {"commit": commit * 40, "clean_tree": clean, "training": training * 12}


@pytest.mark.parametrize(
    ("sources", "said"),
    [
        ([code("a", "1")] * 2, "Trained by commit aaaaaaa; training is the same (`111111111111`)."),
        (
            [code("b", "2"), code("a", "1")],
            "Trained by more than one: commit bbbbbbb, commit aaaaaaa; **training differs** "
            "(`111111111111`, `222222222222`).",
        ),
        (
            [code("a", "1"), {}],
            "Trained by more than one: commit aaaaaaa, no commit recorded; whether training is "
            "the same is not recorded.",
        ),
    ],
)
def test_a_line_says_whether_runs_were_trained_alike(sources, said):
    assert provenance.trained_by(sources) == said
    assert provenance.trained_by([]) == ""
