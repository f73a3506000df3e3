"""Many test episodes of the trained hierarchical controller: `lanewise evaluate`."""

import json
import time

from lanewise.bench import processes
from lanewise.bench.task import Asked, Figure, Task

PART = "evaluation"
EPISODES = 100_000


def tasks(asked: Asked) -> list[Task]:
    """One command, start-up and compilation included."""
    del asked
    return [Task(f"evaluation: {EPISODES:,} test episodes", _measure)]


def _measure() -> list[Figure]:
    words = ["evaluate", "pretrained/hierarchical", "--episodes", str(EPISODES), "--json"]
    began = time.perf_counter()
    found = processes.output(["-m", "lanewise", *words])
    seconds = time.perf_counter() - began
    detail = {"test": json.loads(found)}
    return [Figure(PART, f"{EPISODES:,} test episodes", "lanewise", seconds, "s", detail)]
