"""Measures benchmarks one after the other, prints the figures and stores them."""

import json
import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from lanewise.bench import measurement
from lanewise.bench.measurement import Measurement
from lanewise.bench.suite import Benchmark
from lanewise.errors import LanewiseError, RunError
from lanewise.system.progress import Progress


def check_out(out: Path | None) -> None:
    """Refuses a result file that exists or cannot be written, before anything is measured."""
    from lanewise.report import output_files

    if out is not None:
        output_files.check_writable(out)
        if out.exists():
            raise RunError(f"{out} exists; choose another file")


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
        as_json: whether to print the result instead of tables.
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
    result = {
        **about,
        "date": datetime.now(UTC).isoformat(timespec="seconds"),
        **provenance.source(),
        "machine": provenance.machine(),
        "versions": provenance.versions() | dict(versions or {}),
        "figures": [asdict(figure) for figure in figures],
        **compared,
        "failed": failed,
        "interrupted": interrupted,
    }
    try:
        # Printed first: a file that cannot be written must not cost the figures.
        shown = json.dumps(result) if as_json else measurement.table(figures) + text
        sys.stdout.write(shown + "\n")
    finally:
        # Written all the same where the reader has gone.
        if out is not None:
            output_files.write_text(out, json.dumps(result, indent=2) + "\n")
    if interrupted:
        raise KeyboardInterrupt
    return 1 if failed else 0
