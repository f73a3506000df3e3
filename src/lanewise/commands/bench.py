"""``lanewise bench``: measures the speed of Lanewise on this machine."""

import json
import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from datetime import UTC, datetime
from pathlib import Path
from typing import Annotated, Any

from lanewise import cores
from lanewise.bench import measurement, suite
from lanewise.bench.measurement import Measurement
from lanewise.bench.suite import PARTS, Benchmark
from lanewise.commands.arguments import Parsed
from lanewise.errors import LanewiseError, RunError, shell_line
from lanewise.progress import Progress
from lanewise.ranges import Between, OneOf


@dataclass(frozen=True, kw_only=True)
class Bench:
    """Measure the speed of Lanewise on this machine.

    Let the machine do nothing else meanwhile. benchmarks/README.md says how to measure other
    libraries beside it.
    """

    parts: Annotated[tuple[str, ...], OneOf(PARTS)] = field(
        default=(), metadata={"positional": True}
    )
    """What to measure: start-up, world, latency, update, training, evaluation, scaling, gpu. All of
    them by default, which takes about twenty minutes on 2 cores."""
    seconds: Annotated[float, Between(0.1, 3600.0, "s")] = 5.0
    """Length of each measurement."""
    json: bool = field(default=False, metadata={"switch": True})
    """Print one JSON object instead of tables."""
    out: Path | None = None
    """Also write the JSON object to this file, which must not exist."""


def run(parsed: Parsed[Bench]) -> int:
    """Measures; returns the exit code."""
    command = parsed.command
    check_out(command.out)
    chosen = command.parts or PARTS
    gpu = "gpu" in chosen and suite.has_gpu()
    found = suite.benchmarks(command.seconds, len(cores.usable()), gpu)
    session = Session(
        benchmarks=[each for each in found if each.part in chosen],
        about={"command": shell_line("lanewise", *sys.argv[1:]), "seconds": command.seconds},
    )
    notes = ["no GPU that JAX can use, left out: gpu"] if "gpu" in chosen and not gpu else []
    return session.run(command.out, notes, as_json=command.json)


def check_out(out: Path | None) -> None:
    """Refuses a result file that cannot be written, before anything is measured.

    Raises:
        LanewiseError: it exists, or its folder cannot be made.
    """
    from lanewise.report import files

    if out is not None:
        files.check_writable(out)
        if out.exists():
            raise RunError(f"{out} exists; choose another file")


@dataclass(frozen=True, kw_only=True)
class Session:
    """Benchmarks that are measured one after the other, and stored together."""

    benchmarks: Sequence[Benchmark]
    about: Mapping[str, Any]
    """What the result also says, beside where it comes from."""
    versions: Mapping[str, str] = field(default_factory=dict)
    """Of packages in other environments."""
    compare: Callable[[Sequence[Measurement]], tuple[dict[str, Any], str]] = lambda _: ({}, "")
    """What the figures say about one another: for the result, and as text."""

    def run(self, out: Path | None, notes: Sequence[str] = (), *, as_json: bool = False) -> int:
        """Measures, prints and stores; returns the exit code: 1 where a measurement failed.

        Args:
            out: file for the result.
            notes: printed before.
            as_json: whether to print the result instead of tables.

        Raises:
            KeyboardInterrupt: it was interrupted; what was measured so far is printed and stored.
        """
        from lanewise.report import files, provenance

        figures: list[Measurement] = []
        failed: dict[str, str] = {}
        interrupted = False
        with Progress(interval=0.0) as reporter:
            for note in notes:
                reporter.note(note)
            reporter.stage("measuring", len(self.benchmarks))
            for number, each in enumerate(self.benchmarks, 1):
                try:
                    figures.append(each.measure())
                except KeyboardInterrupt:
                    interrupted = True
                    break
                except LanewiseError as error:
                    failed[each.label] = str(error)
                    reporter.note(f"{each.label}: {error}")
                else:
                    value = f"{figures[-1].value:,.4g} {figures[-1].unit}"
                    reporter.note(f"{each.label}: {value}")
                reporter.update(number)
        compared, text = self.compare(figures)
        result = {
            **self.about,
            "date": datetime.now(UTC).isoformat(timespec="seconds"),
            **provenance.source(),
            "machine": provenance.machine(),
            "versions": provenance.versions() | dict(self.versions),
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
                files.write_text(out, json.dumps(result, indent=2) + "\n")
        if interrupted:
            raise KeyboardInterrupt
        return 1 if failed else 0
