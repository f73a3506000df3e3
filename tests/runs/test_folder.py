import hashlib
import json
import os
import subprocess
import sys

import pytest

from lanewise import config, reading, version
from lanewise.config.settings import Settings
from lanewise.errors import RunError
from lanewise.runs.folder import RunFolder, require_empty


@pytest.fixture
def run(tmp_path):
    path = tmp_path / "run"
    RunFolder.create(path, Settings(), "hierarchical", 3).close()
    return path


def test_what_was_created_is_opened(run):
    folder = RunFolder.open(run)
    assert (folder.settings, folder.controller, folder.seed) == (Settings(), "hierarchical", 3)
    identity = json.loads((run / "run.json").read_text())
    assert identity["settings_digest"] == folder.digest == config.digest(Settings())
    assert identity["version"] == 2
    assert {"lanewise", "created"} <= identity.keys()


def test_a_run_remembers_the_code_that_made_it(run):
    identity = json.loads((run / "run.json").read_text())
    assert {name: identity[name] for name in version.SOURCE} == version.source()
    assert RunFolder.open(run).source == version.source()


def test_a_run_from_before_runs_remembered_their_code_is_still_read(run):
    sign(run, commit=..., clean_tree=..., training=...)
    assert RunFolder.open(run).source == {}


@pytest.mark.parametrize(
    "changed",
    [{"training": "x\x1b[2J"}, {"training": None}, {"commit": "main"}, {"clean_tree": 1}]
    + [{name: ...} for name in ("commit", "clean_tree", "training")],
)
def test_no_other_code_than_one_that_could_be_is_believed(run, changed):
    sign(run, **changed)
    with pytest.raises(RunError, match=r"run\.json is damaged: it does not say which code"):
        RunFolder.open(run)


def sign(run, **changed):
    """Alter what a run says of itself, ... for what is to go, and sign it anew."""
    identity = json.loads((run / "run.json").read_text()) | changed
    identity = {name: value for name, value in identity.items() if value is not ...}
    identity["digest"] = reading.digest(identity)
    (run / "run.json").write_text(json.dumps(identity))


@pytest.mark.parametrize("path", ["new", "new/with/parents", "empty"])
def test_new_and_empty_folders_will_do(tmp_path, path):
    (tmp_path / "empty").mkdir()
    with RunFolder.create(tmp_path / path, Settings(), "single-level", 0) as folder:
        assert folder.path.is_dir()


@pytest.mark.parametrize(
    ("name", "value", "shown"),
    [
        (
            "XLA_FLAGS",
            "--xla_cpu_multi_thread_eigen=false --xla_cpu_enable_fast_math=true",
            "XLA_FLAGS=--xla_cpu_enable_fast_math=true",
        ),
        ("JAX_DISABLE_MOST_OPTIMIZATIONS", "1", "JAX_DISABLE_MOST_OPTIMIZATIONS=1"),
    ],
)
def test_a_run_goes_on_with_the_compiler_it_was_made_with(
    run, tmp_path, monkeypatch, name, value, shown
):
    monkeypatch.setenv(name, value)
    with pytest.raises(RunError, match=f"there none, here {shown}"):
        RunFolder.resume(run)
    other = tmp_path / "other"
    RunFolder.create(other, Settings(), "hierarchical", 3).close()
    RunFolder.resume(other).close()
    monkeypatch.delenv(name)
    with pytest.raises(RunError, match=f"there {shown}, here none"):
        RunFolder.resume(other)
    monkeypatch.setenv("XLA_FLAGS", "--xla_cpu_multi_thread_eigen=false")
    RunFolder.resume(run).close()


def test_a_run_is_not_overwritten(run):
    before = {path.name: path.read_bytes() for path in run.iterdir()}
    with pytest.raises(RunError, match="holds a run already; --resume continues it"):
        RunFolder.create(run, Settings(), "hierarchical", 3)
    assert {path.name: path.read_bytes() for path in run.iterdir()} == before


def test_other_things_are_not_overwritten(tmp_path):
    (tmp_path / "thesis.tex").write_text("precious")
    with pytest.raises(RunError, match="not empty and holds no run"):
        RunFolder.create(tmp_path, Settings(), "hierarchical", 0)
    with pytest.raises(RunError, match="is not a folder"):
        require_empty(tmp_path / "thesis.tex")
    assert os.listdir(tmp_path) == ["thesis.tex"]


def test_a_run_killed_while_being_made_can_be_made_again(run):
    (run / "run.json").rename(run / "run.json.partial")
    RunFolder.create(run, Settings(), "hierarchical", 3).close()
    assert RunFolder.open(run).seed == 3


def test_resume_takes_what_is_not_given_from_the_run(run):
    with RunFolder.resume(run) as folder:
        assert (folder.controller, folder.seed) == ("hierarchical", 3)
    with RunFolder.resume(run, Settings(), "hierarchical", 3) as folder:
        assert folder.settings == Settings()


