"""The command line: what is refused and how, what help says, and how values are read."""

import inspect
import io
import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from lanewise import __version__, config
from lanewise.cli import compare_command, doctor_command, train_command
from lanewise.cli.command_line import parse
from lanewise.cli.evaluate_command import Evaluate
from lanewise.cli.main import COMMANDS, command_class, main
from lanewise.cli.watch_command import Watch
from lanewise.config.settings import Settings
from lanewise.errors import SettingsError
from lanewise.fields.docstrings import of_fields
from lanewise.runs import pretrained
from lanewise.runs.run_folder import RunFolder

TRAIN = ["train", "hierarchical", "--out", "run"]
FLAT = "pretrained/single-level"


@pytest.fixture(autouse=True)
def inside(tmp_path, monkeypatch):
    """Runs every test in a folder of its own, which must stay empty when a command is refused."""
    monkeypatch.chdir(tmp_path)
    return tmp_path


REFUSED = {
    "trian": 'unknown command "trian"; did you mean train?',
    "--seed 3": 'expected a command before "--seed"',
    "train": "missing CONTROLLER: one of hierarchical, single-level",
    "train hierarchical": "missing --out",
    "train hierarchical --out run seed 3": 'unexpected argument "seed"; did you mean --seed?',
    "train hierarchical --out run --sede 3": 'unknown option "--sede"; did you mean --seed?',
    "train hierarchical --out run --trap-speed 9": "did you mean --scenario.trap-speed?",
    "train hierarchical --out ''": "--out: expected a path, got nothing",
    "train hierarchical --out run --resume=yes": "--resume: ignored explicit argument",
    "train hierarchical --out run --resume": "no run in run to continue; leave out --resume to",
    "train hierarchical --out run --scenario.trap-speed --seed 1": "speed: expected one argument",
    "train hierarchical --out run --scenario.trap-speed nan": "between 0.5 and 40 m/s, got nan",
    "train hierarchical --out run --preset qick": "--preset must be one of",
    "train hierarchical --out run --high-level young": "young has no finished step-1",
    "train hierarchical --out . --high-level lender": "is not empty and holds no run",
    "train hierarchical --out run --high-level lender --goals.time-limit 7": "or driving settings",
    "evaluate absent": "no run in absent: looked for absent/run.json",
    "compare a ''": "RUNS: expected a path, got nothing",
    "watch absent -o clip.avi": "--out must end in .gif or .mp4, got clip.avi",
    f"watch {FLAT} -o /proc/a/b.gif": "cannot write /proc/a/b.gif",
    f"evaluate {FLAT} --episodes-out /proc/a/b.csv": "cannot write /proc/a/b.csv",
    f"compare {FLAT} {FLAT} --csv /proc/a/b.csv": "cannot write /proc/a/b.csv",
    f"sweep {FLAT} --out .": "not an empty folder",
    "sweep a --out b --ego-speed nan": "between 1 and 40 m/s, got nan",
    "sweep a --out b --grid robust --spacing 20": "--spacing is no axis of grid robust; leave it",
    "sweep a --out b --noise 0.1": "--noise is no axis of grid starts; leave it out",
    "sweep a --out b --grid robust --ego-speed 10 12": "give as many of each, got 2 and 0",
    "sweep a --out b --grid robust --lanes 3 3": "--lanes: 3 is given twice",
    "reproduce --out .": "is not empty and holds no run",
    "reproduce --out b --experiment mine.toml --preset paper": "each name an experiment; give one",
    "reproduce --out b --seed 2147483647 --seeds 2": "lead to seed 2147483648; the last one must",
}
"""Commands that are refused, and what each says."""
ANSWERED = ["", "--version", "train --help", "reproduce --help"]
ANSWERS = """
import contextlib, io, json, shlex, sys
from lanewise.cli.main import main

for line in sys.argv[1:]:
    out, err = io.StringIO(), io.StringIO()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        code = main(shlex.split(line))
    heavy = {"jax", "jaxlib", "optax", "highway_env", "gymnasium"} & sys.modules.keys()
    print(json.dumps([code, out.getvalue(), err.getvalue(), sorted(heavy)]))
"""


def test_refusals_are_short_and_neither_they_nor_help_import_jax(inside):
    """One process for all of them; what one leaves behind would be in the way of the next."""
    (inside / "notes.txt").write_text("mine")
    for name in ("lender", "young"):
        RunFolder.create(inside / name, Settings(), "planned", 0).close()
    (inside / "lender" / "stages").mkdir()
    (inside / "lender" / "stages" / "step-1.json").touch()
    command = [sys.executable, "-c", ANSWERS, *ANSWERED, *REFUSED]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    answers = [json.loads(answer) for answer in done.stdout.splitlines()]
    for line, (code, out, err, heavy) in zip([*ANSWERED, *REFUSED], answers, strict=True):
        assert (heavy, code, bool(out)) == ([], 2 * (line in REFUSED), line in ANSWERED), line
        if line in REFUSED:
            assert err.startswith("lanewise: error: "), line
            assert REFUSED[line] in err, line
            assert len(err.splitlines()) <= 2, line
            assert max(map(len, err.splitlines())) < 250, line
    assert sorted(os.listdir(inside)) == ["lender", "notes.txt", "young"]


def test_a_list_takes_every_word_that_belongs_to_no_flag():
    words = ["a", "--episodes", "5", "b", "--json", "c", "--csv=d.csv"]
    parsed = parse(compare_command.Compare, words)
    assert parsed.command.runs == tuple(map(Path, "abc"))
    assert (parsed.command.episodes, parsed.command.json) == (5, True)
    assert parsed.command.csv == Path("d.csv")


