import errno
import json
import os

import numpy as np
import pytest

from lanewise.errors import CheckpointError
from lanewise.runs import checkpoint, files
from lanewise.runs.checkpoint import checkpoint_name, load, names, newest_valid, save

DIGEST = "d" * 64
ARRAYS = {
    "online/0/weights": np.arange(6, dtype=np.float32).reshape(2, 3),
    "count": np.array(7, dtype=np.int32),
    "flags": np.array([True, False]),
    "key": np.array([1, 2], dtype=np.uint32),
    "empty": np.zeros((0, 4), dtype=np.float32),
}


@pytest.fixture
def stored(tmp_path):
    for chunk in (1, 2):
        arrays = ARRAYS | {"count": np.array(chunk, dtype=np.int32)}
        save(tmp_path, checkpoint_name(0, chunk), arrays, {"chunk": chunk}, DIGEST, keep=2)
    return tmp_path


def test_what_was_saved_is_loaded_bit_for_bit(tmp_path):
    save(tmp_path, "controller", ARRAYS, {"stage": 1, "text": "a"}, DIGEST)
    found = load(tmp_path, "controller", ARRAYS, DIGEST)
    assert found.meta == {"stage": 1, "text": "a"}
    assert found.arrays.keys() == ARRAYS.keys()
    for name, array in ARRAYS.items():
        assert found.arrays[name].dtype == array.dtype
        assert found.arrays[name].shape == array.shape
        assert found.arrays[name].tobytes() == array.tobytes()


def test_columns_and_views_are_stored_as_they_read(tmp_path):
    array = np.arange(12, dtype=np.float64).reshape(3, 4).T[::2]
    save(tmp_path, "view", {"a": array}, {}, DIGEST)
    np.testing.assert_array_equal(load(tmp_path, "view").arrays["a"], array)


def test_old_checkpoints_are_pruned(tmp_path):
    for chunk in (1, 2, 9, 10, 11):
        save(tmp_path, checkpoint_name(0, chunk), ARRAYS, {"chunk": chunk}, DIGEST, keep=2)
    save(tmp_path, checkpoint_name(1, 0), ARRAYS, {"chunk": 0}, DIGEST, keep=2)
    assert names(tmp_path) == [checkpoint_name(0, 11), checkpoint_name(1, 0)]
    assert len(list(tmp_path.iterdir())) == 4


def test_newest_is_taken(stored):
    found, warning = newest_valid(stored, ARRAYS, DIGEST)
    assert (found.meta["chunk"], warning) == (2, "")


def test_nothing_stored_yet(tmp_path):
    assert newest_valid(tmp_path) == (None, "")
    assert newest_valid(tmp_path / "absent") == (None, "")


def truncate(path):
    path.write_bytes(path.read_bytes()[:-1])


def flip(path):
    data = bytearray(path.read_bytes())
    data[-1] ^= 1
    path.write_bytes(data)


def swap(path):
    path.write_bytes(path.with_name(checkpoint_name(0, 1) + path.suffix).read_bytes())


def link(path):
    path.rename(path.with_suffix(".elsewhere"))
    path.symlink_to(path.with_suffix(".elsewhere"))


def replace_by_folder(path):
    path.unlink()
    path.mkdir()


DAMAGE = [
    (".safetensors", truncate, "truncated or altered"),
    (".safetensors", lambda path: path.write_bytes(b""), "truncated or altered: 0 of"),
    (".safetensors", flip, "was altered"),
    (".safetensors", swap, "was altered"),
    (".safetensors", os.remove, "is missing"),
    (".safetensors", link, "not a regular file"),
    (".safetensors", replace_by_folder, "not a regular file"),
    (".json", truncate, "^$"),
    (".json", lambda path: path.write_bytes(path.read_bytes()[:50]), "not valid JSON"),
    (".json", lambda path: path.write_text("[" * 100_000), "not valid JSON"),
    (".json", lambda path: path.write_text("[]"), "not a manifest"),
    (".json", lambda path: path.write_bytes(b"\xff\xfe"), "not valid JSON"),
    (".json", swap, "its manifest belongs to"),
    (".json", link, "not a regular file"),
    (".json", lambda path: path.write_bytes(b" " * 5_000_000), "larger than"),
]


