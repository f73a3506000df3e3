"""Commands on a trained run: what they print, write and refuse."""

import csv
import itertools
import json
import re
import shutil

import pytest
import small_runs
from PIL import Image

from lanewise.cli import sweep_command as sweep
from lanewise.cli.main import main
from lanewise.evaluation import conditions, evaluator
from lanewise.evaluation import sweep as drives
from lanewise.evaluation.cells import KINDS, CellOutcome, Reach
from lanewise.report import sweep_page as maps
from lanewise.system import folder_io, safe_io

WON = CellOutcome(2, 8.0, 10.0, [2], [2], [[0] * len(KINDS)], [-1])
KEYS = {"controller", "success_rate", "accident_rate", "accumulated_reward", "intervals"}


def evaluate(run, capsys, *words):
    capsys.readouterr()
    episodes = () if "--episodes" in words else ("--episodes", "5")
    assert main(["evaluate", str(run), *episodes, *words]) == 0
    return capsys.readouterr()


def test_evaluate_prints_one_json_object_and_a_line_per_episode(whole, capsys, tmp_path):
    file = tmp_path / "episodes.csv"
    printed = evaluate(whole, capsys, "--json", "--episodes-out", str(file)).out
    assert printed.count("\n") == 1
    found = json.loads(printed)
    assert found.keys() >= KEYS
    named = (found["controller"], found["world"], found["episodes"])
    assert named == ("hierarchical", "lanewise", 5)
    assert json.loads(evaluate(whole, capsys, "--json").out) == found
    with file.open(newline="") as lines:
        rows = list(csv.DictReader(lines))
    assert len(rows) == 5
    mean = sum(float(row["travel_distance"]) for row in rows) / 5
    assert mean == pytest.approx(found["travel_distance"], rel=1e-4)


@pytest.mark.slow
def test_highway_env_gives_the_same_figures(whole, capsys):
    ours, theirs = (
        json.loads(evaluate(whole, capsys, "--json", "--world", world, "--episodes", "1").out)
        for world in ("lanewise", "highway-env")
    )
    assert theirs["world"] == "highway-env"
    assert theirs["travel_distance"] == pytest.approx(ours["travel_distance"], rel=1e-4)
    assert theirs["accidents"] == ours["accidents"]


@pytest.mark.slow
def test_watch_draws_a_clip(whole, tmp_path, capsys):
    clip = tmp_path / "clip.gif"
    assert main(["watch", str(whole), "-o", str(clip)]) == 0
    with Image.open(clip) as image:
        assert image.format == "GIF"
        assert image.n_frames > 1
    assert "wrote" in capsys.readouterr().err


AXES = {"ego-speed": "9 10", "trap-speed": "10", "lanes": "3 4", "front-distance": "15",
        "side-distance": "5", "spacing": "17 25", "episodes": "2"}  # fmt: skip


def sweep_words(run, out, **changes):
    axes = AXES | {name.replace("_", "-"): value for name, value in changes.items()}
    words = [word for name, value in axes.items() for word in (f"--{name}", *value.split())]
    return ["sweep", str(run), "--out", str(out), *words]


def interrupt(words, at):
    """A sweep is interrupted in its block of that number."""
    real, blocks = evaluator.drive_block, itertools.count(1)
    drive = lambda *given: small_runs.stop() if next(blocks) == at else real(*given)  # noqa: E731
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(evaluator, "drive_block", drive)
        assert main(words) == 130


@pytest.mark.slow
def test_sweep_writes_a_map_and_continues_an_interrupted_one(
    whole, tmp_path, capsys, monkeypatch, refused
):
    monkeypatch.setattr(evaluator, "BLOCK", 4)
    out = tmp_path / "map"
    assert main(sweep_words(whole, out)) == 0
    printed = capsys.readouterr()
    assert "| all starts | 8 | 16 |" in printed.out
    assert "what can be won: starting" in printed.err
    expected = json.loads((out / "map.json").read_text())
    assert len(expected["cells"]) == 8
    assert not (out / "progress.json").exists()
    assert "is complete: see" in refused(*sweep_words(whole, out))

    cut = tmp_path / "cut"
    interrupt(sweep_words(whole, cut), at=3)
    assert "the same command continues it" in capsys.readouterr().err
    journal = cut / "progress.json"
    kept = json.loads(journal.read_text())
    assert (len(kept["reached"]), len(kept["outcomes"])) == (4, 4)
    assert "holds another sweep" in refused(*sweep_words(whole, cut, episodes="3"))
    # So is that of another controller with the same settings and seed.
    other = kept | {"sweep": kept["sweep"] | {"weights": "0" * 64}}
    journal.write_text(json.dumps(other | {"digest": safe_io.digest(other)}))
    assert "holds another sweep" in refused(*sweep_words(whole, cut))
    journal.write_text(json.dumps(kept))
    assert main(sweep_words(whole, cut)) == 0
    assert "episodes: continuing" in capsys.readouterr().err
    again = json.loads((cut / "map.json").read_text())
    assert again["cells"] == expected["cells"]


