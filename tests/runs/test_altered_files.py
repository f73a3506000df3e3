"""Altered files are refused: everything the campaign knows to do, once to each kind of file."""

import json
from types import SimpleNamespace

import altered_files
import altering
import forging
import pytest
import strangers_files


@pytest.fixture(scope="module")
def rows(tmp_path_factory):
    place = tmp_path_factory.mktemp("strangers")
    strangers_files.make(place, real=False)
    return altered_files.block(place, 0, len(altered_files.WAYS), 0, guarded=False)


def test_every_altered_file_is_refused_or_says_the_same(rows):
    assert [row for row in rows if row["problem"]] == []
    refused = [row for row in rows if row["outcome"] == "refused"]
    assert len(refused) > 300
    assert len(refused) > 0.9 * len(rows)


def test_every_way_was_tried_on_every_kind_of_file(rows):
    tried = {row["how"] for row in rows}
    assert {how.__name__ for how in altering.BYTES + altering.TEXT} <= tried
    assert {name for name in dir(forging) if name.startswith(("signed_", "policy_"))} <= tried
    assert {row["target"] for row in rows} == {each.name for each in strangers_files.TARGETS}


def test_messages_say_what_is_wrong(rows):
    kinds = {altered_files.kind_of(row["said"]) for row in rows if row["outcome"] == "refused"}
    assert len(kinds) > 40


WHOLE = {"whole": "what it should be", "other": None, "cut": False}


class Careless:
    """A target that loads whatever there is, as the campaign must notice."""

    def __init__(self, load):
        self.name, self.signed, self.load = "careless", True, load


@pytest.mark.parametrize(
    ("load", "problem"),
    [
        (lambda folder: "something else", "loaded altered"),
        (lambda folder: {}["key"], "another error"),
        (lambda folder: (folder / "file").write_text("x"), "touched"),
        (lambda folder: refuse(folder, 1.2), "slow"),
        (lambda folder: refuse(folder, megabytes=300), "memory"),
        (lambda folder: refuse("it is wrong"), "vague"),
    ],
)
def test_a_careless_loader_is_found_out(tmp_path, load, problem):
    (tmp_path / "file").write_text("altered")
    target, before = Careless(load), altered_files.state_of(tmp_path)
    found = altered_files.measure(target, tmp_path)
    touched = altered_files.state_of(tmp_path) != before
    assert altered_files.judge(target, tmp_path, WHOLE, touched, found) == problem


def test_a_journal_is_loaded_up_to_where_it_was_cut_and_no_other_way(tmp_path):
    journal = SimpleNamespace(name="journal of a sweep", signed=True)
    whole = {"whole": json.dumps([0, [1, 2, 3]]), "other": None}
    original, file = tmp_path / "original", tmp_path / "file"
    original.write_bytes(b"one\ntwo\nthree\n")
    for text, cut in (
        (b"one\ntwo\nthr", True),
        (b"one\n", True),
        (b"", True),
        (b"one\ntwX\n", False),
        (b"two\n", False),
        (b"one\ntwo\nthree\nfour\n", False),
    ):
        file.write_bytes(text)
        assert altered_files.is_cut(file, original) == cut
        loaded = ("loaded", json.dumps([0, [1]]), 0.0, 0.0, 0.0)
        problem = altered_files.judge(journal, tmp_path, whole | {"cut": cut}, False, loaded)
        assert problem == ("" if cut else "loaded altered")


def test_what_is_written_by_hand_may_say_anything_finite(tmp_path):
    by_hand = SimpleNamespace(name="settings by hand", signed=False)
    for said, problem in (
        ({"speed": 1.0}, ""),
        ({"title": "step -Infinity"}, ""),
        ({"speed": float("nan")}, "loaded what is not finite"),
        ({"speed": [-float("inf")]}, "loaded what is not finite"),
    ):
        loaded = ("loaded", json.dumps(said), 0.0, 0.0, 0.0)
        assert altered_files.judge(by_hand, tmp_path, WHOLE, False, loaded) == problem


def refuse(folder, seconds=0.0, megabytes=0):
    import time

    from lanewise.errors import RunError

    room = bytearray(megabytes * 1_000_000)
    room[::4096] = b"x" * len(room[::4096])
    end = time.process_time() + seconds
    while time.process_time() < end:
        pass
    raise RunError(f"{folder}/file was altered, and that is wrong")
