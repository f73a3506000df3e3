"""One world, one decision with its observation, asked for from Python."""

from functools import partial
from pathlib import Path
from typing import Any

from lanewise.bench import processes
from lanewise.bench.parts.world import LANES, VEHICLES
from lanewise.bench.task import Asked, Figure, Task

PART = "latency"


def tasks(asked: Asked) -> list[Task]:
    """Ours and highway-env's, of a single environment on one core."""
    subjects: list[tuple[str, str, Path | None]] = [("lanewise", "lanewise_step", None)]
    if python := asked.interpreters.find("highway-env"):
        subjects.append(("highway-env", "highway_env_world", python))
    return [
        Task(
            f"latency: {vehicles} vehicles: {subject}",
            partial(
                _measure,
                f"{vehicles} vehicles, 1 core",
                subject,
                worker,
                {"vehicles": vehicles, "lanes": LANES[vehicles], "seconds": asked.seconds},
                python,
            ),
        )
        for vehicles in VEHICLES
        for subject, worker, python in subjects
    ]


def _measure(
    case: str, subject: str, worker: str, arguments: dict[str, Any], python: Path | None
) -> list[Figure]:
    (result,) = processes.one_each(worker, arguments, 1, python)
    mean = result["seconds"] / result["decisions"] * 1e6
    detail = {name: result[name] for name in ("decisions", "ended", "peak_memory_bytes")}
    if "slowest_seconds" in result:
        detail["slowest_seconds"] = result["slowest_seconds"]
    return [Figure(PART, case, subject, mean, "microseconds a decision", detail)]
