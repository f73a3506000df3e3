import io
import os
import pathlib
import subprocess
import sys

import pytest

from lanewise import __version__, cli
from lanewise.cli import main
from lanewise.commands import compare, train
from lanewise.commands.arguments import parse
from lanewise.report import provenance
from lanewise.runs.folder import RunFolder
from lanewise.settings import Settings

TRAIN = ["train", "hierarchical", "--out", "run"]


@pytest.fixture(autouse=True)
def inside(tmp_path, monkeypatch):
    """Runs every test in a folder of its own, which must stay empty when a command is refused."""
    monkeypatch.chdir(tmp_path)
    return tmp_path


def run_process(*words, **options):
    code = (
        "import sys; from lanewise.cli import main; code = main(sys.argv[1:])\n"
        "heavy = {'jax', 'jaxlib', 'optax', 'highway_env', 'gymnasium'} & sys.modules.keys()\n"
        "sys.exit(f'imported {heavy}' if heavy else code)"
    )
    return subprocess.run(
        [sys.executable, "-c", code, *words], capture_output=True, text=True, check=False, **options
    )


REFUSALS = [
    (["trian"], 'unknown command "trian"; did you mean train?'),
    (["--seed", "3"], 'expected a command before "--seed"'),
    (["train"], "missing CONTROLLER: one of hierarchical, single-level"),
    (["train", "hierarchical"], "missing --out"),
    (
        ["train", "flat", "--out", "run"],
        "CONTROLLER must be one of hierarchical, single-level, planned, h-dqn, got",
    ),
    ([*TRAIN, "more"], 'unexpected argument "more"'),
    ([*TRAIN, "--out"], "--out: expected"),
    ([*TRAIN, "--out", ""], "--out: expected a path, got nothing"),
    ([*TRAIN, "--sede", "3"], 'unknown option "--sede"; did you mean --seed?'),
    ([*TRAIN, "-x"], 'unknown option "-x"'),
    ([*TRAIN, "-seed", "3"], 'unknown option "-seed"; did you mean --seed?'),
    ([*TRAIN, "\N{EM DASH}seed", "3"], "did you mean --seed?"),
    ([*TRAIN, "seed", "3"], 'unexpected argument "seed"; did you mean --seed?'),
    ([*TRAIN, "--low-level.learner.hidden", "65536", "65536"], "GiB of memory, the machine has"),
    ([*TRAIN, "--seed", "-1"], "--seed must be between 0 and 2147483647, got -1"),
    ([*TRAIN, "--seed", "1.5"], '--seed: expected a whole number, got "1.5"'),
    ([*TRAIN, "--seed", "9" * 5000], "--seed must be between 0 and 2147483647, got 99"),
    ([*TRAIN, "--preset", "qick"], "--preset must be one of quick, paper"),
    ([*TRAIN, "--trap", "trap-11"], "--trap must be one of trap-10, trap-10.9"),
    ([*TRAIN, "--resume=yes"], "--resume takes no value"),
    ([*TRAIN, "--resume"], "no run in run: looked for run/run.json"),
    ([*TRAIN, "--high-level", "absent"], "no run in absent: looked for absent/run.json"),
    ([*TRAIN, "--settings", "absent.toml"], "cannot read settings file absent.toml: No such file"),
    ([*TRAIN, "--scenario.trap-sped", "9"], "did you mean --scenario.trap-speed?"),
    ([*TRAIN, "--scenario.trap_sped", "9"], "did you mean --scenario.trap-speed?"),
    ([*TRAIN, "--trap-speed", "9"], "did you mean --scenario.trap-speed?"),
    ([*TRAIN, "--learning-rate", "1"], "did you mean --low-level.learner.learning-rate or --high"),
    ([*TRAIN, "--scenario.trap-speed"], "--scenario.trap-speed: expected a number, got nothing"),
    ([*TRAIN, "--scenario.trap-speed", "--seed", "1"], "expected a number, got nothing"),
    ([*TRAIN, "--scenario.trap-speed", "fast"], 'expected a number, got "fast"'),
    ([*TRAIN, "--scenario.trap-speed", "nan"], "must be between 0.5 and 40 m/s, got nan"),
    ([*TRAIN, "--scenario.trap-speed", "-inf"], "must be between 0.5 and 40 m/s, got -inf"),
    ([*TRAIN, "--scenario.trap-speed", "-3"], "must be between 0.5 and 40 m/s, got -3.0"),
    ([*TRAIN, "--scenario.trap-speed="], 'expected a number, got ""'),
    ([*TRAIN, "--scenario.lanes", "0"], "--scenario.lanes must be between 2 and 8, got 0"),
    ([*TRAIN, "--scenario.lanes", "2.0"], '--scenario.lanes: expected a whole number, got "2.0"'),
    ([*TRAIN, "--scenario.test-front-distance", "5"], "more than a car length (5.0 m), got 5.0"),
    ([*TRAIN, "--scenario.test-front-distance", "4"], "between 5 and 200 m, got 4.0"),
    ([*TRAIN, "--scenario.training-front-distance", "15"], "expected 2 numbers, got [15.0]"),
    ([*TRAIN, "--scenario.training-front-distance", "17", "16"], "17.0 must not exceed 16.0"),
    ([*TRAIN, "--scenario.training-front-distance", "1", "2", "3"], "between 5 and 200 m, got 1.0"),
    ([*TRAIN, "--scenario.missing-target-speed", "maybe"], 'expected true or false, got "maybe"'),
    ([*TRAIN, "--goals.reference", "x"], "--goals.reference must be one of previous-goal, current"),
    (["evaluate"], "missing RUN"),
    (["evaluate", "absent"], "no run in absent: looked for absent/run.json"),
    (["evaluate", "absent", "--episodes", "0"], "--episodes must be between 1 and"),
    (["evaluate", "absent", "--world", "mars"], "--world must be one of lanewise, highway-env"),
    (["evaluate", "absent", "--renewal", "never"], "--renewal must be one of critic, timestep"),
    (["evaluate", "absent", "--scenario.lanes", "3"], 'unknown option "--scenario.lanes"'),
    (["compare"], "missing RUNS"),
    (["compare", "absent", "other"], "no run in absent: looked for absent/run.json"),
    (["compare", "a", ""], "RUNS: expected a path, got nothing"),
    (["compare", "a", "b", "--episode", "5"], "did you mean --episodes?"),
    (["compare", "a", "b", "--scenario-of"], "--scenario-of: expected a path, got nothing"),
    (["watch", "absent"], "missing --out"),
    (["watch", "absent", "-o", "clip.gif"], "no run in absent"),
    (["watch", "absent", "-o", "clip.avi"], "--out must end in .gif or .mp4, got clip.avi"),
    (["sweep", "absent"], "missing --out"),
    (["sweep", "absent", "--out", "maps"], "no run in absent"),
    (["sweep", "absent", "--out", "maps", "--lanes", "1"], "--lanes must be between 2 and 8"),
    (["sweep", "absent", "--out", "maps", "--ego-speed", "nan"], "between 1 and 40 m/s, got nan"),
    (["reproduce"], "missing --out"),
    (
        ["reproduce", "--out", "report", "--experiment", "mine.toml", "--preset", "paper"],
        "--experiment and --preset each name an experiment; give one of them",
    ),
    (
        ["reproduce", "--out", "report", "--seed", "2147483647", "--seeds", "2"],
        "--seed and --seeds lead to seed 2147483648; the last one must be between 0 and 2147483647",
    ),
    (
        ["sweep", "pretrained/hierarchical", "--out", "maps", "--spacing", "9"],
        "--spacing: scenario.traffic.spacing minus scenario.traffic.spacing_jitter must be more",
    ),
    (["bench", "wrld"], "PARTS must be one of start-up, world, latency"),
    (["bench", "--seconds", "0"], "--seconds must be between 0.1 and 3600 s, got 0.0"),
    (["reproduce", "--out", "report", "--scenario.lanes", "0"], "must be between 2 and 8, got 0"),
]


