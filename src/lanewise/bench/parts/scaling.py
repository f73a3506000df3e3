"""How our speed changes with vehicles, lanes and seeds; with worlds, see the part world."""

from functools import partial

from lanewise.bench import processes
from lanewise.bench.task import Asked, Figure, Task

PART = "scaling"
VEHICLES = (5, 12, 25, 51, 100)
LANES = (2, 3, 5, 8)
WORLDS = 256
SEEDS = (1, 2, 4)
WORLDS_A_SEED = 32


def tasks(asked: Asked) -> list[Task]:
    """On one core: numbers of vehicles on 3 lanes, then numbers of lanes with 12 vehicles.

    On all cores: trainings of several seeds in one compiled loop.
    """
    sizes = [("vehicles", count, 3) for count in VEHICLES]
    sizes += [("lanes", 12, count) for count in LANES]
    worlds = [
        Task(
            f"scaling in {axis}: {vehicles} vehicles, {lanes} lanes",
            partial(_world, axis, vehicles, lanes, asked.seconds),
        )
        for axis, vehicles, lanes in sizes
    ]
    case = f"seeds, {asked.cores} core{'s' if asked.cores > 1 else ''}"
    return worlds + [
        Task(
            f"scaling in seeds: {seeds}",
            partial(training_of_seeds, PART, case, seeds, WORLDS_A_SEED, asked),
        )
        for seeds in SEEDS
    ]


def training_of_seeds(part: str, case: str, seeds: int, worlds: int, asked: Asked) -> list[Figure]:
    """Several seeds trained in one compiled loop, an update every step of each."""
    arguments = {"seeds": seeds, "worlds": worlds, "seconds": asked.seconds}
    result = processes.alone("lanewise_seeds", arguments, asked.cores)
    rate = result["steps"] / result["seconds"]
    detail = {
        "compile_seconds": result["compile_seconds"],
        "peak_memory_bytes": result["peak_memory_bytes"],
    }
    subject = f"lanewise, {seeds} seed{'s' if seeds > 1 else ''} in one loop"
    return [Figure(part, case, subject, rate, "steps/s, all seeds", detail)]


def _world(axis: str, vehicles: int, lanes: int, seconds: float) -> list[Figure]:
    size = {"worlds": WORLDS, "vehicles": vehicles, "lanes": lanes, "seconds": seconds}
    (result,) = processes.one_each("lanewise_world", size, 1)
    decisions = result["decisions"] / result["seconds"]
    detail = {
        "vehicles": vehicles,
        "lanes": lanes,
        "decisions_per_second": decisions,
        "compile_seconds": result["compile_seconds"],
        "peak_memory_bytes": result["peak_memory_bytes"],
    }
    rate = decisions * result["ticks_per_decision"] * vehicles
    subject = f"lanewise, {vehicles} vehicles, {lanes} lanes"
    return [Figure(PART, f"{axis}, 1 core", subject, rate, "vehicle-ticks/s", detail)]
