"""A result says which code made it."""

import subprocess

import pytest

from lanewise.report import provenance
from lanewise.system import version


def git(place, *words):
    command = ["git", "-C", str(place), "-c", "user.name=a", "-c", "user.email=a@b", *words]
    return subprocess.run(command, check=True, capture_output=True, text=True).stdout.strip()


@pytest.fixture
def checkout(tmp_path):
    git(tmp_path, "init", "-q")
    (tmp_path / "file").write_text("one")
    git(tmp_path, "add", "file")
    git(tmp_path, "commit", "-qm", "one")
    return tmp_path


@pytest.mark.parametrize("name", ["another"])
def test_a_changed_or_new_file_makes_a_tree_unclean(checkout, name):
    head = git(checkout, "rev-parse", "HEAD")
    assert version.checkout_commit(checkout) == {"commit": head, "clean_tree": True}
    (checkout / name).write_text("two")
    assert version.checkout_commit(checkout) == {"commit": head, "clean_tree": False}


def test_without_a_checkout_or_git_the_commit_is_unknown(tmp_path, checkout, monkeypatch):
    unknown = {"commit": None, "clean_tree": None}
    assert version.checkout_commit(tmp_path.parent) == unknown
    monkeypatch.setenv("PATH", "")
    assert version.checkout_commit(checkout) == unknown


@pytest.mark.parametrize("text", ["{"])
def test_a_package_that_cannot_say_its_commit_is_no_error(tmp_path, monkeypatch, text):
    if text:
        (tmp_path / version.BUILT_FROM).write_text(text)
    monkeypatch.setattr(version, "PACKAGE", tmp_path)
    assert version.commit.__wrapped__() == {"commit": None, "clean_tree": None}


def test_results_name_commit_tree_and_training():
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