@pytest.mark.parametrize(
    ("other", "hint"),
    [
        ({"settings": config.compose(trap="trap-10.9")}, "scenario.trap_speed is 10.0, not 10.9"),
        ({"controller": "single-level"}, "trains hierarchical, not single-level"),
        ({"seed": 4}, "was made with seed 3, not 4"),
    ],
)
def test_resume_refuses_another_run(run, other, hint):
    with pytest.raises(RunError) as caught:
        RunFolder.resume(run, **other)
    assert hint in str(caught.value)
    # The refusal holds no lock.
    RunFolder.resume(run).close()


@pytest.mark.parametrize("operation", [RunFolder.open, RunFolder.resume])
def test_a_missing_run_says_what_was_looked_for(tmp_path, operation):
    with pytest.raises(RunError, match=r"no run in .*absent: looked for .*absent/run\.json"):
        operation(tmp_path / "absent")


@pytest.mark.parametrize(
    ("file", "text", "hint"),
    [
        ("run.json", "{", "not valid JSON"),
        ("run.json", "[" * 50_000, "not valid JSON"),
        ("run.json", "[]", "does not describe a run"),
        ("run.json", " " * 200_000, "too large"),
        ("run.json", '{"format": "lanewise-run", "version": 9}', "has format version 9; this"),
        (
            "run.json",
            '{"format": "lanewise-run-3", "lanewise": "7.0.0"}',
            "has format lanewise-run-3 version 1, written by lanewise 7.0.0; this",
        ),
        ("run.json", '{"format": "lanewise-run", "version": 2}', "no controller or seed"),
        ("settings.toml", "", "altered after the run was made|other"),
        ("settings.toml", "[scenario]\nlanes = 0\n", "scenario.lanes must be between"),
        ("settings.toml", "[scenario]\nlanes = 4\n", "altered after the run was made"),
    ],
)
def test_damaged_runs(tmp_path, file, text, hint):
    path = tmp_path / "run"
    RunFolder.create(path, config.compose(trap="trap-10.9"), "hierarchical", 3).close()
    (path / file).write_text(text)
    with pytest.raises(RunError, match=hint) as caught:
        RunFolder.open(path)
    assert len(str(caught.value).splitlines()) == 1


def test_missing_settings(run):
    (run / "settings.toml").unlink()
    with pytest.raises(RunError, match="cannot read settings file"):
        RunFolder.open(run)


def test_a_killed_process_leaves_no_lock(run):
    script = (
        "import sys; from pathlib import Path; from lanewise.runs.folder import RunFolder\n"
        f"folder = RunFolder.resume(Path({str(run)!r}))\n"
        "print('locked', flush=True)\n"
        "sys.stdin.read()"
    )
    holder = subprocess.Popen(
        [sys.executable, "-c", script], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    )
    with holder:
        assert holder.stdout.readline() == "locked\n"
        with pytest.raises(RunError, match="is in use: another process is training in it"):
            RunFolder.resume(run)
        holder.kill()
    RunFolder.resume(run).close()


def test_the_lock_is_exclusive_within_a_process_too(run):
    with RunFolder.resume(run), pytest.raises(RunError, match="is in use"):
        RunFolder.resume(run)
    RunFolder.resume(run).close()


def test_a_lock_file_that_is_deleted_lets_nobody_in(run):
    with RunFolder.resume(run):
        (run / "lock").unlink(missing_ok=True)
        with pytest.raises(RunError, match="is in use: another process is training in it"):
            RunFolder.resume(run)
        for file in run.iterdir():
            file.unlink()
        with pytest.raises(RunError, match="is in use"):
            RunFolder.create(run, Settings(), "hierarchical", 3)


def test_settings_of_the_users_own_are_not_written_over(tmp_path):
    """`train --settings DIR/settings.toml --out DIR`; a run half made looks different."""
    (tmp_path / "settings.toml").write_text("# mine")
    with pytest.raises(RunError, match="not empty and holds no run"):
        RunFolder.create(tmp_path, Settings(), "hierarchical", 3)
    assert (tmp_path / "settings.toml").read_text() == "# mine"


def test_no_run_is_made_inside_another(run):
    before = sorted(run.rglob("*"))
    with pytest.raises(RunError, match=r"inside belongs to the run in .*run; choose another"):
        RunFolder.create(run / "inside", Settings(), "hierarchical", 3)
    assert sorted(run.rglob("*")) == before


def test_a_run_from_before_a_setting_is_still_read(tmp_path):
    """As a later version would find it: a setting that is not in the file has its default."""
    with RunFolder.create(tmp_path / "run", config.compose(), "single-level", 3) as made:
        old = (made.path / "settings.toml").read_text().splitlines()
    kept = "\n".join(line for line in old if not line.startswith("hold = ")) + "\n"
    assert len(kept) < len("\n".join(old))
    (made.path / "settings.toml").write_text(kept)
    manifest = json.loads((made.path / "run.json").read_text())
    manifest["settings_digest"] = hashlib.sha256(kept.encode()).hexdigest()
    del manifest["digest"]  # which such a run does not have
    (made.path / "run.json").write_text(json.dumps(manifest))
    found = RunFolder.open(made.path)
    assert found.settings == config.compose()
    assert found.digest == manifest["settings_digest"]