@pytest.mark.parametrize(("words", "hint"), REFUSALS)
def test_refusals(words, hint, capsys, inside):
    assert main(words) == 2
    output = capsys.readouterr()
    assert output.out == ""
    assert output.err.startswith("lanewise: error: ")
    assert hint in output.err
    assert len(output.err.splitlines()) <= 2
    assert max(map(len, output.err.splitlines())) < 250
    assert os.listdir(inside) == []


def test_bad_settings_file(capsys, inside):
    (inside / "mine.toml").write_text("[scenario]\nlanes = 0\n")
    assert main([*TRAIN, "--settings", "mine.toml"]) == 2
    assert "scenario.lanes must be between 2 and 8, got 0" in capsys.readouterr().err
    (inside / "mine.toml").write_text("[scenario]\ntrap_sped = 0\n")
    assert main([*TRAIN, "--settings", "mine.toml"]) == 2
    assert "did you mean scenario.trap_speed?" in capsys.readouterr().err
    assert os.listdir(inside) == ["mine.toml"]


@pytest.mark.parametrize(
    "words",
    [
        ["--help"],
        [],
        ["--version"],
        ["train", "--help"],
        ["evaluate", "-h"],
        ["compare", "--help"],
        ["watch", "--help"],
        ["sweep", "--help"],
        ["reproduce", "--help"],
    ],
)
def test_help_never_imports_jax(words):
    done = run_process(*words)
    assert done.returncode == 0, done.stderr
    assert done.stderr == ""
    assert done.stdout


