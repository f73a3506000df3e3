"""Metrics on disk, as tables and as TensorBoard's events: the same after any kill."""

import csv
import json
import math
import os
import struct

import numpy as np
import pytest

from lanewise.errors import LanewiseError, RunError
from lanewise.runs import metric_sinks, metrics_file
from lanewise.runs.metric_sinks import MetricSinks
from lanewise.runs.metrics_file import MetricsWriter, keep_copy, read, settled_at, settled_episode
from lanewise.system import folder_io
from lanewise.system.folder_io import OpenFolder

EPISODE = {
    "kind": "episode",
    "stage": "step-1",
    "episode": 0,
    "decision": 9,
    "escaped": True,
    "success": True,
    "accident": "none",
    "decisions": 9,
    "reward": 1.5,
    "timestep_reward": 1.0,
    "speed": 10.0,
}


def chunk(number, **more):
    plain = {"stage": "step-1", "chunk": number, "decisions": 100 * number, "loss": None}
    return {"kind": "chunk", **plain, "reward": 0.5 * number, **more}


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

    monkeypatch.setattr(folder_io.os, "write", full)
    with pytest.raises(OSError, match="No space left"):
        keep_copy(path, 0)
    assert [file.read_text() for file in tmp_path.iterdir()] == ["one"]


def test_a_file_that_lost_lines_is_refused(tmp_path):
    path = tmp_path / "metrics.jsonl"
    length = write(path, range(3))
    path.write_bytes(path.read_bytes()[:-1])
    with pytest.raises(RunError, match=f"truncated: {length - 1} bytes.*expects {length}"):
        MetricsWriter(path, length)


@pytest.mark.parametrize("resume_at", [0])
def test_a_second_name_of_the_metrics_is_not_cut_short(tmp_path, resume_at):
    """Backups keep old states of a run as hard links."""
    kept = tmp_path / "backup.jsonl"
    kept.write_text('{"kind": "chunk"}\nhalf a li')
    os.link(kept, tmp_path / "metrics.jsonl")
    with pytest.raises(RunError, match=r"metrics.jsonl: another name .* resume the copy"):
        MetricsWriter(tmp_path / "metrics.jsonl", resume_at)
    assert kept.read_text().endswith("half a li")


def test_values_are_plain_json(tmp_path):
    path = tmp_path / "metrics.jsonl"
    with MetricsWriter(path) as metrics:
        metrics.append({"a": math.nan, "b": np.float32(0.5), "c": np.int64(3), "d": "x", "e": None})
        metrics.append({"a": np.array(-np.inf)})
    assert read(path) == [{"a": None, "b": 0.5, "c": 3, "d": "x", "e": None}, {"a": None}]


@pytest.mark.parametrize(
    ("text", "end", "says"),
    [
        ('{"a": 1\n{"a": 2}\n', None, "not valid JSON"),
        ('{"a": [1.5]}\n', None, "a is no plain value"),
        ("{}\n", 4, "truncated: 3 of 4 bytes"),
    ],
)
def test_lines_that_are_no_records(tmp_path, text, end, says):
    path = tmp_path / "metrics.jsonl"
    path.write_text(text)
    with pytest.raises(RunError, match=says):
        read(path, end)


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ({"kind": "epoch"}, "line 1 has a kind other than episode, chunk, weights"),
        ({"luck": 3}, 'line 1 has a field "luck", which does not belong there'),
        ({"stage": 3}, "line 1 has a stage of the wrong type"),
        ({"reward": "high"}, "line 1 has a reward of the wrong type"),
        ({"speed": ...}, "line 1 lacks speed"),
    ],
)
def test_a_record_is_one_before_anything_is_made_of_it(tmp_path, change, says):
    path = tmp_path / "metrics.jsonl"
    path.write_text(json.dumps(EPISODE) + "\n")
    assert metrics_file.read_records(path) == [EPISODE]
    altered = {name: value for name, value in (EPISODE | change).items() if value is not ...}
    path.write_text(json.dumps(altered) + "\n")
    with pytest.raises(RunError, match=f"metrics.jsonl is damaged: .*{says}"):
        metrics_file.read_records(path)


