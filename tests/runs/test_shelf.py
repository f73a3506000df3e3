"""Controllers called by name instead of a run folder."""

from pathlib import Path

import pytest

from lanewise.errors import RunError
from lanewise.runs import shelf, trained


def test_references_are_called_by_name():
    assert shelf.controller(Path("reference/search")) == "search"
    loaded = trained.load(Path("reference/rule-based"))
    assert (loaded.name, loaded.parameters) == ("rule-based", {})


@pytest.mark.parametrize(
    ("path", "hint"),
    [
        ("reference/rulebased", "did you mean rule-based?"),
        ("pretrained/nobody", "there is no pretrained controller"),
        ("elsewhere/search", "no run in"),
        ("reference/../search", "no run in"),
    ],
)
def test_unknown_names(path, hint):
    with pytest.raises(RunError) as caught:
        trained.load(Path(path))
    assert hint in str(caught.value)


def test_a_run_folder_of_that_name_comes_first(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "reference" / "search").mkdir(parents=True)
    assert shelf.reference(Path("reference/search")) is None
    with pytest.raises(RunError, match="no run in"):
        shelf.controller(Path("reference/search"))
