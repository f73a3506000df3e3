"""Arrays on disk: loaded bit for bit as they were stored; damage is named."""

import errno
import json
import os
import shutil
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from lanewise.errors import CheckpointError, LanewiseError
from lanewise.runs import checkpoint, pytree_io
from lanewise.runs.checkpoint import checkpoint_name, load, names, newest_valid
from lanewise.system import folder_io
from lanewise.system.folder_io import OpenFolder

DIGEST = "d" * 64
ARRAYS = {
    "online/0/weights": np.arange(6, dtype=np.float32).reshape(2, 3),
    # Stored as they read, not as they lie in memory.
    "view": np.arange(12, dtype=np.float32).reshape(3, 4).T[::2],
    "count": np.array(7, dtype=np.int32),
    "flags": np.array([True, False]),
    "key": np.array([1, 2], dtype=np.uint32),
    "empty": np.zeros((0, 4), dtype=np.float32),
}
NEWEST = checkpoint_name(0, 10)
ENDINGS = (".json", ".safetensors")


def save(folder, *what, **options):
    with OpenFolder(folder) as place:
        checkpoint.save(place, *what, **options)


def store(folder, chunk, **options):
    arrays = ARRAYS | {"count": np.array(chunk, dtype=np.int32)}
    save(folder, checkpoint_name(0, chunk), arrays, {"chunk": chunk}, DIGEST, keep=2, **options)


@pytest.fixture
def stored(tmp_path):
    for chunk in (9, 10):
        store(tmp_path, chunk)
    return tmp_path


def chunks(folder):
    return [int(name[-8:]) for name in names(folder)]


def contents(directory):
    return {path.name: path.read_bytes() for path in directory.iterdir()}


class State(NamedTuple):
    arrays: dict
    weights: list
    keys: jax.Array


def state(seed):
    key = jax.random.key(seed)
    weights = [{"w": jax.random.bits(key, (2, 3)), "b": jnp.zeros(3)}]
    return State(ARRAYS, weights, jax.random.split(key, 4))


def test_a_tree_with_random_keys_is_loaded_bit_for_bit(tmp_path):
    original, shapes = state(5), jax.eval_shape(lambda: state(0))
    save(tmp_path, "state", original, {"stage": 1, "text": "a"}, DIGEST)
    found = load(tmp_path, "state", shapes, DIGEST)
    assert found.meta == {"stage": 1, "text": "a"}
    assert jax.tree.structure(found.tree) == jax.tree.structure(original)
    expected = pytree_io.flatten(original)
    assert {"arrays/view", "weights/0/b", "weights/0/w", "keys"} <= expected.keys()
    for arrays in (pytree_io.flatten(found.tree), load(tmp_path, "state").tree):
        assert arrays.keys() == expected.keys()
        for name, array in expected.items():
            assert (arrays[name].dtype, arrays[name].shape) == (array.dtype, array.shape)
            assert arrays[name].tobytes() == array.tobytes()


def truncate(path):
    path.write_bytes(path.read_bytes()[:-1])


def flip(path):
    path.write_bytes(path.read_bytes()[:-1] + bytes([path.read_bytes()[-1] ^ 1]))


def swap(path):
    path.write_bytes(path.with_name(checkpoint_name(0, 9) + path.suffix).read_bytes())


def link(path):
    path.rename(path.with_suffix(".elsewhere"))
    path.symlink_to(path.with_suffix(".elsewhere"))


def alter(**changes):
    def altered(path):
        path.write_text(json.dumps(json.loads(path.read_text()) | changes))

    return altered


DAMAGE = [
    (".safetensors", truncate, "truncated or altered"),
    (".safetensors", flip, "truncated or altered"),
    (".safetensors", os.remove, "No such file"),
    (".safetensors", link, "not a regular file"),
    (".safetensors", lambda path: os.truncate(path, 10**9), "larger than"),
    (".json", swap, "belongs to"),
    (".json", alter(meta={"chunk": 99}), "was altered"),
]


@pytest.mark.parametrize(("ending", "damage", "hint"), DAMAGE)
def test_damage_is_named_and_an_older_whole_checkpoint_is_used(stored, ending, damage, hint):
    assert newest_valid(stored, None, DIGEST)[1] == {}
    damage(stored / (NEWEST + ending))
    with pytest.raises(LanewiseError, match=hint) as caught:
        load(stored, NEWEST, ARRAYS, DIGEST)
    assert len(str(caught.value).splitlines()) == 1
    found, problems = newest_valid(stored, ARRAYS, DIGEST)
    assert found.meta["chunk"] == 9
    assert problems == {NEWEST: str(caught.value)}


