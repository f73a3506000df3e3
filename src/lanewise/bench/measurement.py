"""One measured figure, and the figures of a session as text."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from itertools import groupby
from typing import Any


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


def _sum(unit: str, digits: int) -> Callable[[dict[str, float]], str]:
    return lambda parts: " + ".join(f"{name} {v:.{digits}f}" for name, v in parts.items()) + unit


SHOWN: dict[str, Callable[[Any], str]] = {
    "decisions_per_second": "{:,.0f} decisions/s".format,
    "ended": lambda ended: f"{1 - ended['truncated']:.0%} of episodes end by accident",
    "gflop_per_second": "{:,.0f} GFLOP/s".format,
    "milliseconds_a_step": _sum(" ms a step", 2),
    "seconds_of": _sum(" s", 0),
    "test": lambda test: f"success {test['success_rate']:.1%}",
    "compile_seconds": "compiled in {:.1f} s".format,
    "peak_memory_bytes": lambda count: f"{count / 2**20:,.0f} MiB",
}
"""The details that tables show; the file has all."""


def table(figures: Sequence[Measurement]) -> str:
    """Figures by part and case, for a terminal."""
    lines = []
    for (part, case), group in groupby(figures, key=lambda each: (each.part, each.case)):
        lines += ["", f"{part}: {case}"]
        for each in group:
            line = f"  {each.subject:<40} {number(each.value):>12} {each.unit}"
            lines.append(f"{line}  ({extras(each)})" if extras(each) else line)
    return "\n".join(lines).lstrip("\n")


def number(value: float) -> str:
    """A figure with as many digits as mean something."""
    return f"{value:,.2f}" if value < 10 else f"{value:,.1f}" if value < 100 else f"{value:,.0f}"


def extras(figure: Measurement) -> str:
    """The details people look for."""
    detail = dict(figure.detail)
    if "episodes" not in detail:
        detail.pop("ended", None)  # Counts, not shares.
    if "seconds_of" in detail:
        detail.pop("compile_seconds", None)  # Among them.
    return ", ".join(text(detail[name]) for name, text in SHOWN.items() if name in detail)
