"""Metrics as tables and as TensorBoard's events: what `metrics.jsonl` says, also after a kill."""

import csv
import json
import struct

import pytest

from lanewise.errors import LanewiseError
from lanewise.runs import metrics, views
from lanewise.runs.files import OpenFolder
from lanewise.runs.metrics import MetricsWriter
from lanewise.runs.views import Views

EPISODE = dict.fromkeys(views.COLUMNS["episode"], 1.0) | {"kind": "episode", "stage": "step-1"}


def chunk(number, **more):
    plain = {"stage": "step-1", "chunk": number, "decisions": 100 * number, "loss": None}
    return {"kind": "chunk", **plain, "reward": 0.5 * number, **more}


def stored(folder, records):
    with MetricsWriter(folder / "metrics.jsonl") as writer:
        for record in records:
            writer.append(record)
        writer.sync()


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
    stored(tmp_path, [EPISODE, chunk(1)])
    with Views(OpenFolder(tmp_path), tensorboard=False) as shown:
        shown.append(chunk(2, validation_reward=3.5))
        shown.append(EPISODE | {"stage": "step-2"})
    assert [row["stage"] for row in rows(tmp_path / "episodes.csv")] == ["step-1", "step-2"]
    one, two = rows(tmp_path / "chunks.csv")
    assert (one["reward"], one["loss"], one["validation_reward"]) == ("0.5", "", "")
    assert (two["chunk"], two["validation_reward"]) == ("2", "3.5")
    assert not (tmp_path / "tensorboard").exists()


def test_events_after_a_kill_hold_nothing_that_was_undone(tmp_path):
    stored(tmp_path, [chunk(1)])
    with Views(OpenFolder(tmp_path), tensorboard=True) as shown:
        shown.append(chunk(2))
    assert {step for _, step, _ in scalars(tmp_path / "tensorboard")} == {100, 200}
    # The metrics file was cut to its first line; the run goes on with its events unasked.
    with Views(OpenFolder(tmp_path), tensorboard=False) as shown:
        shown.append(chunk(2, reward=9.0))
    found = scalars(tmp_path / "tensorboard")
    assert sorted(s for s in found if s[0] == "step-1/reward_one_a_decision") == [
        ("step-1/reward_one_a_decision", 100, 0.5),
        ("step-1/reward_one_a_decision", 200, 9.0),
    ]
    assert not any(tag.endswith(("loss", "chunk")) for tag, *_ in found)


@pytest.mark.slow
def test_every_field_of_a_training_has_a_column(trained):
    for record in metrics.read(trained / "metrics.jsonl"):
        assert set(record) - {"kind"} <= set(views.COLUMNS[record["kind"]])
    assert len(rows(trained / "chunks.csv")) == sum(
        json.loads(line)["kind"] == "chunk"
        for line in (trained / "metrics.jsonl").read_text().splitlines()
    )


@pytest.fixture
def trained(tmp_path):
    """An h-DQN run, whose chunks have the most fields."""
    from test_train import Quiet, create

    from lanewise.runs import train

    with create(tmp_path / "run", controller="h-dqn") as folder:
        train.train(folder, None, Quiet())
    return tmp_path / "run"


def test_without_tensorboardx(tmp_path, monkeypatch):
    monkeypatch.setitem(__import__("sys").modules, "tensorboardX", None)
    stored(tmp_path, [])
    with pytest.raises(LanewiseError, match=r"pip install \"\.\[tensorboard\]\" in your clone"):
        Views(OpenFolder(tmp_path), tensorboard=True)
