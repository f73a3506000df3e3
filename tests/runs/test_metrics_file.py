import json
import math

import numpy as np
import pytest

from lanewise.errors import RunError
from lanewise.runs import files
from lanewise.runs.metrics import MetricsWriter, keep_copy, read, settled_at, settled_episode


def write(path, numbers, resume_at=0):
    with MetricsWriter(path, resume_at) as metrics:
        for number in numbers:
            metrics.append({"episode": number, "reward": number / 3})
        return metrics.sync()


def test_a_resumed_file_has_the_bytes_of_one_never_stopped(tmp_path):
    whole, stopped = tmp_path / "whole.jsonl", tmp_path / "stopped.jsonl"
    write(whole, range(10))
    at_checkpoint = write(stopped, range(4))
    with stopped.open("ab") as file:
        # Written after the checkpoint, the last line cut short by the kill.
        file.write(b'{"episode": 4, "reward": 1.33}\n{"epis')
    write(stopped, range(4, 10), at_checkpoint)
    assert stopped.read_bytes() == whole.read_bytes()


def test_a_fresh_start_empties_the_file_and_timings_are_kept(tmp_path):
    path = tmp_path / "metrics.jsonl"
    write(path, range(3))
    write(path, range(2))
    assert len(read(path)) == 2
    write(path, range(2), resume_at=None)
    assert len(read(path)) == 4


def test_what_is_to_be_cut_off_is_copied_beside_whatever_was_before(tmp_path):
    path = tmp_path / "metrics.jsonl"
    assert keep_copy(path, 0) is None
    path.write_text("one")
    assert keep_copy(path, 3) is None
    elsewhere = tmp_path / "elsewhere"
    (tmp_path / "metrics-before-1.jsonl").symlink_to(elsewhere)
    assert keep_copy(path, 2) == tmp_path / "metrics-before-2.jsonl"
    path.write_text("two")
    assert keep_copy(path, 0) == tmp_path / "metrics-before-3.jsonl"
    kept = {file.name: file.read_text() for file in tmp_path.iterdir() if file.is_file()}
    assert kept == {path.name: "two"} | {
        f"metrics-before-{number}.jsonl": text for number, text in ((2, "one"), (3, "two"))
    }
    assert not elsewhere.exists()


def test_a_full_disk_leaves_the_metrics_and_no_half_of_a_copy(tmp_path, monkeypatch):
    path = tmp_path / "metrics.jsonl"
    path.write_text("one")

    def full(*_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(files.os, "write", full)
    with pytest.raises(OSError, match="No space left"):
        keep_copy(path, 0)
    assert [file.read_text() for file in tmp_path.iterdir()] == ["one"]


def test_a_file_that_lost_lines_is_refused(tmp_path):
    path = tmp_path / "metrics.jsonl"
    length = write(path, range(3))
    path.write_bytes(path.read_bytes()[:-1])
    with pytest.raises(RunError, match=f"truncated: {length - 1} bytes.*expects {length}"):
        MetricsWriter(path, length)


def test_values_are_plain_json(tmp_path):
    path = tmp_path / "metrics.jsonl"
    with MetricsWriter(path) as metrics:
        metrics.append({"a": math.nan, "b": np.float32(0.5), "c": np.int64(3), "d": "x", "e": None})
        metrics.append({"a": np.array(-np.inf)})
    assert read(path) == [{"a": None, "b": 0.5, "c": 3, "d": "x", "e": None}, {"a": None}]


def test_reading_leaves_out_a_line_cut_short(tmp_path):
    path = tmp_path / "metrics.jsonl"
    path.write_bytes(b'{"a": 1}\n{"a": 2')
    assert read(path) == [{"a": 1}]
    path.write_bytes(b'{"a": 1\n{"a": 2}\n')
    with pytest.raises(RunError, match="not valid JSON"):
        read(path)


@pytest.mark.parametrize(
    ("epsilon", "first"),
    [
        ([0.5, 0.2, 0.02, 0.02], 2),
        ([0.5, 0.4, 0.3], None),
        # Settled before the first record, as after 1000 steps of 32 worlds.
        ([0.1, 0.1], 0),
        ([0.1], None),
        ([None, None], None),
        ([None, 0.5, 0.02, 0.02], 2),
    ],
)
def test_where_epsilon_has_settled(epsilon, first):
    assert settled_at(epsilon) == first


def test_the_episode_where_epsilon_settled():
    chunks = [
        {"epsilon": epsilon, "episodes": 10 * number}
        for number, epsilon in enumerate((0.5, 0.3, 0.02, 0.02))
    ]
    assert settled_episode(chunks) == 20.0
    assert settled_episode(chunks[:2]) is None


def test_a_line_cut_short_is_not_appended_to(tmp_path):
    path = tmp_path / "timings.jsonl"
    path.write_text('{"seconds": 1.0}\n{"sec')
    with MetricsWriter(path, None) as writer:
        writer.append({"seconds": 2.0})
    assert read(path) == [{"seconds": 1.0}, {"seconds": 2.0}]


@pytest.mark.parametrize("number", [10**400, -(10**400), 1e300], ids=["above", "below", "a float"])
def test_a_number_that_no_float_could_hold_is_refused(tmp_path, number):
    """Whoever alters and signs a run anew may write it; sums and means would fail on it."""
    path = tmp_path / "timings.jsonl"
    path.write_text(json.dumps({"seconds": 2**53}) + "\n")
    assert read(path) == [{"seconds": 2**53}]
    path.write_text(json.dumps({"seconds": number}) + "\n")
    with pytest.raises(RunError, match=r"line 1 .*seconds is no plain value"):
        read(path)
