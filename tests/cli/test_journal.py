"""The journal of a sweep: how it is begun, and what is in the way of that."""

import os

import pytest

from lanewise.cli import journal
from lanewise.errors import RunError
from lanewise.evaluation.grid import PointResult, Reach
from lanewise.system.folder_io import PARTIAL

IDENTITY = {"kind": "Sweep", "seed": 0}


def begin(path):
    book = journal.open_(path, IDENTITY, PointResult)
    with book.folder:
        book.add([Reach(True, True, True, "01", 2)])
    return journal.read(path, IDENTITY, PointResult)[0]


def test_what_a_kill_leaves_of_a_beginning_is_not_in_the_way(tmp_path):
    path = tmp_path / "progress.json"
    (tmp_path / (path.name + PARTIAL)).write_text('{"kind"')
    assert len(begin(path)) == 1
    assert sorted(os.listdir(tmp_path)) == [path.name]


def test_a_damaged_journal_is_said_to_be_damaged_and_stays(tmp_path):
    path = tmp_path / "progress.json"
    for text in ("", '{"format": "lanewise-sweep", "vers'):
        path.write_text(text)
        with pytest.raises(RunError, match="is damaged: not valid JSON; remove it to begin anew"):
            journal.open_(path, IDENTITY, PointResult)
        assert path.read_text() == text
