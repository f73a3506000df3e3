"""The main job, end to end, at the smallest size that is still the paper's test."""

import json
import shutil
import subprocess
import sys

import pytest

from lanewise.cli.main import main
from lanewise.experiments import drives, experiment_folder, schedule
from lanewise.report import provenance
from lanewise.system import folder_io, version

TINY = [
    *("--episodes", "3", "--highway-env-episodes", "1"),
    *("--evaluation.validation-episodes", "2", "--planner.preview", "2"),
]
for stage in ("single-level", "high-level", "low-level"):
    TINY += [f"--{stage}.decisions", "100", f"--{stage}.worlds", "2"]
    TINY += [f"--{stage}.learner.hidden", "8", "8", f"--{stage}.learner.warm-up", "50"]


def reproduce(out):
    command = [sys.executable, "-m", "lanewise", "reproduce", "--out", str(out), *TINY]
    return subprocess.run(command, capture_output=True, text=True, timeout=600)


@pytest.fixture(scope="module")
def done(tmp_path_factory):
    out = tmp_path_factory.mktemp("reproduce") / "out"
    return out, reproduce(out)


@pytest.mark.slow
def test_it_prints_the_papers_table_with_ours_beside_it(done):
    _, result = done
    assert result.returncode == 0, result.stderr
    for figure in ("13.20", "97.67", "331.6", "3.32", "10.29", "257.3"):
        assert figure in result.stdout
    assert "starts end alike in both worlds" in result.stdout
    assert "[hierarchical, seed 0] step-2: 100%" in result.stderr
    assert "[2/2]" in result.stderr


@pytest.mark.slow
def test_it_leaves_a_report(done):
    out, _ = done
    report = json.loads((out / "report.json").read_text())
    assert (out / "report.md").read_text().count("|") > 50
    for name in ("curves.png", "curves.svg", "clip.gif"):
        assert (out / name).stat().st_size > 1000
    assert "versions" in json.dumps(report)
    for arm in report["arms"]:
        (seed,) = arm["seeds"]
        assert arm["median_seed"] == seed["seed"]
        driven = drives.read(out / "drives" / f"{arm['name']}.npz")
        assert len(driven) == drives.EPISODES
        assert {drive.controller for drive in driven} == {arm["controller"]}
        assert [line["stage"] for line in seed["weights"]][-1] in ("step-2", "single-level")
    assert "## Kept and last weights" in (out / "report.md").read_text()
    trained_by = [seed["trained_by"] for arm in report["arms"] for seed in arm["seeds"]]
    assert trained_by == [version.source()] * 2
    line = provenance.trained_by(trained_by)
    made = (out / "report.md").read_text().partition("## How it was made")[2]
    assert f"\n\n{line}\n\n" in made


def test_a_folder_in_use_is_refused(tmp_path, capsys):
    with folder_io.make_locked(tmp_path / "out", "reproducing"):
        assert main(["reproduce", "--out", str(tmp_path / "out"), *TINY]) == 2
    assert "is in use: another process is reproducing in it" in capsys.readouterr().err


@pytest.mark.slow
def test_a_complete_folder_is_not_overwritten(done):
    out, _ = done
    before = (out / "report.md").read_bytes()
    again = reproduce(out)
    assert again.returncode == 2
    assert again.stderr.startswith("lanewise: error:")
    assert "complete" in again.stderr
    assert (out / "report.md").read_bytes() == before


@pytest.mark.slow
def test_arms_of_another_trap_in_the_folder_are_refused(done, tmp_path):
    """Also where they are not asked for: the report speaks of all arms in the folder."""
    out, _ = done
    folder = tmp_path / "out"
    shutil.copytree(out / "runs" / "single-level", folder / "runs" / "single-level")
    shutil.copy(out / experiment_folder.NAME, folder)
    words = ["--only", "hierarchical", "--trap", "trap-10.9", *TINY]
    command = [sys.executable, "-m", "lanewise", "reproduce", "--out", str(folder), *words]
    result = subprocess.run(command, capture_output=True, text=True, timeout=600)
    assert result.returncode == 2
    assert "single-level/seed-0 was made with other settings: there scenario.trap_speed" in (
        result.stderr
    )
    assert not (folder / "runs" / "hierarchical").exists()


@pytest.mark.slow
def test_a_report_that_lacks_what_is_to_be_done_goes_first(done, tmp_path, monkeypatch, capsys):
    """Else an interruption would leave a folder that looks complete."""
    out, _ = done
    folder = tmp_path / "out"
    shutil.copytree(out, folder)

    def interrupted(*arguments):
        raise KeyboardInterrupt

    monkeypatch.setattr(schedule, "run", interrupted)
    words = ["reproduce", "--out", str(folder), "--seeds", "2", *TINY]
    assert main(words) == 130
    assert not (folder / "report.md").exists()
    assert main(words) == 130