@pytest.mark.slow
def test_a_robust_sweep_that_was_interrupted_ends_as_one_that_was_not(
    whole, tmp_path, capsys, monkeypatch, refused
):
    monkeypatch.setattr(evaluator, "BLOCK", 4)
    monkeypatch.setitem(conditions.DENSITIES, "light", conditions.Density(1, 0, 40.0))
    axes = "--grid robust --population paper highd --density empty light --lanes 2 3 --noise 0"
    axes += " --latency 0 --ego-speed 10 12 --trap-speed 8 10 --episodes 2"

    def words(out):
        return ["sweep", str(whole), "--out", str(out), *axes.split()]

    assert main(words(tmp_path / "whole")) == 0
    assert "| seen in training | 4 | 8 |" in capsys.readouterr().out
    cut = tmp_path / "cut"
    interrupt(words(cut), at=4)
    kept = json.loads((cut / "progress.json").read_text())
    assert (len(kept["reached"]), len(kept["outcomes"])) == (2, 4)
    assert "holds another sweep" in refused(*words(cut), "--seed", 1)
    assert main(words(cut)) == 0
    for name in ("robust.json", "robust.md", "robust.png", "robust.svg"):
        # The date and the folder's name are their own.
        ours, theirs = (
            re.sub(rb"20\d\d-[-:T+0-9]+", b"", (folder / name).read_bytes())
            for folder in (cut, tmp_path / "whole")
        )
        assert ours == theirs
    assert not (cut / "progress.json").exists()
    assert "is complete: see" in refused(*words(cut))


def test_sweep_refuses_before_it_works(whole, tmp_path, refused):
    for changes, hint in (
        ({"front_distance": "15 5"}, "more than a car length (5.0 m), got 5.0"),
        ({"spacing": "25 8", "vehicles_behind": "0 2"}, "more than a car length"),
        ({"lanes": "3 3"}, "--lanes: 3 is given twice"),
    ):
        assert hint in refused(*sweep_words(whole, tmp_path / "map", **changes))
    waves = ["--scenario.trap-speed-wave", "2"]
    robust = ["sweep", str(whole), "--out", str(tmp_path / "map"), "--grid", "robust"]
    for words in (sweep_words(whole, tmp_path / "map"), robust):
        assert "--scenario.trap-speed-wave must be 0: whether a start" in refused(*words, *waves)
    said = refused(*sweep_words(whole, tmp_path / "map"), "--scenario.lanes", 3)
    assert "--lanes and --scenario.lanes are the same axis; give one of them" in said
    assert not (tmp_path / "map").exists()
    with folder_io.lock(tmp_path / "busy", "sweeping"):
        said = refused(*sweep_words(whole, tmp_path / "busy"))
    assert "busy is in use: another process is sweeping in it" in said
    assert list((tmp_path / "busy").iterdir()) == []
    (tmp_path / "note").write_text("mine")
    assert "holds no sweep" in refused(*sweep_words(whole, tmp_path))


def test_a_sweep_in_another_scenario(whole, tmp_path, monkeypatch, capsys):
    driven = []

    def drive(test, parameters, seed, episodes, points, first):
        driven.append((test.scenario, test.duration, points))
        return [[WON for _ in points]]

    monkeypatch.setattr(drives, "reach", lambda *_: [Reach(True, True, True, "0", 1)])
    monkeypatch.setattr(drives, "run", drive)
    words = ["sweep", str(whole), "--out", str(tmp_path / "map"), "--ego-speed", "9"]
    words += ["--trap-speed", "10", "--front-distance", "15", "--side-distance", "5"]
    words += ["--scenario.lanes", "4", "--scenario.lane-width", "3.5", "--evaluation.duration", "9"]
    assert main(words) == 0
    changes = "scenario.lanes 3 (here 4), scenario.lane_width 4.0 (here 3.5) and validated"
    assert f"hierarchical was trained on {changes} for 4 s (here 9)\n" in capsys.readouterr().err
    ((scenario, duration, (point,)),) = driven
    assert (scenario.lane_width, duration, point.lanes) == (3.5, 18, 4)
    found = json.loads((tmp_path / "map" / "map.json").read_text())
    assert found["settings"]["scenario.lane_width"] == 3.5
    assert "scenario.lane_width 4.0 (here 3.5)" in found["trained_on"]
    assert "It was trained on scenario.lanes 3" in (tmp_path / "map" / "map.md").read_text()


def test_a_sweep_writes_into_no_other_folder(whole, tmp_path, monkeypatch, capsys):
    """While it draws, its folder is replaced by another."""
    out, draw, left = tmp_path / "map", maps.write, {}

    def break_in(*arguments):
        shutil.rmtree(out)
        out.mkdir()
        (out / sweep.JOURNAL).write_text("another's")
        left.update(small_runs.everything(tmp_path))
        return draw(*arguments)

    monkeypatch.setattr(drives, "reach", lambda *_: [Reach(True, True, True, "0", 1)])
    monkeypatch.setattr(drives, "run", lambda *_: [[WON]])
    monkeypatch.setattr(maps, "write", break_in)
    assert main(sweep_words(whole, out, ego_speed="9", lanes="3", spacing="25")) == 2
    said = capsys.readouterr().err.splitlines()
    assert f"lanewise: error: {out} was moved, removed or replaced" in said[-2]
    assert small_runs.everything(tmp_path) == left
