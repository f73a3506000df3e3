"""The commands one after the other, with a training of a few seconds."""

import csv
import json

import pytest
from PIL import Image

from lanewise.cli import main
from lanewise.evaluation import drive

STAGE = {
    "worlds": "2",
    "decisions": "100",
    "duration": "12",
    "learner.hidden": "16 16",
    "learner.batch-size": "8",
    "learner.warm-up": "40",
    "learner.replay-capacity": "300",
}
OPTIONS = {
    "scenario.traffic.vehicles-ahead": "1",
    "planner.preview": "2",
    "evaluation.duration": "3",
    "evaluation.validation-episodes": "4",
} | {
    f"{stage}.{name}": value
    for stage in ("high-level", "low-level")
    for name, value in STAGE.items()
}
KEYS = {
    "controller", "world", "episodes", "success_rate", "accident_rate", "accidents",
    "accumulated_reward", "average_speed", "travel_distance", "intervals",
}  # fmt: skip


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    """A trained run."""
    path = tmp_path_factory.mktemp("commands") / "run"
    words = [word for name, value in OPTIONS.items() for word in (f"--{name}", *value.split())]
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(drive, "BLOCK", 4)
        assert main(["train", "hierarchical", "--out", str(path), "--seed", "2", *words]) == 0
        yield path


def evaluate(run, capsys, *words):
    capsys.readouterr()
    episodes = () if "--episodes" in words else ("--episodes", "5")
    assert main(["evaluate", str(run), *episodes, *words]) == 0
    return capsys.readouterr()


def test_evaluate_prints_exactly_one_json_object(run, capsys):
    printed = evaluate(run, capsys, "--json").out
    assert printed.count("\n") == 1
    found = json.loads(printed)
    assert found.keys() >= KEYS
    assert (found["controller"], found["world"], found["episodes"]) == (
        "hierarchical",
        "lanewise",
        5,
    )
    assert found["accidents"].keys() == {"collision", "off_road", "stopped"}
    assert 0.0 <= found["success_rate"] <= 1.0
    assert json.loads(evaluate(run, capsys, "--json").out) == found


def test_episodes_out_agrees_with_the_summary(run, capsys, tmp_path):
    file = tmp_path / "episodes.csv"
    found = json.loads(evaluate(run, capsys, "--json", "--episodes-out", str(file)).out)
    with file.open(newline="") as lines:
        rows = list(csv.DictReader(lines))
    assert len(rows) == 5
    mean = sum(float(row["travel_distance"]) for row in rows) / 5
    assert mean == pytest.approx(found["travel_distance"], rel=1e-4)


def test_evaluate_without_json_prints_a_table(run, capsys):
    printed = evaluate(run, capsys).out
    assert "hierarchical" in printed
    assert not printed.lstrip().startswith("{")


def test_highway_env_gives_the_same_figures(run, capsys):
    ours, theirs = (
        json.loads(evaluate(run, capsys, "--json", "--world", world, "--episodes", "1").out)
        for world in ("lanewise", "highway-env")
    )
    assert theirs["world"] == "highway-env"
    assert theirs["travel_distance"] == pytest.approx(ours["travel_distance"], rel=1e-4)
    assert theirs["accidents"] == ours["accidents"]


def test_watch_draws_a_clip(run, tmp_path, capsys):
    clip = tmp_path / "clip.gif"
    assert main(["watch", str(run), "-o", str(clip)]) == 0
    with Image.open(clip) as image:
        assert image.format == "GIF"
        assert image.n_frames > 1
    assert "wrote" in capsys.readouterr().err


def test_an_unfinished_run_is_no_controller(run, tmp_path, capsys):
    assert main(["watch", str(run), "-o", str(tmp_path / "clip.txt")]) == 2
    (tmp_path / "run").mkdir()
    for name in ("run.json", "settings.toml"):
        (tmp_path / "run" / name).write_bytes((run / name).read_bytes())
    assert main(["evaluate", str(tmp_path / "run")]) == 2
    assert "is not finished" in capsys.readouterr().err
