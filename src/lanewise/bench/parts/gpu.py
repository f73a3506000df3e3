"""The same code on one GPU: many worlds, and many seeds in one compiled loop."""

from functools import partial
from typing import Any

from lanewise.bench import processes
from lanewise.bench.parts import scaling
from lanewise.bench.task import Asked, Figure, Task

PART = "gpu"
WORLDS = (4096, 65_536)
VEHICLES = {12: 3, 51: 4}
"""And their lanes."""
SEEDS = (1, 16, 64, 256)


def is_present() -> bool:
    """Whether JAX computes on a GPU here, asked of a process of its own."""
    return processes.output(["-c", "import jax; print(jax.default_backend())"]).strip() == "gpu"


def tasks(asked: Asked) -> list[Task]:
    """Nothing where there is no GPU."""
    if not is_present():
        return []
    found = [
        Task(
            f"gpu: {vehicles} vehicles, {worlds} worlds",
            partial(_world, vehicles, lanes, worlds, asked),
        )
        for vehicles, lanes in VEHICLES.items()
        for worlds in WORLDS
    ]
    case = "training, one update a step, 1 GPU"
    found += [
        Task(
            f"gpu: {seeds} seeds at once",
            partial(scaling.training_of_seeds, PART, case, seeds, scaling.WORLDS_A_SEED, asked),
        )
        for seeds in SEEDS
    ]
    return found


def _world(vehicles: int, lanes: int, worlds: int, asked: Asked) -> list[Figure]:
    size = {"worlds": worlds, "vehicles": vehicles, "lanes": lanes, "seconds": asked.seconds}
    result = processes.alone("lanewise_world", size | {"seed": 0}, asked.cores)
    decisions = result["decisions"] / result["seconds"]
    rate = decisions * result["ticks_per_decision"] * vehicles
    detail: dict[str, Any] = {
        "decisions_per_second": decisions,
        "compile_seconds": result["compile_seconds"],
    }
    subject = f"lanewise, {worlds} worlds"
    return [Figure(PART, f"{vehicles} vehicles, 1 GPU", subject, rate, "vehicle-ticks/s", detail)]
