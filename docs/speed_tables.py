"""Tables of the benchmark's stored figures, for ``make_results.py``."""

import sys
from pathlib import Path
from typing import Any

import ages

from lanewise.bench.measurement import Measurement, extras, number

sys.path.append(str(Path(__file__).resolve().parents[1] / "benchmarks"))
import ratios
from ratios import Ratio

AGE = ages.mark("results/bench.json", "what it says of updates and trainings")


def brief(bench: Any) -> str:
    """What the benchmark's figures say about one another, on all cores."""
    rows = [
        [ratio.what, f"{number(ratio.value)} {ratio.unit}", ratio.how]
        for ratio in _ratios(bench)
        if "1 core," not in ratio.what or "decision of one world" in ratio.what
    ]
    lines = ["| | | from |", "|---|---:|---|", *("| " + " | ".join(row) + " |" for row in rows)]
    return "\n".join(lines) + "\n"


def _ratios(bench: Any) -> list[Ratio]:
    return ratios.of(_measured(bench), bench["machine"]["cores"])


def _measured(bench: Any) -> list[Measurement]:
    return [Measurement(**figure) for figure in bench["figures"]]


def whole(bench: Any, machine: str) -> str:
    """Every figure of the benchmark, by part and case."""
    versions = ", ".join(f"{name} {version}" for name, version in bench["versions"].items())
    lines = [
        f"`{bench['command']}`, {bench['date'][:10]}, on {machine}; each measurement",
        f"{bench['seconds']:g} s. {versions}.",
        "",
        AGE,
        "",
        "| part | case | who | figure | besides |",
        "|---|---|---|---:|---|",
    ]
    for figure in _measured(bench):
        value = f"{number(figure.value)} {figure.unit}"
        lines.append(
            f"| {figure.part} | {figure.case} | {figure.subject} | {value} | {extras(figure)} |"
        )
    return "\n".join(lines) + "\n"
