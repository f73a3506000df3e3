"""Part of the campaign over kills and failed writes; and that it notices a save that tears."""

import json
import subprocess
import sys

import kills
import numpy as np
import pytest

from lanewise.runs import checkpoint


@pytest.mark.slow
def test_every_call_of_a_save_killed_or_failing_leaves_a_whole_checkpoint(tmp_path):
    """In a process of its own: it forks, which threads of JAX do not survive."""
    out = tmp_path / "kills.json"
    command = [sys.executable, kills.__file__, "--kills", "10", "--out", str(out)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    found = json.loads(out.read_text())
    assert found["wrong"] == []
    assert found["moments"]["call"] >= 30
    assert set(found["left_valid"]) == {"old", "new"}


@pytest.fixture
def stored(tmp_path):
    for number in range(1, kills.FIRST + 1):
        kills.save(tmp_path, number)
    return tmp_path


def test_a_lost_and_a_torn_checkpoint_are_noticed(stored):
    """Torn, as a save would leave it that writes under the final names."""
    assert kills.judge(stored, kills.FIRST) == ""
    assert "saved 7, found 5" in kills.judge(stored, kills.FIRST + 4)
    newest = stored / f"{checkpoint.checkpoint_name(0, kills.FIRST + 2)}.safetensors"
    newest.write_bytes(newest.read_bytes()[:-1])
    assert "found 3" in kills.judge(stored, kills.FIRST + 2)


def test_other_numbers_are_noticed(stored, monkeypatch):
    other = kills.contents(kills.FIRST) | {"weights": np.zeros((203, 300), np.float32)}
    monkeypatch.setattr(kills, "contents", lambda number: other)
    assert "other weights than were saved" in kills.judge(stored, kills.FIRST)
