"""Metrics on disk, as tables and as TensorBoard's events: the same after any kill."""

import csv
import math
import os
import struct
import sys

import numpy as np
import pytest

from lanewise.errors import LanewiseError, RunError
from lanewise.report import experiment_tables
from lanewise.runs import metrics_file, selected_weights
from lanewise.runs.metric_sinks import MetricSinks
from lanewise.runs.metrics_file import MetricsWriter, keep_copy, read, settled_at, settled_episode
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


@pytest.fixture
def path(tmp_path):
    return tmp_path / "metrics.jsonl"


def writer(path, resume_at=0):
    return MetricsWriter(OpenFolder(path.parent), path.name, resume_at)


def write(path, records, resume_at=0):
    with writer(path, resume_at) as metrics:
        for record in records:
            metrics.append(record)
        return metrics.sync()


def test_a_resumed_file_has_the_bytes_of_one_never_stopped(path, tmp_path):
    records, stopped = [chunk(number) for number in range(10)], tmp_path / "stopped.jsonl"
    write(path, records)
    at_checkpoint = write(stopped, records[:4])
    with stopped.open("ab") as file:
        # Written after the checkpoint, the last line cut short by the kill.
        file.write(b'{"episode": 4, "reward": 1.33}\n{"epis')
    write(stopped, records[4:-1], at_checkpoint)
    with stopped.open("ab") as file:
        file.write(b'{"epis')
    # Without a checkpoint every whole line stays, as of the timings.
    write(stopped, records[-1:], None)
    assert stopped.read_bytes() == path.read_bytes()


def test_what_is_to_be_cut_off_is_copied_beside_what_was_before(path, tmp_path):
    folder = OpenFolder(tmp_path)
    assert keep_copy(folder, path, 0) is None
    path.write_text("one")
    assert keep_copy(folder, path, 3) is None
    for number, text in enumerate(("one", "two"), 1):
        path.write_text(text)
        copy = keep_copy(folder, path, 2)
        assert copy == tmp_path / f"metrics-before-{number}.jsonl"
        assert copy.read_text() == path.read_text() == text


def test_a_file_that_lost_lines_is_refused(path):
    length = write(path, [EPISODE] * 3)
    os.truncate(path, length - 1)
    with pytest.raises(RunError, match=f"truncated: {length - 1} of {length} bytes"):
        writer(path, length)


def test_another_name_of_a_file_keeps_what_it_has(path, tmp_path):
    """Backups keep old states of a run as hard links."""
    kept = tmp_path / "backup"
    for name in (path.name, "chunks.csv"):
        kept.write_text("precious")
        (tmp_path / name).unlink(missing_ok=True)
        os.link(kept, tmp_path / name)
        with opened(tmp_path, 0) as sinks:
            sinks.append(chunk(1))
        assert kept.read_text() == "precious"
        kept.unlink()


def test_values_are_plain_json(path):
    values = {"a": math.nan, "b": np.float32(0.5), "c": np.int64(3), "d": "x", "e": None}
    write(path, [values, {"a": np.array(-np.inf)}])
    assert read(path) == [{"a": None, "b": 0.5, "c": 3, "d": "x", "e": None}, {"a": None}]


def test_damaged_lines(path):
    path.write_text('{"a": 1\n{"a": 2}\n')
    for end, says in ((None, "line 1 is not valid JSON"), (99, "truncated: 17 of 99 bytes")):
        with pytest.raises(RunError, match=says):
            read(path, end)


def test_records_are_read_up_to_a_mark_as_they_were_written(path):
    assert metrics_file.read_marked(path, {"metrics_bytes": 0}) == []
    with writer(path) as metrics:
        metrics.append(EPISODE)
        mark = metrics.mark()
        metrics.append(EPISODE)
    assert metrics_file.read_marked(path, mark) == [EPISODE]
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
        ([None, None], None),
    ],
)
def test_where_epsilon_has_settled(epsilon, first):
    assert settled_at(epsilon) == first
    chunks = [{"epsilon": each, "episodes": 10 * number} for number, each in enumerate(epsilon)]
    assert settled_episode(chunks) == (None if first is None else 10.0 * first)


