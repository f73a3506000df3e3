"""The journal of a sweep: how it is begun, and what is in the way of that."""

import os
from pathlib import Path

import pytest

from lanewise.cli import journal
from lanewise.errors import RunError
from lanewise.evaluation.cells import Reach
from lanewise.system.folder_io import PARTIAL

IDENTITY = {"kind": "Sweep", "seed": 0}


def begin(path):
    book = journal.open_(path, IDENTITY)
    with book.folder:
        book.add([Reach(True, True, True, "01", 2)])
    return journal.read(path, IDENTITY)[0]


def test_what_a_kill_leaves_of_a_beginning_is_not_in_the_way(tmp_path):
    path = tmp_path / "progress.json"
    (tmp_path / (path.name + PARTIAL)).write_text('{"kind"')
    assert len(begin(path)) == 1
    assert sorted(os.listdir(tmp_path)) == [path.name]


def test_what_is_published_takes_the_place_of_the_journal(tmp_path):
    def write(drawn):
        for name in ("map.json", "map.md"):
            (Path(drawn) / name).write_text(name)
        return Path(drawn) / "map.md"

    book = journal.open_(tmp_path / "progress.json", IDENTITY)
    with book.folder:
        assert book.publish(write) == tmp_path / "map.md"
    assert sorted(os.listdir(tmp_path)) == ["map.json", "map.md"]


def test_a_damaged_journal_is_said_to_be_damaged_and_stays(tmp_path):
    path = tmp_path / "progress.json"
    for text in ("", '{"format": "lanewise-sweep", "vers'):
        path.write_text(text)
        with pytest.raises(RunError, match="is damaged: not valid JSON; remove it to begin anew"):
            journal.open_(path, IDENTITY)
        assert path.read_text() == text