@pytest.mark.parametrize(("ending", "damage", "hint"), DAMAGE)
def test_damage_is_named_and_an_older_whole_checkpoint_is_used(stored, ending, damage, hint):
    newest = checkpoint_name(0, 2)
    damage(stored / (newest + ending))
    if hint == "^$":
        # Only the newline at the end was lost, which changes nothing.
        assert load(stored, newest, ARRAYS, DIGEST).meta == {"chunk": 2}
        return
    with pytest.raises(CheckpointError, match=hint) as caught:
        load(stored, newest, ARRAYS, DIGEST)
    assert len(str(caught.value).splitlines()) == 1
    found, warning = newest_valid(stored, ARRAYS, DIGEST)
    assert found.meta["chunk"] == 1
    assert newest in warning
    assert "continuing from" in warning


def test_a_missing_manifest_leaves_the_older_checkpoint(stored):
    (stored / f"{checkpoint_name(0, 2)}.json").unlink()
    found, _ = newest_valid(stored, ARRAYS, DIGEST)
    assert found.meta["chunk"] == 1


def test_no_whole_checkpoint_at_all(stored):
    for name in names(stored):
        truncate(stored / f"{name}.safetensors")
    with pytest.raises(
        CheckpointError, match=r"no checkpoint can be used; the newest: .*truncated"
    ):
        newest_valid(stored, ARRAYS, DIGEST)


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("meta", {"chunk": 99}),
        ("settings_digest", "e" * 64),
        ("bytes", 1),
        ("bytes", True),
        ("sha256", 3),
        ("arrays", {"a": ["float32", -1]}),
        ("arrays", None),
        ("version", 99),
        ("format", "other"),
    ],
)
def test_an_altered_manifest_is_refused(stored, field, value):
    path = stored / f"{checkpoint_name(0, 2)}.json"
    manifest = json.loads(path.read_text())
    path.write_text(json.dumps(manifest | {field: value}))
    with pytest.raises(CheckpointError):
        load(stored, checkpoint_name(0, 2))


def forge(path, change):
    """Alters a manifest and makes its digest right again, as somebody who wants in would."""
    manifest = json.loads(path.read_text()) | change
    manifest["manifest_sha256"] = checkpoint._digest_of(manifest)
    path.write_text(json.dumps(manifest))


def test_a_forged_manifest_is_refused_by_the_data(stored):
    path = stored / f"{checkpoint_name(0, 2)}.json"
    forge(path, {"arrays": {"huge": ["float32", 10**12]}})
    with pytest.raises(CheckpointError, match="lacks online/0/weights"):
        load(stored, checkpoint_name(0, 2), ARRAYS)
    with pytest.raises(CheckpointError, match="does not hold the arrays its manifest lists"):
        load(stored, checkpoint_name(0, 2))


def test_data_that_is_no_safetensors_file(stored):
    import hashlib

    data = b"\xff" * 64
    name = checkpoint_name(0, 2)
    (stored / f"{name}.safetensors").write_bytes(data)
    digest = hashlib.sha256(data).hexdigest()
    forge(stored / f"{name}.json", {"bytes": len(data), "sha256": digest})
    with pytest.raises(CheckpointError, match="not a safetensors file"):
        load(stored, name, ARRAYS)


def test_other_settings_are_refused(stored):
    with pytest.raises(CheckpointError, match="made with other settings"):
        load(stored, checkpoint_name(0, 2), ARRAYS, "e" * 64)


@pytest.mark.parametrize(
    ("template", "hint"),
    [
        (ARRAYS | {"more": np.zeros(1)}, "lacks more"),
        ({k: v for k, v in ARRAYS.items() if k != "key"}, "holds key, which does not belong"),
        (ARRAYS | {"count": np.array(7, dtype=np.int64)}, r"count is \['int32'\], expected"),
        (ARRAYS | {"key": np.zeros(3, dtype=np.uint32)}, r"expected \['uint32', 3\]"),
    ],
)
def test_the_template_decides(stored, template, hint):
    with pytest.raises(CheckpointError, match=hint):
        load(stored, checkpoint_name(0, 2), template)


