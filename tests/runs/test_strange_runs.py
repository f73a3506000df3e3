"""A stranger's run leads nowhere else: neither what is read nor what is written when it goes on."""

import json
import os
import shutil
import sys
import tracemalloc
from contextlib import suppress

import numpy as np
import pytest

import untrusted_files
from lanewise import config, reading
from lanewise.errors import CheckpointError, LanewiseError, RunError, SettingsError
from lanewise.experiments import experiment, work
from lanewise.export import numpy_policy
from lanewise.runs import resume, trained, views
from lanewise.runs.files import OpenFolder
from lanewise.runs.folder import RunFolder
from lanewise.runs.metrics import MetricsWriter
from lanewise.settings import Settings


@pytest.fixture
def run(tmp_path):
    path = tmp_path / "run"
    RunFolder.create(path, Settings(), "hierarchical", 3).close()
    return path


@pytest.fixture(scope="module")
def place(tmp_path_factory):
    path = tmp_path_factory.mktemp("strangers")
    untrusted_files.make(path)
    return path


@pytest.mark.parametrize("open_it", [RunFolder.open, RunFolder.resume])
@pytest.mark.parametrize(
    "name",
    [
        *("run.json", "settings.toml", "metrics.jsonl", "timings.jsonl", "episodes.csv"),
        *("chunks.csv", "checkpoints", "stages", "tensorboard", "diverged"),
    ],
)
def test_a_link_in_a_run_is_refused_and_its_target_untouched(run, tmp_path, name, open_it):
    """Going on would cut the file short, or delete from the folder."""
    elsewhere = tmp_path / "precious"
    if name in ("checkpoints", "stages", "tensorboard", "diverged"):
        elsewhere.mkdir()
        (elsewhere / "thesis.json").write_text("precious")
    else:
        elsewhere.write_bytes((run / name).read_bytes() if (run / name).exists() else b"precious")
    before = elsewhere.stat()
    (run / name).unlink(missing_ok=True)
    (run / name).symlink_to(elsewhere)
    with pytest.raises(RunError, match=rf"{name}: (a link, not a regular file|not a folder)"):
        open_it(run)
    assert elsewhere.stat() == before


@pytest.mark.parametrize("resume_at", [0, None])
def test_a_second_name_of_the_metrics_is_not_cut_short(tmp_path, resume_at):
    """Backups keep old states of a run as hard links."""
    kept = tmp_path / "backup.jsonl"
    kept.write_text('{"kind": "chunk"}\nhalf a li')
    os.link(kept, tmp_path / "metrics.jsonl")
    with pytest.raises(RunError, match=r"metrics.jsonl: another name .* resume the copy"):
        MetricsWriter(tmp_path / "metrics.jsonl", resume_at)
    assert kept.read_text().endswith("half a li")


def test_a_second_name_of_a_table_keeps_what_it_has(tmp_path):
    kept = tmp_path / "backup.csv"
    kept.write_text("precious")
    os.link(kept, tmp_path / views.FILES["chunk"])
    views.Table(OpenFolder(tmp_path), "chunk").close()
    assert kept.read_text() == "precious"
    assert (tmp_path / views.FILES["chunk"]).read_text().startswith("stage,")


@pytest.mark.parametrize("name", ["metrics.jsonl", "settings.toml"])
def test_a_pipe_is_not_waited_for(run, name):
    (run / name).unlink(missing_ok=True)
    os.mkfifo(run / name)
    with pytest.raises(RunError, match="a pipe or a device"):
        RunFolder.resume(run)
    with pytest.raises(RunError, match="a pipe or a device"):
        MetricsWriter(run / name)


def test_an_altered_identity_is_noticed_and_one_without_a_digest_is_from_before(run):
    manifest = json.loads((run / "run.json").read_text())
    (run / "run.json").write_text(json.dumps(manifest | {"seed": 4}))
    with pytest.raises(RunError, match="was altered: its digest is not its own"):
        RunFolder.open(run)
    del manifest["digest"]
    (run / "run.json").write_text(json.dumps(manifest))
    assert RunFolder.open(run).seed == 3
    (run / "run.json").write_text(json.dumps(manifest | {"sed": 3}))
    with pytest.raises(RunError, match='it has no field "sed"'):
        RunFolder.open(run)