def opened(folder, length, tensorboard=False):
    return MetricSinks(OpenFolder(folder), length, tensorboard=tensorboard)


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


def test_tables(path, tmp_path):
    with opened(tmp_path, write(path, [EPISODE, chunk(1)])) as sinks:
        sinks.append(chunk(2, validation_reward=3.5))
        sinks.append(EPISODE | {"stage": "step-2"})
    assert [row["stage"] for row in rows(tmp_path / "episodes.csv")] == ["step-1", "step-2"]
    one, two = rows(tmp_path / "chunks.csv")
    assert (one["reward"], one["loss"], one["validation_reward"]) == ("0.5", "", "")
    assert (two["chunk"], two["validation_reward"]) == ("2", "3.5")
    assert not (tmp_path / "tensorboard").exists()


def test_events_after_a_kill_hold_nothing_that_was_undone(path, tmp_path):
    length = write(path, [chunk(1)])
    with opened(tmp_path, length, tensorboard=True) as sinks:
        sinks.append(chunk(2))
    assert {step for _, step, _ in scalars(tmp_path / "tensorboard")} == {100, 200}
    # The metrics file is cut to its first line; the run goes on with its events unasked.
    with opened(tmp_path, length) as sinks:
        sinks.append(chunk(2, reward=9.0))
    found = scalars(tmp_path / "tensorboard")
    assert sorted(s for s in found if s[0] == "step-1/reward_one_a_decision") == [
        ("step-1/reward_one_a_decision", 100, 0.5),
        ("step-1/reward_one_a_decision", 200, 9.0),
    ]
    assert not any(tag.endswith(("loss", "chunk")) for tag, *_ in found)


def test_without_tensorboardx(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "tensorboardX", None)
    with pytest.raises(LanewiseError, match=r"pip install \"\.\[tensorboard\]\" in your clone"):
        opened(tmp_path, 0, tensorboard=True)


def of_stage(chosen=0.9, success=0.9, last=0.9, accidents=0.0, rule="best-validation"):
    """Metrics of a stage whose weights of chunk 2 of 3 were kept."""
    chunks = [
        {"kind": "chunk", "stage": "s", "chunk": number, "validation_success_rate": rate}
        for number, rate in ((1, 0.1), (2, chosen), (3, 0.2))
    ]
    weights = {"kind": "weights", "stage": "s", "rule": rule, "kept_chunk": 2, "last_chunk": 3}
    for of, rate, crashes in (("kept", success, accidents), ("last", last, 0.0)):
        weights |= {f"{of}_success_rate": rate, f"{of}_accident_rate": crashes}
        weights |= {f"{of}_escape_rate": rate + crashes, f"{of}_reward": 1.0}
    return [*chunks, weights | {"fresh_episodes": 1000}]


@pytest.mark.parametrize(
    ("figures", "says"),
    [
        ({}, []),
        ({"success": 0.86, "last": 0.7}, []),
        (
            {"chosen": 0.41, "success": 0.4, "last": 0.0, "accidents": 0.14},
            ["success 40.0 % with the kept weights, 0.0 % with the last ones"],
        ),
        ({"accidents": 0.3}, ["accidents 30.0 % with the kept weights, 0.0 %"]),
        ({"success": 0.8}, ["chosen for 90.0 % success, the kept weights of s have 80.0 %"]),
        ({"success": 0.8, "rule": "best-training"}, []),
    ],
)
def test_weights_that_are_an_outlier_are_told(figures, says):
    (found,) = selected_weights.of_run(of_stage(**figures))
    warnings = list(found.warnings)
    assert len(warnings) == len(says)
    assert all(said in warning for said, warning in zip(says, warnings, strict=True))


def test_the_table_holds_kept_and_last_side_by_side():
    seeds = [selected_weights.of_run(of_stage(success=share))[0] for share in (0.8, 1.0)]
    row = experiment_tables.weights({"an arm": seeds}).splitlines()[2]
    assert "| best-validation | 90.0 (90.0 to 90.0) | 90.0 (80.0 to 100.0) | 90.0 (90.0" in row
    assert row.count("|") == 3 + 2 * len(experiment_tables.WEIGHTS) + 1
