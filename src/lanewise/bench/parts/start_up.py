"""How soon the command line answers."""

import time
from functools import partial
from statistics import median

from lanewise.bench import processes
from lanewise.bench.task import Asked, Figure, Task

PART = "start-up"
REPEATS = 9
COMMANDS = {
    "python -c pass": ["-c", "pass"],
    "lanewise --help": ["-m", "lanewise", "--help"],
    "lanewise train --help": ["-m", "lanewise", "train", "--help"],
    "import jax": ["-c", "import jax"],
}


def tasks(asked: Asked) -> list[Task]:
    """Each command several times; the median counts."""
    del asked
    return [Task(f"start-up: {name}", partial(_measure, name)) for name in COMMANDS]


def _measure(name: str) -> list[Figure]:
    times = []
    for _ in range(REPEATS):
        began = time.perf_counter()
        processes.output(COMMANDS[name])
        times.append(time.perf_counter() - began)
    detail = {"least": min(times), "most": max(times), "repeats": REPEATS}
    return [Figure(PART, name, name, median(times), "s", detail)]
