"""What a manifest and a record must say before anything is made of it."""

import dataclasses
import json
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from lanewise import config
from lanewise.controllers.registry import STEP_1
from lanewise.errors import CheckpointError, RunError
from lanewise.runs import checkpoint, records, resume, trained
from lanewise.runs.folder import RunFolder
from lanewise.training import stage as stage_loop
from lanewise.training.host import Ledger
from lanewise.training.selection import RECENT, WINDOW

PLACE = Path("run", "checkpoints")


@pytest.fixture
def folder(tmp_path):
    made = RunFolder.create(tmp_path / "run", config.compose(), "hierarchical", 3)
    yield made
    made.close()


@pytest.fixture
def plan(folder):
    return resume.plan_of(folder, STEP_1)


@pytest.fixture
def ledger(plan):
    """After two chunks, in which three episodes ended."""
    decisions = 2 * stage_loop.CHUNK * plan.course.budget.worlds
    return replace(
        Ledger(),
        chunks=2,
        decisions=decisions,
        episodes=3,
        recent=(1.0, 2.0, 3.0),
        best_score=(0.5,),
        best_chunk=1,
    )


def test_the_books_of_a_stage_are_read_as_they_were_written(ledger):
    assert resume.ledger_of({"ledger": _as_stored(ledger)}) == ledger


@pytest.mark.parametrize("stage", [None, -1, 2, True, 1.0, "1"])
def test_a_stage_is_one_of_the_run(stage):
    assert resume.stage_of({"stage": 1}, 2) == 1
    with pytest.raises(CheckpointError, match="names no stage of the run"):
        resume.stage_of({"stage": stage}, 2)


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ({"chunks": -1}, "ledger's chunks is no such thing"),
        ({"chunks": 2.0}, "ledger's chunks is no such thing"),
        ({"episodes": 2**63}, "ledger's episodes is no such thing"),
        ({"recent": 3}, "ledger's recent is no such thing"),
        ({"recent": [0.0] * (RECENT + 1)}, "ledger's recent is no such thing"),
        ({"recent": [float("nan")] * 3}, "ledger's recent is no such thing"),
        ({"window": [0.0] * (WINDOW + 1)}, "ledger's window is no such thing"),
        ({"another": 0}, "holds no ledger"),
    ],
)
def test_the_books_hold_counts_and_finite_numbers(ledger, change, says):
    with pytest.raises(CheckpointError, match=says):
        resume.ledger_of({"ledger": _as_stored(ledger) | change})
    with pytest.raises(CheckpointError, match="holds no ledger"):
        resume.ledger_of({})


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ({"chunks": 3}, "chunks and decisions do not agree"),
        ({"episodes": 10**9}, "more than there can be"),
        ({"best_chunk": 3}, "more than there can be"),
        ({"best_chunk": 0}, "best score and the chunk of that do not agree"),
        ({"best_score": ()}, "best score and the chunk of that do not agree"),
        ({"recent": (1.0,)}, "last rewards and episodes do not agree"),
        ({"window": (0.5,)}, "last validations do not agree"),
        ({"window": (0.5,), "window_chunks": (2,), "validations": 0}, "validations do not agree"),
    ],
)
def test_counts_that_contradict_one_another_are_refused(plan, ledger, change, says):
    resume._check_books(ledger, plan)
    with pytest.raises(CheckpointError, match=says):
        resume._check_books(replace(ledger, **change), plan)


def test_a_checkpoint_is_of_the_moment_it_is_called_after():
    name = checkpoint.checkpoint_name(0, 2)

    def found(name=name, chunks=2, iteration=2 * stage_loop.CHUNK):
        return SimpleNamespace(
            name=name,
            meta={"stage": 0, "ledger": {"chunks": chunks}},
            arrays={"state/iteration": np.array(iteration)},
        )

    resume._check_name(PLACE, found())
    with pytest.raises(CheckpointError, match="of another moment than it is called"):
        resume._check_name(PLACE, found(chunks=3))
    with pytest.raises(CheckpointError, match="its state and its ledger do not agree"):
        resume._check_name(PLACE, found(iteration=7))


