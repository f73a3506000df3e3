"""Whose a folder is: nothing of anybody else's is written over by a reproduction."""

import shutil

import pytest
from small_runs import everything, moved, stop

from lanewise.cli.main import main
from lanewise.errors import RunError
from lanewise.experiments import experiment, reporting, schedule

QUICK = experiment.load("quick")


def command(out, *words):
    return ["reproduce", "--out", str(out), "--highway-env-episodes", "0", *words]


@pytest.fixture
def stopped(monkeypatch):
    """Reproductions that are stopped before they train anything."""
    monkeypatch.setattr(schedule, "run", stop)


def make(out, *names):
    for name in names:
        path = out / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.mkdir() if name.endswith("/") else path.write_text("precious")


@pytest.mark.parametrize("names", [["runs/hierarchical/"], ["runs/seed-0/", "report.md"]])
def test_a_folder_of_something_else_is_refused_and_untouched(tmp_path, stopped, refused, names):
    out = tmp_path / "out"
    make(out, *names)
    before = everything(out)
    assert "is not empty and holds no run" in refused(*command(out))
    assert everything(out) == before


def test_a_folder_says_whose_it_is_and_is_continued(tmp_path, stopped):
    (tmp_path / "empty").mkdir()
    for name in ("new", "empty"):
        out = tmp_path / name
        assert main(command(out)) == 130
        written = everything(out)
        assert sorted(path.name for path in written) == [experiment.FILE]
        assert main(command(out, "--seeds", "2", "--only", "single-level")) == 130
        assert everything(out) == written


def test_a_folder_of_another_experiment_is_refused(tmp_path, stopped, refused):
    assert main(command(tmp_path / "out")) == 130
    before = everything(tmp_path)
    said = refused(*command(tmp_path / "out", "--preset", "standard"))
    assert 'out holds experiment "quick", not "standard"; choose another folder' in said
    assert everything(tmp_path) == before


def test_what_a_folder_says_is_read_as_a_strangers(tmp_path):
    text = '{"format": "lanewise-experiment", "experiment": "\\u001b[2J"}'
    (tmp_path / experiment.FILE).write_text(text)
    with pytest.raises(RunError, match=r'"\\x1b\[2J", not') as caught:
        experiment.check_folder(tmp_path, QUICK)
    assert len(str(caught.value).splitlines()) <= 2
    assert (tmp_path / experiment.FILE).read_text() == text


def replaced(out):
    shutil.rmtree(out)
    make(out, "experiment.json", "report.md", "runs/hierarchical/seed-0/run.json")


@pytest.mark.parametrize("late", [False, True])
@pytest.mark.parametrize("change", [moved, replaced])
def test_a_report_is_written_into_no_other_folder(tmp_path, monkeypatch, capsys, change, late):
    """Changed while the jobs are done, or while the report is drawn."""
    out, left = tmp_path / "out", {}

    def break_in(*arguments):
        change(out)
        left.update(everything(tmp_path))
        return {}

    def draw(place, *arguments):
        make(place, "figures/a.png", "report.json", reporting.REPORT)
        break_in()
        return "table"

    monkeypatch.setattr(reporting, "_draw", draw)
    monkeypatch.setattr(schedule, "run", (lambda *arguments: {}) if late else break_in)
    assert main(command(out)) == 2
    said = capsys.readouterr().err.splitlines()
    assert f"lanewise: error: {out} was moved, removed or replaced" in said[-2]
    assert everything(tmp_path) == left
    assert list(tmp_path.glob("*/figures")) == []