def test_without_a_run_the_shipped_driver_is_tested_and_drawn(capsys):
    for command, words in ((Evaluate, []), (Watch, ["-o", "clip.gif"])):
        run = parse(command, [*words, "--seed", "1"]).command.run
        assert run == pretrained.DRIVER
        assert pretrained.controller_name(run) == "hierarchical"
    assert main(["evaluate", "--help"]) == 0
    assert f"(default: {pretrained.DRIVER})" in " ".join(capsys.readouterr().out.split())


def test_a_test_takes_settings_of_its_own_and_no_others():
    wanted = {
        "scenario.trap_speed": 8.0,
        "driving.reward.accident_penalty": 20.0,
        "evaluation.duration": 60,
    }
    words = ["a", "b", *(f"--{name}={value}" for name, value in wanted.items())]
    assert parse(compare_command.Compare, words).command.test == wanted
    for name in ("goals.time-limit", "scenario.training-lanes", "evaluation.fresh-episodes"):
        with pytest.raises(SettingsError, match="unknown option"):
            parse(compare_command.Compare, ["a", "b", f"--{name}", "3"])
    with pytest.raises(SettingsError, match=r"--scenario.lanes must be between 2 and 8"):
        parse(compare_command.Compare, ["a", "b", "--scenario.lanes", "9"])


def test_values_are_read_as_they_are_written(inside):
    (inside / "mine.toml").write_text("[goals]\ntime_limit = 6\n")
    words = ["--scenario.trap-speed", "9.5", "--scenario.training-side-distance", "-5", "6"]
    words += ["--low-level.learner.hidden", "64", "32", "16", "--high-level.learner.double=false"]
    words += ["--settings", "mine.toml", "--high_level", "step1", "--driving.reward.speed_weight=2"]
    words += ["--h-dqn.low-level.learner.hidden=8,9", "--scenario.training-lanes", "none"]
    parsed = parse(train_command.Train, [*TRAIN[1:], *words])
    command, values = parsed.command, parsed.command.values
    assert (command.controller, command.out, command.seed) == ("hierarchical", Path("run"), 0)
    assert command.high_level == Path("step1")
    assert values.scenario.trap_speed == 9.5
    assert values.scenario.training_side_distance == (-5.0, 6.0)
    assert values.scenario.training_lanes == ()
    assert values.low_level.learner.hidden == (64, 32, 16)
    assert values.h_dqn.low_level.learner.hidden == (8, 9)
    assert (values.high_level.learner.double, values.low_level.learner.double) == (False, True)
    assert values.driving.reward.speed_weight == 2.0
    assert values.goals.time_limit == 6.0
    assert parsed.settings_given
    again = parse(train_command.Train, [*TRAIN[1:], "--resume", "--seed", "0"])
    assert not again.settings_given
    assert {"resume", "seed"} <= again.given


def test_help_lists_every_command_with_the_first_line_of_its_own(capsys):
    assert main(["--version"]) == 0
    assert capsys.readouterr().out == f"lanewise {__version__}\n"
    assert main([]) == 0
    output = capsys.readouterr().out
    for name, summary in COMMANDS.items():
        assert summary in output
        assert inspect.getdoc(command_class(name)).splitlines()[0] == summary


def test_help_lists_every_setting_with_text_default_and_range(capsys):
    assert main(["train", "--help"]) == 0
    output = " ".join(capsys.readouterr().out.split())
    for name in config.field_types():
        assert f"--{name.replace('_', '-')} " in output
    expected = "Speed of both trap cars, all episode long. [between 0.5 and 40 m/s] (default: 10.0)"
    assert expected in output
    assert "{previous-goal,current-state}" in output


@pytest.mark.parametrize(
    "usage",
    [
        "train [OPTIONS] CONTROLLER --out PATH",
        "compare [OPTIONS] RUNS ...",
        "watch [OPTIONS] [RUN] --out PATH",
    ],
)
def test_usage_shows_what_is_required_and_what_may_be_several(usage, capsys):
    assert main([usage.split()[0], "--help"]) == 0
    assert capsys.readouterr().out.splitlines()[0] == f"usage: lanewise {usage}"


def test_no_setting_is_without_help():
    def parts(part):
        yield part
        for name in part.__dataclass_fields__:
            if hasattr(value := getattr(part, name), "__dataclass_fields__"):
                yield from parts(value)

    for owner in {type(part) for part in parts(Settings())} | set(map(command_class, COMMANDS)):
        assert set(of_fields(owner)) == set(owner.__dataclass_fields__), owner


def test_output_escapes_what_the_encoding_lacks(monkeypatch):
    """`PYTHONIOENCODING=ascii:strict lanewise --help`, and whatever else is printed."""
    monkeypatch.setattr(doctor_command, "run", lambda _: sys.stdout.write("Intel® 日本") * 0)
    for name in ("stdout", "stderr"):
        stream = io.TextIOWrapper(io.BytesIO(), encoding="ascii", errors="strict")
        monkeypatch.setattr(sys, name, stream)
    for words in ([], *([command] for command in COMMANDS)):
        assert main([*words, "--help"]) == 0
    assert main(["doctor"]) == 0
    assert main(["evaluate", "größe 日本"]) == 2
    said = [stream.buffer.getvalue().decode("ascii") for stream in (sys.stdout, sys.stderr)]
    monkeypatch.undo()
    assert all("\\u65e5\\u672c" in each for each in said)
