"""The compare command on finished runs, and what it refuses."""

import csv
import json
import shutil
from functools import partial
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import small_runs

import lanewise
from lanewise import config
from lanewise.cli import compare_command
from lanewise.cli.main import main
from lanewise.errors import LanewiseError
from lanewise.evaluation import evaluator
from lanewise.experiments import evaluate_trained
from lanewise.report import output_files
from untrusted_files import made_up_episodes

CONTROLLER = "single-level"
OPTIONS = {
    "scenario.traffic.vehicles_ahead": 0,
    "evaluation.duration": 3,
    "single_level.learner.hidden": (8,),
}
RUNS = {
    "s0": {},
    "s1": {},
    "wide": {
        "single_level.learner.hidden": (12,),
        "scenario.training_front_distance": (15.0, 16.0),
        "driving.observation.scaling": "highway-env",
    },
    "fast": {"scenario.trap_speed": 10.9},
    "penalised": {"driving.reward.accident_penalty": 5.0},
}


def make_run(name, changes):
    """A finished run, with weights drawn instead of learnt: comparing is what is tested here."""
    settings = config.compose(flags=OPTIONS | changes)
    seed = 1 if name == "s1" else 0
    rng = np.random.default_rng(seed)
    drawn = partial(rng.normal, 0, 0.5)
    small_runs.finish(Path(name), settings, CONTROLLER, seed, drawn)


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """Finished runs by name, in the folder the test runs in."""
    folder = tmp_path_factory.mktemp("compare")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(evaluator, "BLOCK", 4)
        patch.chdir(folder)
        for name, changes in RUNS.items():
            make_run(name, changes)
        yield folder


@pytest.fixture
def runs(made, request, monkeypatch):
    """As `made`; their tests are made up, but in slow tests."""
    if not request.node.get_closest_marker("slow"):
        monkeypatch.setattr(
            evaluate_trained,
            "evaluate",
            # In highway-env a run does as the next one does here.
            lambda trained, world, episodes, seed, *_: made_up_episodes(
                trained.seed + (world == "highway-env"), episodes
            ),
        )
    return made


def compare(capsys, *words):
    capsys.readouterr()
    assert main(["compare", *words, "--episodes", "5"]) == 0
    return capsys.readouterr().out


def test_no_command_writes_into_a_run(runs, refused):
    before = small_runs.everything(runs)
    for words in (
        "evaluate s0 --episodes-out s0/settings.toml",
        "evaluate s0 --episodes-out s1/new/episodes.csv",
        "compare s0 s1 --markdown s0/run.json",
        "compare s0 s1 --csv wide/c.csv",
        "watch s0 -o s0/clip.gif",
        "export s0 -o s0/policy.npz",
        "sweep s0 --out s0/map",
        "bench world --out s0/bench.json",
        "train single-level --out s0/again",
        "reproduce --out s0/again",
    ):
        said = refused(*words.split())
        assert "belongs to the run in " in said, words
        assert said.endswith("; choose another place\n")
    found = lanewise.evaluate("s0", episodes=2, quiet=True)
    for write, name in ((found.save, "settings.json"), (found.clip, "clip.gif")):
        with pytest.raises(LanewiseError, match=r"belongs to the run in .*s0; choose"):
            write(f"s0/{name}")
    assert small_runs.everything(runs) == before


@pytest.mark.slow
def test_json_agrees_with_evaluate(runs, capsys):
    printed = compare(capsys, "s0", "s1", "wide", "--json", "--seed", "3")
    assert printed.count("\n") == 1
    found = json.loads(printed)
    assert [run["run"] for run in found["runs"]] == ["s0", "s1", "wide"]
    # Training starts and what a controller sees are its own affair, and no reason to refuse.
    assert found["settings"] == {
        "scenario.training_front_distance": [[14.8, 16.44], [14.8, 16.44], [15.0, 16.0]],
        "driving.observation.scaling": ["fine", "fine", "highway-env"],
        "single_level.learner.hidden": [[8], [8], [12]],
    }
    assert (found["world"], found["episodes"], found["seed"]) == ("lanewise", 5, 3)
    for run in found["runs"]:
        assert main(["evaluate", run["run"], "--episodes", "5", "--seed", "3", "--json"]) == 0
        alone = json.loads(capsys.readouterr().out)
        assert {name: run[name] for name in alone} == alone