def test_records_are_read_up_to_a_mark_as_they_were_written(tmp_path):
    path = tmp_path / "metrics.jsonl"
    with MetricsWriter(path) as metrics:
        metrics.append(EPISODE)
        mark = metrics.mark()
        metrics.append(EPISODE)
    assert metrics_file.read_marked(path, mark) == [EPISODE]
    assert metrics_file.read_marked(tmp_path / "none", {"metrics_bytes": 0}) == []
    path.write_bytes(path.read_bytes().replace(b"1.5", b"1.6", 1))
    with pytest.raises(RunError, match="was altered after it was written"):
        metrics_file.read_marked(path, mark)


@pytest.mark.parametrize(
    ("epsilon", "first"),
    [
        ([0.5, 0.2, 0.02, 0.02], 2),
        ([0.5, 0.4, 0.3], None),
        # Settled before the first record, as after 1000 steps of 32 worlds.
        ([0.1, 0.1], 0),
        ([None, 0.5, 0.02, 0.02], 2),
    ],
)
def test_where_epsilon_has_settled(epsilon, first):
    assert settled_at(epsilon) == first
    chunks = [{"epsilon": each, "episodes": 10 * number} for number, each in enumerate(epsilon)]
    assert settled_episode(chunks) == (None if first is None else 10.0 * first)


def stored(folder, records):
    """The length of a metrics file with these records."""
    with MetricsWriter(folder / "metrics.jsonl") as writer:
        for record in records:
            writer.append(record)
        return writer.sync()


def rows(path):
    return list(csv.DictReader(path.open()))


def scalars(folder):
    """(tag, step, value) of every scalar, read from the file's frames by hand."""
    from tensorboardX.proto.event_pb2 import Event

    found = []
    for path in folder.glob("events.*"):
        content, place = path.read_bytes(), 0
        while place < len(content):
            (length,) = struct.unpack_from("<Q", content, place)
            event = Event.FromString(content[place + 12 : place + 12 + length])
            place += 12 + length + 4
            found += [(v.tag, event.step, v.simple_value) for v in event.summary.value]
    return found


def test_tables(tmp_path):
    kept = tmp_path / "backup.csv"
    kept.write_text("precious")
    os.link(kept, tmp_path / "chunks.csv")
    length = stored(tmp_path, [EPISODE, chunk(1)])
    with MetricSinks(OpenFolder(tmp_path), length, tensorboard=False) as sinks:
        sinks.append(chunk(2, validation_reward=3.5))
        sinks.append(EPISODE | {"stage": "step-2"})
    assert [row["stage"] for row in rows(tmp_path / "episodes.csv")] == ["step-1", "step-2"]
    one, two = rows(tmp_path / "chunks.csv")
    assert (one["reward"], one["loss"], one["validation_reward"]) == ("0.5", "", "")
    assert (two["chunk"], two["validation_reward"]) == ("2", "3.5")
    assert not (tmp_path / "tensorboard").exists()
    # Another name of an older table keeps what it has.
    assert kept.read_text() == "precious"


def test_events_after_a_kill_hold_nothing_that_was_undone(tmp_path):
    length = stored(tmp_path, [chunk(1)])
    with MetricSinks(OpenFolder(tmp_path), length, tensorboard=True) as sinks:
        sinks.append(chunk(2))
    assert {step for _, step, _ in scalars(tmp_path / "tensorboard")} == {100, 200}
    # The metrics file was cut to its first line; the run goes on with its events unasked.
    with MetricSinks(OpenFolder(tmp_path), length, tensorboard=False) as sinks:
        sinks.append(chunk(2, reward=9.0))
    found = scalars(tmp_path / "tensorboard")
    assert sorted(s for s in found if s[0] == "step-1/reward_one_a_decision") == [
        ("step-1/reward_one_a_decision", 100, 0.5),
        ("step-1/reward_one_a_decision", 200, 9.0),
    ]
    assert not any(tag.endswith(("loss", "chunk")) for tag, *_ in found)


def test_without_tensorboardx(tmp_path, monkeypatch):
    monkeypatch.setitem(__import__("sys").modules, "tensorboardX", None)
    length = stored(tmp_path, [])
    with pytest.raises(LanewiseError, match=r"pip install \"\.\[tensorboard\]\" in your clone"):
        MetricSinks(OpenFolder(tmp_path), length, tensorboard=True)
    assert metric_sinks.TABLES.keys() <= metrics_file.COLUMNS.keys()
