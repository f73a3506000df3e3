"""The world under random driving: decisions and vehicle-ticks a second."""

from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

from lanewise.bench import processes
from lanewise.bench.task import Asked, Figure, Task

PART = "world"
WORLDS = (1, 64, 1024, 4096)
VEHICLES = (12, 51)
LANES = {12: 3, 51: 4}
"""As many as highway-env has for so many vehicles."""
ENVS = (64, 512)
"""In EnvPool's pool: neither is always the faster, and the better counts."""
UNIT = "vehicle-ticks/s"
SAME = 200
"""Starts whose endings are compared with highway-env's, to know that the work is the same."""


def tasks(asked: Asked) -> list[Task]:
    """Ours and the peers', on one core and on all."""
    found = []
    for cores in sorted({1, asked.cores}):
        for vehicles in VEHICLES:
            found += _of_size(asked, vehicles, cores)
        found += _stock(asked, cores)
    if python := asked.interpreters.find("highway-env"):
        run = partial(_same_endings, python)
        found.append(Task(f"world: {SAME} starts in ours and in highway-env", run))
    return found


def _of_size(asked: Asked, vehicles: int, cores: int) -> list[Task]:
    """The same number of vehicles, lanes, ticks and decisions a second for everyone."""
    case = f"{vehicles} vehicles, {_cores(cores)}"
    size = {"vehicles": vehicles, "lanes": LANES[vehicles], "seconds": asked.seconds}
    counts = WORLDS if cores == asked.cores else (1024,)
    found = [
        _task(
            case,
            f"lanewise, {worlds} world{'s' if worlds > 1 else ''}",
            _each("lanewise_world", worlds, size, cores),
        )
        for worlds in counts
    ]
    if python := asked.interpreters.find("highway-env"):
        run = _each("highway_env_world", None, size, cores, python)
        found.append(_task(case, "highway-env", run))
    if python := asked.interpreters.find("EnvPool"):
        settings = {
            "vehicles_count": vehicles - 1,
            "lanes_count": LANES[vehicles],
            "simulation_frequency": 10,
            "policy_frequency": 2,
            "duration": 25,
            "max_episode_steps": 50,
        }
        found += [
            _task(
                case,
                f"EnvPool, {envs} environments",
                _pool(asked, "highway-v0", envs, settings, cores, python),
            )
            for envs in ENVS
        ]
    return found


def _stock(asked: Asked, cores: int) -> list[Task]:
    """EnvPool's environments as they come; their vehicles and ticks are their own."""
    python = asked.interpreters.find("EnvPool")
    if python is None:
        return []
    return [
        _task(
            f"EnvPool as it comes, {_cores(cores)}",
            f"EnvPool {name}, {envs} environments",
            _pool(asked, name, envs, {}, cores, python),
        )
        for name in ("highway-v0", "highway-fast-v0")
        for envs in ENVS
    ]


def _each(
    worker: str, worlds: int | None, size: dict[str, Any], cores: int, python: Path | None = None
) -> Callable[[], list[dict[str, Any]]]:
    """A process for each core."""
    arguments = size if worlds is None else size | {"worlds": worlds}

    def run() -> list[dict[str, Any]]:
        results = processes.one_each(worker, arguments, cores, python)
        return [result | {"vehicles": size["vehicles"]} for result in results]

    return run


def _pool(
    asked: Asked, task: str, envs: int, settings: dict[str, Any], cores: int, python: Path
) -> Callable[[], list[dict[str, Any]]]:
    """One pool with a thread for each core."""
    arguments = {
        "task": task,
        "envs": envs,
        "threads": cores,
        "seconds": asked.seconds,
        "settings": settings,
    }
    return lambda: [processes.alone("envpool_world", arguments, cores, python)]


def _task(case: str, subject: str, run: Callable[[], list[dict[str, Any]]]) -> Task:
    return Task(f"world: {case}: {subject}", lambda: [_figure(case, subject, run())])


def _figure(case: str, subject: str, results: list[dict[str, Any]]) -> Figure:
    """Rates summed over processes, episodes by their ending."""
    decisions = sum(result["decisions"] / result["seconds"] for result in results)
    one = results[0]
    endings = {name: sum(r["ended"][name] for r in results) for name in one["ended"]}
    episodes = max(1, sum(endings.values()))
    detail: dict[str, Any] = {
        "decisions_per_second": decisions,
        "vehicles": one["vehicles"],
        "ticks_per_decision": one["ticks_per_decision"],
        "episodes": sum(endings.values()),
        "ended": {name: count / episodes for name, count in endings.items()},
        "peak_memory_bytes": sum(result["peak_memory_bytes"] for result in results),
    }
    if "compile_seconds" in one:
        detail["compile_seconds"] = max(result["compile_seconds"] for result in results)
    rate = decisions * one["ticks_per_decision"] * one["vehicles"]
    return Figure(PART, case, subject, rate, UNIT, detail)


def _same_endings(python: Path) -> list[Figure]:
    arguments = {"vehicles": 12, "lanes": LANES[12], "count": SAME}
    (result,) = processes.one_each("same_endings", arguments, 1, python)
    detail = {"different": result["different"]}
    case = f"{SAME} starts with 12 vehicles"
    unit = "end as in highway-env"
    return [Figure(PART, case, "lanewise", float(result["same"]), unit, detail)]


def _cores(count: int) -> str:
    return f"{count} core" if count == 1 else f"{count} cores"
