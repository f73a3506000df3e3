"""``lanewise bench``: measures the speed of Lanewise on this machine."""

import sys
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated

from lanewise.bench import session, suite
from lanewise.bench.suite import PARTS
from lanewise.cli.command_line import Parsed
from lanewise.errors import shell_line
from lanewise.fields.ranges import Between, OneOf
from lanewise.system import process


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
    json: bool = False
    """Print one JSON object instead of tables."""
    out: Path | None = None
    """Also write the JSON object to this file, which must not exist."""


def run(parsed: Parsed[Bench]) -> int:
    """Measures; returns the exit code."""
    command = parsed.command
    session.check_out(command.out)
    chosen = command.parts or PARTS
    gpu = "gpu" in chosen and suite.has_gpu()
    found = suite.benchmarks(command.seconds, len(process.usable_cores()), gpu)
    return session.run(
        [each for each in found if each.part in chosen],
        {"command": shell_line("lanewise", *sys.argv[1:]), "seconds": command.seconds},
        command.out,
        notes=["no GPU that JAX can use, left out: gpu"] if "gpu" in chosen and not gpu else [],
        as_json=command.json,
    )
