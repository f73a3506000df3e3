"""``lanewise export``: what it writes, checks and refuses."""

import json
import sys

import pytest

from lanewise.cli.main import main
from lanewise.evaluation import evaluator
from lanewise.export import check, numpy_policy
from lanewise.export.check import Agreement

FLAT = "pretrained/single-level"


@pytest.mark.slow
def test_the_written_file_is_compared_with_the_controller(tmp_path, capsys, monkeypatch):
    monkeypatch.setattr(evaluator, "BLOCK", 4)
    for ending in ("npz", "onnx"):
        out = tmp_path / f"policy.{ending}"
        words = ["--check", "150", "--json", "--scenario.lanes", "4", "--evaluation.duration", "9"]
        assert main(["export", FLAT, "--out", str(out), *words]) == 0
        found = json.loads(capsys.readouterr().out)
        assert (found["controller"], found["out"]) == ("single-level", str(out))
        assert found["check"]["same"] == found["check"]["states"] >= 150


def test_a_difference_is_an_exit_code(tmp_path, capsys, monkeypatch):
    made = Agreement(states=10, same=8, tied=1, different=1, largest_difference=0.5)
    monkeypatch.setattr(check, "agreement", lambda *given: made)
    assert main(["export", FLAT, "-o", str(tmp_path / "a.npz"), "--check", "5"]) == 1
    assert "10 decisions: 8 the same, 1 tied, 1 different" in capsys.readouterr().out


def test_the_check_drives_where_it_is_told_to(tmp_path, capsys, monkeypatch):
    told = []
    monkeypatch.setattr(check, "agreement", lambda *given: told.append(given) or Agreement())
    elsewhere = ("--scenario.lanes", "4", "--evaluation.duration", "5")
    for number, words in enumerate((elsewhere, elsewhere[2:], ())):
        out = tmp_path / f"{number}.npz"
        assert main(["export", FLAT, "-o", str(out), "--check", "5", *words]) == 0
    differs = (
        "single-level was trained on scenario.lanes 3 (here 4) and validated for 25 s (here 5)"
    )
    assert differs in capsys.readouterr().err
    driven = [(given[0].settings, given[-1]) for given in told]
    assert [each.scenario.lanes for each, _ in driven] == [4, 3, 3]
    assert [each.evaluation.duration for each, _ in driven] == [5, 5, 25]
    assert [split for _, split in driven] == ["test", "training", "training"]
    policies = [numpy_policy.load(tmp_path / f"{number}.npz").about for number in (0, 2)]
    assert policies[0] == policies[1]


def test_goals_may_be_renewed_otherwise(tmp_path):
    out = tmp_path / "policy.npz"
    words = ["export", "pretrained/hierarchical", "--out", str(out), "--renewal", "critic"]
    assert main(words) == 0
    goals = numpy_policy.load(out).about["goals"]
    assert (goals["renewal"], goals["lifetime"]) == ("critic", 6)


def test_refusals(tmp_path, refused):
    out, mine = tmp_path / "a.npz", tmp_path / "mine.npz"
    mine.write_text("mine")
    for words, hint in (
        ((FLAT, "--out", mine), "exists; choose another file"),
        ((FLAT, "--out", tmp_path / "a.pt"), "--out must end in"),
        ((FLAT,), "missing --out"),
        ((FLAT, "--out", out, "--renewal", "critic"), "has no goals"),
        ((FLAT, "--out", out, "--scenario.lanes", "4"), "--scenario.lanes is for --check N; give"),
        ((tmp_path / "none", "--out", out), str(tmp_path)),
        (("reference/rule-based", "--out", out), "reference/rule-based cannot be exported: "),
        (("reference/search", "--out", out), "reference/search cannot be exported: "),
    ):
        assert hint in refused("export", *words)
    assert list(tmp_path.iterdir()) == [mine]
    assert mine.read_text() == "mine"


def test_a_missing_package(tmp_path, refused, monkeypatch):
    for name in ("onnx_model", "recording"):
        monkeypatch.delitem(sys.modules, f"lanewise.export.{name}", raising=False)
        monkeypatch.delattr(f"lanewise.export.{name}", raising=False)
    monkeypatch.setitem(sys.modules, "onnx", None)
    said = refused("export", FLAT, "--out", tmp_path / "a.onnx")
    assert 'pip install ".[onnx]" in your clone' in said
    assert not list(tmp_path.iterdir())