@pytest.mark.parametrize("seed", [-1, 2**31, 10**30, True, "3"])
def test_a_seed_is_one_that_a_command_takes(run, tmp_path, seed):
    with pytest.raises(RunError, match="seed must be"):
        RunFolder.create(tmp_path / "new", Settings(), "hierarchical", seed)
    assert not (tmp_path / "new").exists()
    manifest = json.loads((run / "run.json").read_text()) | {"seed": seed}
    del manifest["digest"]
    (run / "run.json").write_text(json.dumps(manifest))
    with pytest.raises(RunError, match="seed"):
        RunFolder.open(run)


def test_a_lost_stage_is_not_trained_anew_over_what_came_after(place, tmp_path):
    folder = RunFolder.open(place / "whole" / "stopped run" / "run")
    lost = folder.stages / "step-1.json"
    kept = lost.read_bytes()
    lost.unlink()
    with pytest.raises(CheckpointError, match=r"step-1.json is missing, though stage-01"):
        resume.read(folder)
    lost.write_bytes(kept)
    assert resume.read(folder).checkpoint.name == "stage-01-chunk-00000003"


def test_a_finished_run_has_the_metrics_it_was_written_with(place):
    folder = RunFolder.open(place / "whole" / "metrics of a finished run" / "run")
    whole = folder.metrics.read_bytes()
    assert len(trained.lines(folder)) == 2
    for altered in (whole.replace(b"1.5", b"1.6", 1), whole + whole.splitlines(keepends=True)[-1]):
        folder.metrics.write_bytes(altered)
        with pytest.raises(RunError, match="was altered"):
            trained.lines(folder)
    folder.metrics.write_bytes(whole)


def test_a_test_from_before_is_held_against_its_episodes(place, tmp_path):
    """It has no digests, but its figures follow from its episodes."""
    tests = place / "whole" / "stored test" / "tests"
    (tmp_path / "tests").mkdir()
    stored = json.loads((tests / "lanewise.json").read_text())
    del stored["digest"], stored["episodes_sha256"], stored["run"]
    table = (tests / "lanewise.csv").read_text()
    (tmp_path / "tests" / "lanewise.csv").write_text(table)
    (tmp_path / "tests" / "lanewise.json").write_text(json.dumps(stored))
    assert work.read_test(untrusted_files.tested(tmp_path), "lanewise").summary.episodes == 40
    (tmp_path / "tests" / "lanewise.csv").write_text(table.replace(",25.0,", ",24.0,", 1))
    with pytest.raises(RunError, match="do not agree; delete it"):
        work.read_test(untrusted_files.tested(tmp_path), "lanewise")


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ({"seconds": -1.0}, "is damaged; delete it"),
        ({"seconds": 1e12}, "is damaged; delete it"),
        ({"seconds": "3"}, "is damaged; delete it"),
        ({"luck": 1}, "is damaged; delete it"),
        ({"digest": None}, "is damaged; delete it"),
        ({"summary": {"episodes": "40"}}, "is damaged; delete it"),
        ({"summary": {"episodes": 40}}, "is damaged; delete it"),
        ({"episodes_sha256": "0" * 64}, "was altered; delete it"),
        ({"run": None}, "is a test of another run; delete it"),
        ({"run": {"seed": 0}}, "is a test of another run; delete it"),
    ],
)
def test_a_stored_test_signed_anew_is_checked_all_the_same(place, tmp_path, change, says):
    shutil.copytree(place / "whole" / "stored test", tmp_path, dirs_exist_ok=True)
    tests = tmp_path / "tests"
    stored = json.loads((tests / "lanewise.json").read_text()) | change
    if stored.pop("digest") is not None:
        stored["digest"] = reading.digest(stored)
    (tests / "lanewise.json").write_text(json.dumps(stored))
    with pytest.raises(RunError, match=says):
        work.read_test(untrusted_files.tested(tmp_path), "lanewise")


FUTURE = {"version": 9, "lanewise": "7.0.0"}


def load_altered(place, target, file, changes, tmp_path):
    """What is said of a file of JSON, or of one with a line of it, after some changes."""
    folder = shutil.copytree(place / "whole" / target, tmp_path / target)
    head, *lines = (folder / file).read_text().splitlines() if "jsonl" in file else [None]
    document = json.loads(head or (folder / file).read_text()) | changes
    (folder / file).write_text("\n".join([json.dumps(document), *lines]) + "\n")
    load = next(each.load for each in untrusted_files.TARGETS if each.name == target)
    with pytest.raises(LanewiseError) as caught:
        load(folder)
    return str(caught.value)


