"""How our world's speed changes with vehicles and lanes; with worlds, see the part world."""

from functools import partial

from lanewise.bench import processes
from lanewise.bench.task import Asked, Figure, Task

PART = "scaling"
VEHICLES = (5, 12, 25, 51, 100)
LANES = (2, 3, 5, 8)
WORLDS = 256


def tasks(asked: Asked) -> list[Task]:
    """On one core: numbers of vehicles on 3 lanes, then numbers of lanes with 12 vehicles."""
    sizes = [("vehicles", count, 3) for count in VEHICLES]
    sizes += [("lanes", 12, count) for count in LANES]
    return [
        Task(
            f"scaling in {axis}: {vehicles} vehicles, {lanes} lanes",
            partial(_measure, axis, vehicles, lanes, asked.seconds),
        )
        for axis, vehicles, lanes in sizes
    ]


def _measure(axis: str, vehicles: int, lanes: int, seconds: float) -> list[Figure]:
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