@pytest.mark.parametrize(
    "words",
    [
        [*TRAIN, "--scenario.lanes", "0"],
        ["evaluate", "absent"],
        ["compare", "absent", "absent"],
        ["trian"],
    ],
)
def test_refusals_never_import_jax(words):
    done = run_process(*words)
    assert done.returncode == 2, done.stderr
    assert "Traceback" not in done.stderr


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["evaluate", "pretrained/single-level", "--episodes-out", "/proc/a/b.csv"], "/proc/a/b"),
        (["watch", "pretrained/single-level", "-o", "/proc/a/b.gif"], "cannot write /proc/a/b.gif"),
        (["bench", "--out", "/proc/a/b.json"], "cannot write /proc/a/b.json: No such file"),
        (["export", "pretrained/single-level", "-o", "/proc/a/b.npz"], "cannot write /proc/a/b"),
        (["compare", *["pretrained/single-level"] * 2, "--csv", "/proc/a.csv"], "/proc/a.csv"),
        (["sweep", "pretrained/single-level", "--out", "."], "not an empty folder"),
        (["reproduce", "--out", "."], "is not empty and holds no run"),
        ([*TRAIN, "--high-level", "young"], "young has no finished step-1"),
        ([*TRAIN[:-1], ".", "--high-level", "lender"], "is not empty and holds no run"),
        (
            [*TRAIN, "--high-level", "lender", "--goals.time-limit", "7"],
            "goals or driving settings",
        ),
    ],
)
def test_folders_and_files_that_do_not_do_are_refused_without_jax(inside, words, said):
    (inside / "notes.txt").write_text("mine")
    for name in ("lender", "young"):
        RunFolder.create(inside / name, Settings(), "planned", 0).close()
    (inside / "lender" / "stages").mkdir()
    (inside / "lender" / "stages" / "step-1.json").touch()
    done = run_process(*words)
    assert done.returncode == 2, done.stderr
    assert said in done.stderr
    assert sorted(os.listdir(inside)) == ["lender", "notes.txt", "young"]


def test_a_list_takes_every_word_that_belongs_to_no_flag():
    words = ["a", "--episodes", "5", "b", "--json", "c", "--csv=d.csv"]
    parsed = parse(compare.Compare, words)
    assert parsed.command.runs == tuple(map(pathlib.Path, "abc"))
    assert (parsed.command.episodes, parsed.command.json) == (5, True)
    assert parsed.command.csv == pathlib.Path("d.csv")


def test_help_shows_a_list_as_required(capsys):
    assert main(["compare", "--help"]) == 0
    output = " ".join(capsys.readouterr().out.replace("│", " ").split())
    assert output.startswith("usage: lanewise compare [-h] [OPTIONS] PATH [PATH ...]")
    assert "differences are to the first. (required)" in output


def test_version(capsys):
    assert main(["--version"]) == 0
    assert capsys.readouterr().out == f"lanewise {__version__}\n"


def test_help_lists_every_command(capsys):
    assert main([]) == 0
    output = capsys.readouterr().out
    assert all(name in output for name in cli.COMMANDS)


