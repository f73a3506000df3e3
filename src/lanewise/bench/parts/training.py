"""Training with one update an environment step: steps a second, and where the time goes."""

from functools import partial
from pathlib import Path
from typing import Any

from lanewise.bench import processes
from lanewise.bench.task import Asked, Figure, Task

PART = "training"
WORLDS = (1, 32)
SUBJECT_SB3 = "Stable-Baselines3, DQN on highway-env"


def tasks(asked: Asked) -> list[Task]:
    """Ours with one and many worlds, and Stable-Baselines3's DQN on the trap in highway-env.

    One training on all cores, then as many trainings at once as there are cores, a core each.
    """
    seconds = {"seconds": asked.seconds}
    measured: list[tuple[str, str, dict[str, Any], Path | None]] = [
        (
            f"lanewise, {worlds} world{'s' if worlds > 1 else ''}",
            "lanewise_training",
            seconds | {"worlds": worlds},
            None,
        )
        for worlds in WORLDS
    ]
    if sb3 := asked.interpreters.find("Stable-Baselines3 on highway-env"):
        measured.append((SUBJECT_SB3, "sb3_training", seconds | {"vehicles": 12}, sb3))
    return [
        Task(
            f"training: {subject}: {case(apart, asked.cores)}",
            partial(_measure, asked.cores, apart, subject, worker, arguments, python),
        )
        for apart in ((False, True) if asked.cores > 1 else (False,))
        for subject, worker, arguments, python in measured
    ]


def case(apart: bool, cores: int) -> str:
    """Name of the case: one training on all cores, or one on each."""
    return f"{cores} trainings, a core each" if apart else f"1 training, {cores} cores"


def _measure(
    cores: int,
    apart: bool,
    subject: str,
    worker: str,
    arguments: dict[str, Any],
    python: Path | None,
) -> list[Figure]:
    if apart:
        results = processes.one_each(worker, arguments, cores, python)
    else:
        results = [processes.alone(worker, arguments | {"seed": 0}, cores, python)]
    rate = sum(result["steps"] / result["seconds"] for result in results)
    one = results[0]
    detail: dict[str, Any] = {
        "updates_per_second": sum(result["updates"] / result["seconds"] for result in results),
        "milliseconds_a_step": {
            name: spent / one["steps"] * 1e3 for name, spent in one["breakdown"].items()
        },
        "peak_memory_bytes": sum(result["peak_memory_bytes"] for result in results),
    }
    if "compile_seconds" in one:
        detail["compile_seconds"] = one["compile_seconds"]
    return [Figure(PART, case(apart, cores), subject, rate, "steps/s", detail)]