@pytest.mark.parametrize(
    ("target", "file"),
    [
        ("finished run", "run/run.json"),
        ("finished run", "run/controller.json"),
        ("stopped run", "run/checkpoints/stage-01-chunk-00000003.json"),
        ("stopped run", "run/stages/step-1.json"),
        ("stored test", "tests/lanewise.json"),
        ("journal of a sweep", "progress.jsonl"),
    ],
)
def test_what_is_of_a_future_format_says_its_version(place, tmp_path, target, file):
    said = load_altered(place, target, file, FUTURE, tmp_path / "a")
    assert f"{file.split('/')[-1]} has format version 9, written by lanewise 7.0.0; this" in said
    assert said.endswith("use the one that wrote it, or a newer one")
    said = load_altered(place, target, file, FUTURE | {"format": "new"}, tmp_path / "b")
    assert "has format new version 9, written by lanewise 7.0.0; this lanewise" in said
    assert len(said.splitlines()) == 1


@pytest.mark.parametrize("text", ["[]", "3", "null"])
def test_a_stored_test_is_an_object(place, tmp_path, text):
    folder = shutil.copytree(place / "whole" / "stored test", tmp_path / "run")
    (folder / "tests" / "lanewise.json").write_text(text)
    with pytest.raises(RunError, match="is damaged; delete it"):
        work.read_test(untrusted_files.tested(folder), "lanewise")


def test_a_policy_of_a_future_format_says_its_version(place, tmp_path):
    """Whatever its arrays are by then."""
    with np.load(place / "whole" / "exported policy, planned" / "policy.npz") as arrays:
        found = dict(arrays)
    about = json.loads(found.pop("about").item()) | FUTURE
    np.savez(tmp_path / "p.npz", about=np.asarray(json.dumps(about)), half=np.zeros(3, np.float16))
    with pytest.raises(numpy_policy.PolicyError) as caught:
        numpy_policy.load(tmp_path / "p.npz")
    assert "has format lanewise-policy version 9, written by lanewise 7.0.0; this" in str(
        caught.value
    )


def test_a_stored_test_is_no_larger_than_one_can_be(place, tmp_path):
    """Millions of small things would be read one by one before they are refused."""
    tests = tmp_path / "tests"
    shutil.copytree(place / "whole" / "stored test" / "tests", tests)
    (tests / "lanewise.json").write_text("[" + '{"a":[],"b":{}},' * 10_000 + "0]\n")
    with pytest.raises(RunError, match=r"lanewise.json: too large: larger than 100000 bytes"):
        work.read_test(untrusted_files.tested(tmp_path), "lanewise")


def test_tests_are_neither_written_nor_read_through_a_link(place, tmp_path):
    """It may lead to those of another run, or to what is no test at all."""
    elsewhere = shutil.copytree(place / "whole" / "stored test" / "tests", tmp_path / "precious")
    before = {path: path.read_bytes() for path in elsewhere.iterdir()}
    (tmp_path / "run").mkdir()
    (tmp_path / "run" / "tests").symlink_to(elsewhere)
    job, episodes = untrusted_files.tested(tmp_path / "run"), untrusted_files.made_up_episodes(1)
    for use in (
        lambda: work.read_test(job, "lanewise"),
        lambda: work.is_tested(job, "lanewise", 40),
        lambda: work._store(OpenFolder(job.path), "hierarchical", "lanewise", episodes, 1.5, {}),
    ):
        with pytest.raises(RunError, match=r"cannot use .*tests: not a folder; delete it"):
            use()
    assert {path: path.read_bytes() for path in elsewhere.iterdir()} == before


@pytest.mark.parametrize("leads", [True, False], ids=["somewhere", "nowhere"])
def test_settings_of_a_reference_driver_are_no_link(tmp_path, leads):
    job = work.Job("a", "rule-based", False, Settings(), 0, tmp_path / "run", None, {})
    job.path.mkdir()
    file = job.path / work.SETTINGS
    file.write_text(config.dump_toml(Settings()))
    work.check(job)
    file.rename(tmp_path / "elsewhere.toml")
    file.symlink_to(tmp_path / ("elsewhere.toml" if leads else "nothing"))
    with pytest.raises(RunError, match=r"cannot read .*settings.toml: a link"):
        work.check(job)


HEAD = 'title = "t"\nepisodes = 1\nhighway_env_episodes = 0\n'