@pytest.mark.parametrize("encoding", ["ascii", "latin-1", "cp1252"])
def test_nothing_fails_for_want_of_a_letter(encoding, monkeypatch):
    """`PYTHONIOENCODING=ascii:strict lanewise --help`, and whatever else is printed."""
    monkeypatch.setattr(provenance, "_processor", lambda: "Intel® Core™ 日本")
    streams = {
        name: io.TextIOWrapper(io.BytesIO(), encoding=encoding, errors="strict")
        for name in ("stdout", "stderr")
    }
    for name, stream in streams.items():
        monkeypatch.setattr(sys, name, stream)
    for words in ([], *([command] for command in cli.COMMANDS)):
        assert main([*words, "--help"]) == 0
    assert main(["doctor"]) == 0
    assert main(["evaluate", "größe 日本"]) == 2
    monkeypatch.undo()
    said = {name: stream.buffer.getvalue().decode(encoding) for name, stream in streams.items()}
    assert "Core" in said["stdout"]
    assert "\\u65e5\\u672c" in said["stdout"]
    assert "\\u65e5\\u672c" in said["stderr"]


@pytest.mark.parametrize("command", ["train", "reproduce"])
def test_help_lists_every_setting_with_text_default_and_range(command, capsys, monkeypatch):
    from lanewise import config

    assert main([command, "--help"]) == 0
    output = " ".join(capsys.readouterr().out.replace("│", " ").split())
    for name in config.kinds():
        assert f"--{name.replace('_', '-')} " in output
    expected = "Speed of both trap cars, all episode long. [between 0.5 and 40 m/s] (default: 10.0)"
    assert expected in output
    assert "{previous-goal,current-state}" in output


def test_no_setting_is_without_help():
    from lanewise.commands.docstrings import of_fields

    for owner in {type(part) for part in _parts(Settings())} | set(cli.COMMANDS.values()):
        assert set(of_fields(owner)) == set(owner.__dataclass_fields__), owner


def _parts(part):
    yield part
    for name in part.__dataclass_fields__:
        value = getattr(part, name)
        if hasattr(value, "__dataclass_fields__"):
            yield from _parts(value)


def test_an_existing_run_is_not_overwritten(capsys, inside):
    RunFolder.create(pathlib.Path("run"), Settings(), "hierarchical", 0).close()
    before = {path.name: path.read_bytes() for path in (inside / "run").iterdir()}
    for words, hint in [
        (TRAIN, "run holds a run already; --resume continues it"),
        (["train", "single-level", "--out", "run", "--resume"], "trains hierarchical, not single"),
        ([*TRAIN, "--resume", "--seed", "1"], "was made with seed 0, not 1"),
        ([*TRAIN, "--resume", "--trap", "trap-10.9"], "scenario.trap_speed is 10.0, not 10.9"),
        (["reproduce", "--out", "run"], "run holds a run already"),
    ]:
        assert main(words) == 2
        assert hint in capsys.readouterr().err
    assert {path.name: path.read_bytes() for path in (inside / "run").iterdir()} == before


def test_train_hands_over_what_was_asked_for(monkeypatch, inside):
    calls = []

    def fake(parsed):
        calls.append(parsed)
        return 0

    monkeypatch.setitem(cli.RUNNERS, "train", fake)
    (inside / "mine.toml").write_text("[goals]\ntime_limit = 6\n")
    words = ["--scenario.trap-speed", "9.5", "--scenario.training-side-distance", "-5", "6"]
    words += ["--low-level.learner.hidden", "64", "32", "16", "--high-level.learner.double=false"]
    words += ["--settings", "mine.toml", "--high_level", "step1", "--driving.reward.speed_weight=2"]
    assert main([*TRAIN, *words]) == 0
    parsed = calls[0]
    command: train.Train = parsed.command
    assert (command.controller, str(command.out), command.seed) == ("hierarchical", "run", 0)
    assert str(command.high_level) == "step1"
    values = command.values
    assert values.scenario.trap_speed == 9.5
    assert values.scenario.training_side_distance == (-5.0, 6.0)
    assert values.low_level.learner.hidden == (64, 32, 16)
    assert values.high_level.learner.double is False
    assert values.low_level.learner.double is True
    assert values.driving.reward.speed_weight == 2.0
    assert values.goals.time_limit == 6.0
    assert parsed.settings_given
    assert main([*TRAIN, "--resume", "--seed", "0"]) == 0
    assert not calls[1].settings_given
    assert {"resume", "seed"} <= calls[1].given


def test_help_says_what_kind_of_value_an_optional_option_takes(capsys):
    """It said PATH for all of them once."""
    assert main(["reproduce", "--help"]) == 0
    output = " ".join(capsys.readouterr().out.replace("│", " ").split())
    assert "--seeds INT" in output
    assert "[between 1 and 1000]" in output
    assert "--settings PATH" in output
