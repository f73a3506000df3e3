"""Measures benchmarks one after the other, prints the figures and stores them."""

import json
import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict
from itertools import groupby
from pathlib import Path
from typing import Any

from lanewise.bench.suite import Benchmark, Measurement
from lanewise.errors import LanewiseError
from lanewise.system.progress import Progress


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


def check_out(out: Path | None) -> None:
    """Refuses a result file that exists or cannot be written, before anything is measured."""
    from lanewise.report import output_files

    if out is not None:
        output_files.check_writable(out, new=True)


def run(
    benchmarks: Sequence[Benchmark],
    about: Mapping[str, Any],
    out: Path | None,
    *,
    notes: Sequence[str] = (),
    as_json: bool = False,
    versions: Mapping[str, str] | None = None,
    compare: Callable[[Sequence[Measurement]], tuple[dict[str, Any], str]] = lambda _: ({}, ""),
) -> int:
    """Measures, prints and stores; returns the exit code: 1 where a measurement failed.

    Args:
        benchmarks: what is measured, in order.
        about: what the result says beside figures, date, code, machine and versions.
        out: file for the result.
        notes: printed before.
        as_json: print the result instead of tables.
        versions: of packages in other environments.
        compare: of the figures, more of the result and more of the text.

    Raises:
        KeyboardInterrupt: after what was measured so far has been printed and stored.
    """
    from lanewise.report import output_files, provenance

    figures: list[Measurement] = []
    failed: dict[str, str] = {}
    interrupted = False
    with Progress(interval=0.0) as reporter:
        for note in notes:
            reporter.note(note)
        reporter.stage("measuring", len(benchmarks))
        for number, each in enumerate(benchmarks, 1):
            try:
                figures.append(each.measure())
            except KeyboardInterrupt:
                interrupted = True
                break
            except LanewiseError as error:
                failed[each.label] = str(error)
                reporter.note(f"{each.label}: {error}")
            else:
                reporter.note(f"{each.label}: {figures[-1].value:,.4g} {figures[-1].unit}")
            reporter.update(number)
    compared, text = compare(figures)
    made = provenance.origin()
    made["versions"] |= versions or {}
    result = {
        **about,
        **made,
        "figures": [asdict(figure) for figure in figures],
        **compared,
        "failed": failed,
        "interrupted": interrupted,
    }
    try:
        # Printed first: a file that cannot be written must not cost the figures.
        shown = json.dumps(result) if as_json else table(figures) + text
        sys.stdout.write(shown + "\n")
    finally:
        # Written all the same where the reader has gone.
        if out is not None:
            output_files.write_text(out, json.dumps(result, indent=2) + "\n")
    if interrupted:
        raise KeyboardInterrupt
    return 1 if failed else 0


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