def test_the_template_may_depend_on_the_meta(stored):
    seen = []
    load(stored, checkpoint_name(0, 2), lambda meta: seen.append(meta) or ARRAYS)
    assert seen == [{"chunk": 2}]


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
def test_numbers_that_are_not_finite(tmp_path, value):
    bad = {"a": np.array([0.0, value], dtype=np.float32)}
    good = {"a": np.zeros(2, dtype=np.float32)}
    save(tmp_path, "bad", bad, {}, DIGEST)
    for template in (None, good):
        with pytest.raises(CheckpointError, match="a holds numbers that are not finite"):
            load(tmp_path, "bad", template)
    # The template, or the caller, may say otherwise.
    assert load(tmp_path, "bad", bad).arrays
    assert load(tmp_path, "bad", good, nonfinite=("a",)).arrays


@pytest.mark.parametrize("name", ["../x", "/etc/passwd", "a/b", "", ".hidden", "a\0b", "x" * 500])
def test_names_cannot_lead_elsewhere(tmp_path, name):
    with pytest.raises(CheckpointError, match="no name"):
        load(tmp_path, name)
    with pytest.raises(CheckpointError, match="no name"):
        save(tmp_path, name, {}, {}, DIGEST)


def contents(directory):
    return {path.name: path.read_bytes() for path in directory.iterdir()}


@pytest.mark.parametrize("allowed", [0, 1, 100, 400, 700])
def test_a_full_disk_leaves_the_old_checkpoint_whole(stored, monkeypatch, allowed):
    before = contents(stored)
    room, write = [allowed], os.write

    def write_until_full(descriptor, data):
        if room[0] == 0:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        done = write(descriptor, bytes(data[: room[0]]))
        room[0] -= done
        return done

    monkeypatch.setattr(files.os, "write", write_until_full)
    for name in (checkpoint_name(0, 2), checkpoint_name(0, 3)):
        room[0] = allowed
        with pytest.raises(OSError, match="No space left"):
            save(stored, name, ARRAYS, {"chunk": 3}, DIGEST, keep=2)
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

    monkeypatch.setattr(files.os, "fsync", killed_in_time(os.fsync))
    monkeypatch.setattr(files.os, "replace", killed_in_time(os.replace))
    with pytest.raises(KilledError):
        save(stored, checkpoint_name(0, 3), ARRAYS, {"chunk": 3}, DIGEST, keep=2)
    monkeypatch.undo()
    found, warning = newest_valid(stored, ARRAYS, DIGEST)
    assert (found.meta["chunk"], warning) == (2, "")
    save(stored, checkpoint_name(0, 3), ARRAYS, {"chunk": 3}, DIGEST, keep=2)
    assert names(stored) == [checkpoint_name(0, 2), checkpoint_name(0, 3)]
    assert not list(stored.glob("*.partial"))


def test_a_link_in_the_way_is_replaced_not_followed(tmp_path):
    victim = tmp_path / "victim"
    victim.write_text("precious")
    folder = tmp_path / "run"
    folder.mkdir()
    (folder / "controller.safetensors.partial").symlink_to(victim)
    (folder / "controller.json").symlink_to(victim)
    save(folder, "controller", ARRAYS, {}, DIGEST)
    assert victim.read_text() == "precious"
    assert load(folder, "controller", ARRAYS).arrays


def test_nothing_is_ever_pickled(stored):
    import ast
    import inspect

    from lanewise.runs import folder, metrics, tree

    for module in (checkpoint, files, folder, metrics, tree):
        nodes = list(ast.walk(ast.parse(inspect.getsource(module))))
        imported = {alias.name for n in nodes if isinstance(n, ast.Import) for alias in n.names}
        imported |= {n.module for n in nodes if isinstance(n, ast.ImportFrom)}
        assert not imported & {"pickle", "dill", "cloudpickle", "marshal", "shelve", "joblib"}
