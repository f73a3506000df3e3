"""Which checkpoints are kept and which go; whatever else lies beside them stays."""

import errno
import os
import shutil

import numpy as np
import pytest

from lanewise.runs import checkpoint, files
from lanewise.runs.checkpoint import checkpoint_name, names, newest_valid, save

DIGEST = "d" * 64
ENDINGS = (".json", ".safetensors")


def store(folder, chunk, **how):
    arrays = {"count": np.array(chunk, np.int32)}
    save(folder, checkpoint_name(0, chunk), arrays, {"chunk": chunk}, DIGEST, keep=2, **how)


@pytest.fixture
def stored(tmp_path):
    for chunk in (9, 10):
        store(tmp_path, chunk)
    return tmp_path


def damage(folder, chunk):
    (folder / f"{checkpoint_name(0, chunk)}.safetensors").write_bytes(b"torn")


def chunks(folder):
    return [int(name[-8:]) for name in names(folder)]


STRAY = [
    *("z-backup-0", "z-backup-1", "stage-00-chunk-00000099 (copy)", "old-stage-00-chunk-00000099"),
    *("stage-00-chunk-99", "stage-00-chunk-00000099.json", "stage-0\u0660-chunk-00000099"),
]


def test_a_users_copies_are_neither_counted_nor_deleted(stored):
    ours = set(stored.iterdir())
    for name in STRAY:
        for ending in ENDINGS:
            shutil.copy(stored / (checkpoint_name(0, 10) + ending), stored / (name + ending))
    (stored / "download.partial").write_text("precious")
    strays = {path: path.read_bytes() for path in stored.iterdir() if path not in ours}
    assert len(strays) == 2 * len(STRAY) + 1
    store(stored, 11)
    assert chunks(stored) == [10, 11]
    found, warning = newest_valid(stored, None, DIGEST)
    assert (found.meta["chunk"], warning) == (11, "")
    checkpoint.prune(stored, keep=0)
    assert {path: path.read_bytes() for path in stored.iterdir()} == strays


@pytest.mark.parametrize(
    "name",
    [
        *("a.json", "x.json", "x.safetensors", "x.partial", f"{checkpoint_name(0, 99)}.json"),
        *(f"{checkpoint_name(0, 1)}.safetensors", f"{checkpoint_name(0, 1)}.json.partial"),
    ],
)
def test_a_folder_among_checkpoints_is_left_alone(stored, name):
    (stored / name).mkdir()
    for chunk in (11, 12, 13):
        store(stored, chunk)
    assert (stored / name).is_dir()
    kept = {f"{checkpoint_name(0, chunk)}{ending}" for chunk in (12, 13) for ending in ENDINGS}
    assert {path.name for path in stored.iterdir()} == kept | {name}
    found, warning = newest_valid(stored, None, DIGEST)
    assert found.meta["chunk"] == 13
    # Where it stands in the place of a checkpoint, that is said.
    assert bool(warning) == (name == f"{checkpoint_name(0, 99)}.json")


def test_what_is_left_of_one_without_its_manifest_goes(stored):
    """As a kill leaves it that comes between the two names."""
    (stored / f"{checkpoint_name(0, 10)}.json").unlink()
    store(stored, 11)
    assert chunks(stored) == [9, 11]
    assert len(list(stored.iterdir())) == 4


@pytest.mark.parametrize("chunk", [10, 11])
def test_one_that_cannot_be_used_does_not_count_among_those_kept(stored, chunk):
    damage(stored, 10)
    store(stored, chunk, unusable=[checkpoint_name(0, 10)])
    assert chunks(stored) == [9, chunk]
    damage(stored, chunk)
    assert newest_valid(stored, None, DIGEST)[0].meta["chunk"] == 9


def test_later_ones_that_cannot_be_used_go_too(stored):
    """The run went on from far before them and does not come past them for long."""
    damage(stored, 10)
    save(stored, checkpoint_name(0, 5), {"count": np.int32(5)}, {"chunk": 5}, DIGEST)
    later = [checkpoint_name(0, 9), checkpoint_name(0, 10)]
    store(stored, 6, unusable=later)
    assert chunks(stored) == [5, 6]


def test_one_that_cannot_be_used_stays_until_another_is_whole(stored, monkeypatch):
    damage(stored, 10)
    before = {path: path.read_bytes() for path in stored.iterdir()}

    def full(descriptor, data):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(files.os, "write", full)
    with pytest.raises(OSError, match="No space left"):
        store(stored, 11, unusable=[checkpoint_name(0, 10)])
    assert {path: path.read_bytes() for path in stored.iterdir()} == before