@pytest.mark.parametrize(
    ("meta", "says"),
    [
        ({}, "metrics_bytes is no length"),
        ({"metrics_bytes": -1}, "metrics_bytes is no length"),
        ({"metrics_bytes": True}, "metrics_bytes is no length"),
        ({"metrics_bytes": 1, "metrics_sha256": 3}, "metrics_sha256 is no digest"),
        ({"metrics_bytes": 1, "metrics_sha256": "a"}, "lacks metrics_sha256 or seed"),
        ({"metrics_bytes": 1, "seed": 3}, "lacks metrics_sha256 or seed"),
    ],
)
def test_what_a_manifest_remembers_of_the_metrics(meta, says):
    with pytest.raises(CheckpointError, match=f"damaged: .*{says}"):
        trained.Mark.of(meta, PLACE)


def test_runs_from_before_remember_neither_seed_nor_digest():
    assert trained.Mark.of({"metrics_bytes": 5}, PLACE) == trained.Mark(5, None)


def test_what_belongs_to_another_seed_is_refused(folder):
    trained.check_seed(folder, {"seed": 3}, PLACE)
    trained.check_seed(folder, {}, PLACE)
    with pytest.raises(CheckpointError, match="of another run: its seed is not 3"):
        trained.check_seed(folder, {"seed": 4}, PLACE)


EPISODE = {
    "kind": "episode",
    "stage": "step-1",
    "episode": 0,
    "decision": 9,
    "success": True,
    "accident": "none",
    "decisions": 9,
    "reward": 1.5,
    "timestep_reward": 1.0,
    "speed": 10.0,
}


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ({"kind": "epoch"}, "line 1 has a kind other than episode, chunk, weights"),
        ({"kind": None}, "line 1 has a kind other than episode, chunk, weights"),
        ({"luck": 3}, 'line 1 has a field "luck", which does not belong there'),
        ({"stage": 3}, "line 1 holds no stage"),
        ({"episode": -1}, "line 1 holds no episode"),
        ({"decision": 2.5}, "line 1 holds no decision"),
        ({"reward": "high"}, "line 1 holds no reward"),
        ({"reward": None}, "line 1 holds no reward"),
        ({"reward": 10**400}, "line 1 .*reward is no plain value"),
        ({"speed": -1e300}, "line 1 .*speed is no plain value"),
        ({"decisions": 2**63}, "line 1 holds no decisions"),
        ({"reward": [1.5]}, "reward is no plain value"),
    ],
)
def test_a_record_is_one_before_anything_is_made_of_it(tmp_path, change, says):
    path = tmp_path / "metrics.jsonl"
    path.write_text(_line(EPISODE))
    assert records.read(path) == [EPISODE]
    path.write_text(_line(EPISODE | change))
    with pytest.raises(RunError, match=f"metrics.jsonl is damaged: .*{says}"):
        records.read(path)
    path.write_text(_line({n: v for n, v in EPISODE.items() if n != "speed"}))
    with pytest.raises(RunError, match="line 1 lacks speed"):
        records.read(path)


def test_records_may_lack_the_papers_success_as_those_from_before_it_do(tmp_path):
    path = tmp_path / "metrics.jsonl"
    path.write_text(_line(EPISODE) + _line(EPISODE | {"escaped": True}))
    assert [record.get("escaped") for record in records.read(path)] == [None, True]
    path.write_text(_line(EPISODE | {"escaped": "yes"}))
    with pytest.raises(RunError, match="line 1 holds no escaped"):
        records.read(path)


@pytest.mark.parametrize(
    ("text", "end", "says"),
    [
        ("[1]\n", None, "it is no object"),
        ("x" * 30_000 + "\n", None, "a line is longer than any record"),
        ("{}", 2, "no line ends at byte 2"),
        ("{}\n", 4, "truncated: 3 of 4 bytes"),
    ],
)
def test_lines_that_are_no_records(tmp_path, text, end, says):
    path = tmp_path / "metrics.jsonl"
    path.write_text(text)
    with pytest.raises(RunError, match=says):
        records.read(path, end)


def _line(record):
    return json.dumps(record) + "\n"


def _as_stored(ledger):
    return json.loads(json.dumps(dataclasses.asdict(ledger)))
