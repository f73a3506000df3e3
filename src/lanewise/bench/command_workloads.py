"""The workloads that are commands, timed from start to end."""

import json
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from statistics import median
from typing import Any

REPEATS = 9


def start_up(words: Sequence[str], seed: int = 0) -> Callable[[], dict[str, Any]]:
    """Seconds until a command of this interpreter has ended; the median of `REPEATS`."""

    def timed() -> dict[str, Any]:
        times = [_command((sys.executable, *words))[0] for _ in range(REPEATS)]
        detail = {"least": min(times), "most": max(times), "repeats": REPEATS}
        return {"value": median(times), "unit": "s", "detail": detail}

    return timed


def evaluation(episodes: int, seed: int = 0) -> Callable[[], dict[str, Any]]:
    """Seconds of ``lanewise evaluate``, start-up and compilation included."""

    def timed() -> dict[str, Any]:
        words = ("evaluate", "pretrained/hierarchical", "--episodes", str(episodes), "--json")
        seconds, said = _command((sys.executable, "-m", "lanewise", *words))
        return {"value": seconds, "unit": "s", "detail": {"test": json.loads(said)}}

    return timed


def _command(words: Sequence[str]) -> tuple[float, str]:
    """(seconds, standard output) of a command."""
    began = time.perf_counter()
    done = subprocess.run(words, stdout=subprocess.PIPE, text=True, check=True)
    return time.perf_counter() - began, done.stdout