@pytest.mark.parametrize(
    ("text", "says"),
    [
        (HEAD + "seeds = " + "9" * 5000, "not valid TOML"),
        (HEAD + ".".join("a" * 40_000) + " = 1", "a line has more than 32 dots"),
        (HEAD + "a" * 50_000 + " = 1", 'an experiment has no "aaa'),
        (HEAD + "seeds = 1\n" + "".join(f"[arms.a{n}]\n" for n in range(101)), "at most 100 arms"),
        (HEAD.replace('"t"', '"' + "t" * 201 + '"') + 'seeds = 1\n[arms.a]\ncontroller = "h-dqn"',
         "longer than 200"),
        (HEAD + f'seeds = 1\n[arms.{"a" * 81}]\ncontroller = "h-dqn"', "at most 80"),
    ],
)  # fmt: skip
def test_experiments_that_take_for_ever_are_refused_at_once(text, says):
    with pytest.raises(SettingsError, match=says):
        experiment.parse("x", text)


SIZE = 10_000
LINES_A_BYTE, MEMORY_A_BYTE = 150, 700
"""What reading may take: lines of Python and bytes; what grows with the square takes far more."""
LONG = {
    **{
        f"a key over what is no line end, {ord(end):#x}": f'"{end}".' * (SIZE // 5) + "a = 1"
        for end in "\x85\u2028\u2029"
    },
    "a dotted key": "a." * (SIZE // 2) + "a = 1",
    "dotted keys in a deep table": "[" + ".".join("a" * 33) + "]\n"
    + "".join(f"a{n}." + ".".join("b" * 32) + " = 1\n" for n in range(SIZE // 75)),
    "deep tables": "".join(f"[a{n}." + ".".join("b" * 32) + "]\n" for n in range(SIZE // 75)),
    "deep lists of tables": "".join(f"[[{'.'.join('a' * (n % 32 + 1))}]]\n" for n in range(250)),
    "tables": "".join(f"[t{n}]\n" for n in range(SIZE // 8)),
    "keys": "".join(f"k{n} = 1\n" for n in range(SIZE // 10)),
    "keys in a line": "a = {" + ",".join(f"k{n}=1" for n in range(SIZE // 8)) + "}",
    "lists in lists": "a = " + "[" * (SIZE // 2) + "]" * (SIZE // 2),
    "tables in tables": "a = " + "{b = " * (SIZE // 6) + "1" + "}" * (SIZE // 6),
    "many lists in lists": "a = [" + ("[" * 100 + "]" * 100 + ",") * (SIZE // 201) + "]",
    "a list": "a = [" + "1," * (SIZE // 2) + "]",
    "a number": "a = " + "1" * SIZE,
    "a fraction": "a = 0." + "1" * SIZE,
    "numbers that just fit": "".join(f"a{n} = {'1' * 3990}\n" for n in range(SIZE // 4000)),
    "no numbers": ("a = " + "1" * 3990 + "x") * (SIZE // 4000),
    "a text": 'a = """' + "\\n" * (SIZE // 2) + '"""',
    "comments": "#\n" * (SIZE // 2),
}  # fmt: skip


@pytest.mark.parametrize("text", LONG.values(), ids=LONG)
def test_the_cost_of_reading_toml_grows_with_its_length_alone(text):
    """Counted, as a clock would tell more of the machine."""
    data = text.encode()[: 2 * SIZE]
    left = LINES_A_BYTE * len(data)

    def count(*_):
        nonlocal left
        left -= 1
        assert left > 0, "too many lines"
        return count

    sys.settrace(count)
    try:
        with suppress(ValueError):
            reading.toml_table(data)
    finally:
        sys.settrace(None)
    tracemalloc.start()
    try:
        with suppress(ValueError):
            reading.toml_table(data)
        assert tracemalloc.get_traced_memory()[1] < MEMORY_A_BYTE * len(data)
    finally:
        tracemalloc.stop()


def test_lines_are_those_of_toml():
    """A separator in a comment or a text begins no line; a line feed begins the next key."""
    found = reading.toml_table("a = 1 # \u2028 .\nb = '\u2028'\nc.d = 1.5".encode())
    assert found == {"a": 1, "b": "\u2028", "c": {"d": 1.5}}


def test_a_number_of_too_many_digits_is_named():
    with pytest.raises(ValueError, match=r"^b\.c: a whole number of so many digits"):
        reading.toml_table(b"a = 1\nb.c = " + b"1" * 5000)


def test_a_network_has_so_many_layers_and_no_more():
    config.compose(flags={"high_level.learner.hidden": [8] * 16})
    with pytest.raises(SettingsError, match="at most 16 layers, got 17"):
        config.compose(flags={"high_level.learner.hidden": [8] * 17})


def test_devices_and_what_is_no_file_are_no_settings(tmp_path):
    for name in ("/dev/zero", "/proc/self/status"):
        with pytest.raises(LanewiseError, match=f"cannot read settings file {name}: .*not a reg"):
            config.load_toml(untrusted_files.Path(name))
