"""``lanewise bench``: measures speed on this machine, beside the peers that are installed."""

import json
import sys
from dataclasses import asdict, dataclass, field
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from lanewise.cli.command_line import Parsed
from lanewise.errors import LanewiseError, RunError, shell_line
from lanewise.fields.ranges import Between, OneOf
from lanewise.system import process
from lanewise.system.progress import Progress

if TYPE_CHECKING:
    from lanewise.bench.task import Figure

PARTS = (
    *("start-up", "world", "latency", "update"),
    *("training", "evaluation", "scaling", "level", "gpu"),
)
"""Names of `bench.catalogue.PARTS`, known without importing it."""


@dataclass(frozen=True, kw_only=True)
class Bench:
    """Measure speed on this machine.

    Peers are measured too if they are installed: highway-env, EnvPool, PyTorch and
    Stable-Baselines3; benchmarks/README.md says how to install them. Let the machine do nothing
    else meanwhile.
    """

    parts: Annotated[tuple[str, ...], OneOf(PARTS)] = field(
        default=(), metadata={"positional": True}
    )
    """What to measure: start-up, world, latency, update, training, evaluation, scaling, level (time
    to the paper's level), gpu. All of them if none is given, which takes about half an hour on 2
    cores."""
    seconds: Annotated[float, Between(0.1, 3600.0, "s")] = 5.0
    """Length of each measurement."""
    seeds: Annotated[int, Between(1, 1000)] = 5
    """Trainings whose time to the paper's level is taken."""
    python: tuple[Path, ...] = ()
    """Interpreters of other environments in which peers are installed."""
    json: bool = False
    """Print one JSON object instead of tables."""
    out: Path | None = None
    """Also write the JSON object to this file, which must not exist."""


def run(parsed: Parsed[Bench]) -> int:
    """Measures; returns the exit code."""
    command = parsed.command
    from lanewise.report import output_files

    if command.out is not None:
        output_files.check_writable(command.out)
        if command.out.exists():
            raise RunError(f"{command.out} exists; choose another file")
    from lanewise.bench import catalogue, peers, ratios, table
    from lanewise.bench.task import Asked

    interpreters = peers.ask(command.python)
    count = len(process.usable_cores())
    asked = Asked(command.seconds, command.seeds, count, interpreters)
    chosen = command.parts or PARTS
    tasks = [task for part, of in catalogue.PARTS.items() if part in chosen for task in of(asked)]
    figures: list[Figure] = []
    failed: dict[str, str] = {}
    interrupted = False
    with Progress(interval=0.0) as reporter:
        for peer in sorted(interpreters.missed):
            reporter.note(f"not installed, left out: {peer} (benchmarks/README.md)")
        if "gpu" in chosen and not any(task.label.startswith("gpu") for task in tasks):
            reporter.note("no GPU that JAX can use, left out: gpu")
        reporter.stage("measuring", len(tasks))
        for number, task in enumerate(tasks, 1):
            try:
                found = task.run()
            except KeyboardInterrupt:
                interrupted = True
                break
            except LanewiseError as error:
                failed[task.label] = str(error)
                reporter.note(f"{task.label}: {error}")
            else:
                figures += found
                reporter.note(f"{task.label}: {found[0].value:,.4g} {found[0].unit}")
            reporter.update(number)
    said = ratios.of(figures, count)
    result: dict[str, Any] = _provenance(command, interpreters.versions()) | {
        "figures": [asdict(figure) for figure in figures],
        "ratios": [asdict(ratio) for ratio in said],
        "failed": failed,
        "interrupted": interrupted,
    }
    try:
        # Printed first: a file that cannot be written must not cost the figures.
        shown = json.dumps(result) if command.json else table.text(figures, said)
        sys.stdout.write(shown + "\n")
    finally:
        # Written all the same where the reader has gone.
        if command.out is not None:
            output_files.write_text(command.out, json.dumps(result, indent=2) + "\n")
    if interrupted:
        # What was measured so far is kept.
        raise KeyboardInterrupt
    return 1 if failed else 0


def _provenance(command: Bench, peers: dict[str, str]) -> dict[str, Any]:
    """Where the figures come from."""
    from lanewise.report import provenance

    return {
        "command": shell_line("lanewise", *sys.argv[1:]),
        "date": datetime.now(UTC).isoformat(timespec="seconds"),
        **provenance.source(),
        "machine": provenance.machine(),
        "versions": provenance.versions() | peers,
        "seconds": command.seconds,
    }
