"""What ``lanewise bench`` measures, as a table of workloads. Imports no JAX."""

import subprocess
import sys
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from lanewise.bench import processes
from lanewise.system import process

PARTS = (
    *("start-up", "world", "latency", "update"),
    *("training", "evaluation", "scaling", "gpu"),
)
"""Names people type, in the order in which they are measured."""
WORKLOADS = Path(__file__).parent / "workloads.py"
COMMANDS = Path(__file__).parent / "command_workloads.py"
STARTED = {
    "python -c pass": ("-c", "pass"),
    "lanewise --help": ("-m", "lanewise", "--help"),
    "lanewise train --help": ("-m", "lanewise", "train", "--help"),
    "import jax": ("-c", "import jax"),
}
LANES = {12: 3, 51: 4}
"""By number of vehicles, as many lanes as highway-env has for so many."""
BATCH = 64
"""Of an update, by default."""
EPISODES = 100_000
"""Of the evaluation."""


@dataclass(frozen=True)
class Measurement:
    """One measured figure."""

    part: str
    case: str
    """What was done; figures of one part and case may be compared."""
    subject: str
    """Who did it."""
    value: float
    unit: str
    detail: dict[str, Any] = field(default_factory=dict)
    """Whatever else was measured, by name."""


@dataclass(frozen=True, kw_only=True)
class Benchmark:
    """A line of the table: a workload, and the processes in which it is measured."""

    part: str
    case: str
    subject: str
    function: str
    """Prepares, and returns what is timed."""
    arguments: Mapping[str, Any] = field(default_factory=dict)
    cores: int = 1
    """That it may use."""
    apart: bool = False
    """Whether each core has a process of its own; otherwise one process has all of them."""
    file: Path = WORKLOADS
    """Where the function is."""
    python: Path = Path(sys.executable)

    @property
    def label(self) -> str:
        """Its name while it is measured."""
        return f"{self.part}: {self.case}: {self.subject}"

    def measure(self) -> Measurement:
        """Runs it (`processes.measure`)."""
        usable = process.usable_cores()[: self.cores]
        groups = [[core] for core in usable] if self.apart else [usable]
        found = processes.measure(self.file, self.function, self.arguments, groups, self.python)
        return Measurement(self.part, self.case, self.subject, **found)


def benchmarks(seconds: float, count: int, gpu: bool = False) -> list[Benchmark]:
    """Every benchmark.

    Args:
        seconds: length of each measurement.
        count: cores that may be used.
        gpu: whether JAX has a GPU; the part ``gpu`` is empty otherwise.
    """
    found = []
    cores = plural(count, "core")

    def add(part: str, case: str, subject: str, function: str, **more: Any) -> None:
        """A benchmark; what is no field of `Benchmark` is an argument of the function."""
        own: dict[str, Any] = {"part": part, "case": case, "subject": subject, "function": function}
        own |= {name: more.pop(name) for name in ("cores", "apart", "file") if name in more}
        if own.get("file") != COMMANDS:
            more["seconds"] = seconds
        found.append(Benchmark(arguments=more, **own))

    for name, words in STARTED.items():
        add("start-up", name, name, "start_up", words=words, cores=count, file=COMMANDS)
    for used in sorted({1, count}):
        for vehicles, lanes in LANES.items():
            size = {"vehicles": vehicles, "lanes": lanes}
            case = f"{vehicles} vehicles, {plural(used, 'core')}"
            for worlds in (1, 64, 1024, 4096) if used == count else (1024,):
                subject = f"lanewise, {plural(worlds, 'world')}"
                add("world", case, subject, "world", cores=used, apart=True, worlds=worlds, **size)
        add("update", update_case(used), "lanewise", "update", cores=used)
    for vehicles, lanes in LANES.items():
        size = {"vehicles": vehicles, "lanes": lanes}
        add("latency", f"{vehicles} vehicles, 1 core", "lanewise", "decision", **size)
        for worlds in (4096, 65_536) if gpu else ():
            case, subject = f"{vehicles} vehicles, 1 GPU", f"lanewise, {worlds} worlds"
            add("gpu", case, subject, "world", cores=count, worlds=worlds, **size)
    for apart in (False, True) if count > 1 else (False,):
        case = training_case(apart, count)
        for worlds in (1, 32):
            subject = f"lanewise, {plural(worlds, 'world')}"
            add("training", case, subject, "training", cores=count, apart=apart, worlds=worlds)
    case = f"{EPISODES:,} test episodes"
    add("evaluation", case, "lanewise", "evaluation", cores=count, file=COMMANDS, episodes=EPISODES)
    sizes = [("vehicles", vehicles, 3) for vehicles in (5, 12, 25, 51, 100)]
    for axis, vehicles, lanes in sizes + [("lanes", 12, lanes) for lanes in (2, 3, 5, 8)]:
        subject = f"lanewise, {vehicles} vehicles, {lanes} lanes"
        size = {"worlds": 256, "vehicles": vehicles, "lanes": lanes}
        add("scaling", f"{axis}, 1 core", subject, "world", **size)
    seeds = [("scaling", f"seeds, {cores}", number) for number in (1, 2, 4)]
    if gpu:
        seeds += [("gpu", "training, one update a step, 1 GPU", n) for n in (1, 16, 64, 256)]
    for part, case, number in seeds:
        subject = f"lanewise, {plural(number, 'seed')} in one loop"
        add(part, case, subject, "many_seeds", cores=count, count=number, worlds=32)
    return sorted(found, key=lambda each: PARTS.index(each.part))


def has_gpu() -> bool:
    """Whether JAX computes on a GPU here, asked of a process of its own."""
    code = "import jax; print(jax.default_backend())"
    asked = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    return asked.stdout.strip() == "gpu"


def plural(count: int, what: str) -> str:
    """A count with its noun."""
    return f"{count} {what}{'' if count == 1 else 's'}"


def update_case(count: int) -> str:
    """Name of an update's case."""
    return f"batch {BATCH}, {plural(count, 'core')}"


def training_case(apart: bool, count: int) -> str:
    """Name of a training's case: one on all cores, or one on each."""
    return f"{count} trainings, a core each" if apart else f"1 training, {plural(count, 'core')}"
