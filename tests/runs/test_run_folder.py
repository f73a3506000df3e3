"""Run folders: what they remember, who may write to them, and what is refused."""

import json

import pytest
import small_runs

from lanewise import config
from lanewise.config.settings import Settings
from lanewise.errors import LanewiseError, RunError
from lanewise.runs.run_folder import RunFolder, require_empty
from lanewise.system import version


@pytest.fixture
def run(tmp_path):
    path = tmp_path / "run"
    RunFolder.create(path, Settings(), "hierarchical", 3).close()
    return path


def test_what_was_created_is_opened(run):
    folder = RunFolder.open(run)
    assert (folder.settings, folder.controller, folder.seed) == (Settings(), "hierarchical", 3)
    assert folder.source == version.source()
    identity = json.loads((run / "run.json").read_text())
    assert identity["settings_digest"] == folder.digest == config.digest(Settings())
    assert {name: identity[name] for name in version.SOURCE} == version.source()
    assert {"lanewise", "created"} <= identity.keys()


def test_new_and_empty_folders_will_do(tmp_path):
    (tmp_path / "empty").mkdir()
    for path in ("new/with/parents", "empty"):
        with RunFolder.create(tmp_path / path, Settings(), "single-level", 0) as folder:
            assert folder.path.is_dir()


def test_a_run_goes_on_with_the_compiler_it_was_made_with(tmp_path, monkeypatch):
    run, other, harmless = (
        tmp_path / "run",
        tmp_path / "other",
        "--xla_cpu_multi_thread_eigen=false",
    )
    shown = "XLA_FLAGS=--xla_cpu_enable_fast_math=true"
    for name in ("XLA_FLAGS", "JAX_DISABLE_MOST_OPTIMIZATIONS"):
        monkeypatch.delenv(name, raising=False)
    RunFolder.create(run, Settings(), "hierarchical", 3).close()
    monkeypatch.setenv("XLA_FLAGS", f"{harmless} --xla_cpu_enable_fast_math=true")
    with pytest.raises(RunError, match=f"there none, here {shown}"):
        RunFolder.resume(run)
    RunFolder.create(other, Settings(), "hierarchical", 3).close()
    RunFolder.resume(other).close()
    monkeypatch.setenv("XLA_FLAGS", harmless)
    with pytest.raises(RunError, match=f"there {shown}, here none"):
        RunFolder.resume(other)
    RunFolder.resume(run).close()


def test_a_run_is_not_overwritten(run):
    before = small_runs.everything(run)
    with pytest.raises(RunError, match="holds a run already; --resume continues it"):
        RunFolder.create(run, Settings(), "hierarchical", 3)
    with pytest.raises(RunError, match=r"inside belongs to the run in .*run; choose another"):
        RunFolder.create(run / "inside", Settings(), "hierarchical", 3)
    assert small_runs.everything(run) == before


@pytest.mark.parametrize("name", ["thesis.tex", "settings.toml"])
def test_other_things_are_not_overwritten(tmp_path, name):
    """`train --settings DIR/settings.toml --out DIR` too; a run half made looks different."""
    (tmp_path / name).write_text("precious")
    with pytest.raises(RunError, match="not empty and holds no run"):
        RunFolder.create(tmp_path, Settings(), "hierarchical", 0)
    with pytest.raises(RunError, match="is not a folder"):
        require_empty(tmp_path / name)
    assert (tmp_path / name).read_text() == "precious"


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


@pytest.mark.parametrize(
    ("file", "text", "hint"),
    [
        ("run.json", None, r"no run in .*run: looked for .*run/run\.json"),
        ("run.json", "{", "not valid JSON"),
        ("run.json", " " * 200_000, "too large"),
        ("run.json", '{"format": "lanewise-run", "version": 9}', "has format version 9; this"),
        ("run.json", '{"format": "lanewise-run", "version": 2}', "was altered: its digest"),
        ("settings.toml", "[scenario]\nlanes = 4\n", "altered after the run was made"),
        ("settings.toml", None, "cannot read .*settings.toml: No such"),
    ],
)
def test_damaged_runs(run, file, text, hint):
    (run / file).unlink()
    if text is not None:
        (run / file).write_text(text)
    with pytest.raises(LanewiseError, match=hint) as caught:
        RunFolder.open(run)
    assert len(str(caught.value).splitlines()) == 1


def test_the_folder_itself_is_locked_whatever_is_deleted_in_it(run):
    with RunFolder.resume(run):
        with pytest.raises(RunError, match="is in use"):
            RunFolder.resume(run)
        for file in run.iterdir():
            file.unlink()
        with pytest.raises(RunError, match="is in use: another process is training in it"):
            RunFolder.create(run, Settings(), "hierarchical", 3)
    RunFolder.create(run, Settings(), "hierarchical", 3).close()
