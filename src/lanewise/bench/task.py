"""What a part of the benchmark consists of: tasks to run one after the other, and their figures."""

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

from lanewise.bench.peers import Interpreters


@dataclass(frozen=True)
class Figure:
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


@dataclass(frozen=True)
class Task:
    """Something to be measured."""

    label: str
    run: Callable[[], list[Figure]]


@dataclass(frozen=True)
class Asked:
    """What the user wants measured."""

    seconds: float
    """Of each measurement."""
    seeds: int
    """Trainings whose time to the paper's level is taken."""
    cores: int
    interpreters: Interpreters