def test_where_none_is_whole_it_is_said_why(stored, tmp_path):
    assert newest_valid(tmp_path / "absent") == (None, {})
    assert newest_valid(stored, prefix=checkpoint.stage_prefix(1)) == (None, {})
    for name in names(stored):
        truncate(stored / f"{name}.safetensors")
    with pytest.raises(CheckpointError, match=r"no checkpoint can be used; the newest: .*trunc"):
        newest_valid(stored, None, DIGEST)


def test_what_differs_from_the_template_or_the_settings_is_refused(stored):
    for template, digest, hint in (
        (None, "e" * 64, "made with other settings"),
        (ARRAYS | {"more": np.zeros(1)}, DIGEST, "more is missing"),
        ({k: v for k, v in ARRAYS.items() if k != "key"}, DIGEST, "key does not belong there"),
        (ARRAYS | {"count": np.uint32(7)}, DIGEST, r"count is int32 \(\), expected uint32"),
        (ARRAYS | {"key": np.zeros(3, np.uint32)}, DIGEST, r"key is uint32 \(2,\), expected .*3,"),
    ):
        with pytest.raises(CheckpointError, match=hint):
            load(stored, NEWEST, template, digest)


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
def test_numbers_that_are_not_finite(tmp_path, value):
    save(tmp_path, "bad", {"a": np.array([0.0, value], dtype=np.float32)}, {}, DIGEST)
    with pytest.raises(CheckpointError, match="a holds numbers that are not finite"):
        load(tmp_path, "bad")


@pytest.mark.parametrize("allowed", [0, 400])
@pytest.mark.parametrize("chunk", [10, 11])
def test_a_full_disk_leaves_the_old_checkpoint_whole(stored, monkeypatch, allowed, chunk):
    before = contents(stored)
    room, write = [allowed], os.write

    def write_until_full(descriptor, data):
        if room[0] == 0:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        done = write(descriptor, bytes(data[: room[0]]))
        room[0] -= done
        return done

    monkeypatch.setattr(folder_io.os, "write", write_until_full)
    with pytest.raises(OSError, match="No space left"):
        # Neither does a damaged one go before another is whole.
        store(stored, chunk, unusable=[checkpoint_name(0, 9)])
    assert contents(stored) == before


@pytest.mark.parametrize("step", range(4))
def test_a_kill_at_any_step_leaves_a_whole_checkpoint(stored, monkeypatch, step):
    """Stops saving at each fsync and rename, as a kill would: nothing is cleaned up."""

    class KilledError(BaseException):
        pass

    left = [step]

    def killed_in_time(function):
        def wrapper(*arguments, **named):
            if left[0] == 0:
                raise KilledError
            left[0] -= 1
            return function(*arguments, **named)

        return wrapper

    with monkeypatch.context() as patch:
        for name in ("fsync", "replace"):
            patch.setattr(folder_io.os, name, killed_in_time(getattr(os, name)))
        with pytest.raises(KilledError):
            store(stored, 11)
    found, problems = newest_valid(stored, None, DIGEST)
    assert (found.meta["chunk"], problems) == (10, {})
    store(stored, 11)
    assert chunks(stored) == [10, 11]
    assert not list(stored.glob("*.partial"))


STRAY = [
    *("z-backup-0", "stage-00-chunk-00000099 (copy)", "old-stage-00-chunk-00000099"),
    *("stage-00-chunk-99", "stage-00-chunk-00000099.json", "stage-0\u0660-chunk-00000099"),
]


def test_old_checkpoints_are_pruned_and_nothing_else(stored):
    """A user's copies are neither counted nor deleted, and folders are left alone."""
    ours = set(stored.iterdir())
    for name in STRAY:
        for ending in ENDINGS:
            shutil.copy(stored / (NEWEST + ending), stored / (name + ending))
    (stored / "download.partial").write_text("precious")
    for name in ("x.partial", f"{checkpoint_name(0, 1)}.safetensors"):
        (stored / name).mkdir()
    strays = set(stored.iterdir()) - ours
    assert len(strays) == 2 * len(STRAY) + 3
    store(stored, 11)
    assert chunks(stored) == [10, 11]
    found, problems = newest_valid(stored, None, DIGEST)
    assert (found.meta["chunk"], problems) == (11, {})
    save(stored, checkpoint_name(1, 0), ARRAYS, {"chunk": 0}, DIGEST, keep=2)
    assert names(stored) == [checkpoint_name(0, 11), checkpoint_name(1, 0)]
    with OpenFolder(stored) as place:
        checkpoint.prune(place, keep=0)
    assert set(stored.iterdir()) == strays


@pytest.mark.parametrize("chunk", [10, 11])
def test_one_that_cannot_be_used_does_not_count_among_those_kept(stored, chunk):
    (stored / f"{NEWEST}.safetensors").write_bytes(b"torn")
    store(stored, chunk, unusable=[NEWEST])
    assert chunks(stored) == [9, chunk]