def test_tables_and_files(runs, capsys):
    printed = compare(capsys, "s0", "s1", "--markdown", "out/c.md", "--csv", "out/c.csv")
    assert "A  s0  single-level, seed 0\nB  s1  single-level, seed 1\n" in printed
    assert "Settings of the runs that differ\nnone\n" in printed
    assert (runs / "out" / "c.md").read_text().startswith("# Comparison of runs\n")
    with (runs / "out" / "c.csv").open(newline="") as lines:
        assert {row["run"] for row in csv.DictReader(lines)} == {"s0", "s1"}


@pytest.mark.parametrize(
    ("controllers", "listed"),
    [
        (("single-level", "single-level"), True),
        (("single-level", "planned"), False),
        (("planned", "hierarchical"), False),
        (("planned", "single-level", "single-level"), False),
    ],
)
def test_settings_of_a_stage_are_listed_where_two_runs_that_have_it_differ(controllers, listed):
    plain = config.compose()
    other = config.replace(plain, {"single_level.worlds": 8, "goals.time_limit": 5.0})
    runs = [SimpleNamespace(settings=plain, controller=controllers[0])]
    runs += [SimpleNamespace(settings=other, controller=each) for each in controllers[1:]]
    found = compare_command._of_training(runs)
    assert ("single_level.worlds" in found) == listed
    assert found["goals.time_limit"] == (3.0, *[5.0] * (len(runs) - 1))


@pytest.mark.parametrize("words", ["compare s0 s1 --csv", "evaluate s0 --episodes-out"])
def test_a_file_that_cannot_be_written_never_costs_figures(runs, capsys, monkeypatch, words):
    def full(path, text):
        raise LanewiseError(f"cannot write {path}: No space left on device")

    monkeypatch.setattr(output_files, "write_text", full)
    assert main([*words.split(), "c.csv", "--episodes", "2"]) == 2
    output = capsys.readouterr()
    assert "single-level" in output.out
    assert "cannot write c.csv" in output.err


@pytest.mark.slow
def test_all_drive_the_scenario_of_one(runs, capsys):
    own = json.loads(compare(capsys, "s0", "s1", "--json"))
    chosen = json.loads(compare(capsys, "fast", "s0", "--scenario-of", "s1", "--json"))
    assert chosen["scenario_of"] == "s1"
    assert chosen["runs"][1] == own["runs"][0]
    assert chosen["settings"]["scenario.trap_speed"] == [10.9, 10.0]
    by_flag = json.loads(compare(capsys, "fast", "s0", "--scenario.trap-speed", "10", "--json"))
    assert by_flag["runs"] == chosen["runs"]
    assert main(["evaluate", "fast", "--episodes", "5", "--json"]) == 0
    in_its_own = json.loads(capsys.readouterr().out)
    assert in_its_own["travel_distance"] != chosen["runs"][0]["travel_distance"]


@pytest.mark.parametrize(
    ("words", "hint"),
    [
        (["s0", "fast"], "not tested alike: scenario.trap_speed is 10.0, not 10.9"),
        (["s0", "penalised"], "driving.reward.accident_penalty is 10.0, not 5.0"),
        (
            ["s0", "penalised", "--scenario-of", "s0"],
            "--driving.reward.accident-penalty VALUE tests",
        ),
        (["s0", "s1", "s0"], "s0 and s0 are the same run twice: single-level, the same settings"),
        (["s0", "s1", "--markdown", "c.md", "--csv", "./c.md"], "c.md is named for two results;"),
        (["s0", "s1", "--csv", "s0"], "cannot write s0: a folder has that name"),
        (["s0", "begun"], "begun is not finished and has no weights yet; lanewise train"),
    ],
)
def test_refusals(runs, refused, words, hint):
    (runs / "begun").mkdir(exist_ok=True)
    for name in ("run.json", "settings.toml"):
        shutil.copy(runs / "s1" / name, runs / "begun")
    said = refused("compare", *words)
    assert hint in said
    assert ("--scenario-of RUN" in said) == ("fast" in words)
    assert not (runs / "c.md").exists()


def test_highway_env_is_asked_for(runs, capsys):
    ours = json.loads(compare(capsys, "s0", "s1", "--json"))
    theirs = json.loads(compare(capsys, "s0", "s1", "--json", "--world", "highway-env"))
    assert theirs["world"] == theirs["runs"][0]["world"] == "highway-env"
    assert theirs["runs"][0]["travel_distance"] == ours["runs"][1]["travel_distance"]
