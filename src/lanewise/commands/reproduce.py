"""``lanewise reproduce``: trains, tests and reports the paper's experiment in one go."""

from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated

from lanewise.commands.arguments import Parsed
from lanewise.commands.train import SEEDS
from lanewise.config import PRESETS, TRAPS, Settings
from lanewise.ranges import OneOf
from lanewise.runs.folder import require_empty


@dataclass(frozen=True, kw_only=True)
class Reproduce:
    """Train both controllers, test them, and print the paper's table with ours beside it."""

    out: Path
    """Folder for the runs and the report: new or empty."""
    seed: Annotated[int, SEEDS] = 0
    """Seed of everything random."""
    preset: Annotated[str, OneOf(tuple(PRESETS))] = "quick"
    """Training preset."""
    trap: Annotated[str, OneOf(tuple(TRAPS))] = "trap-10"
    """Scenario preset."""
    settings: Path | None = None
    """TOML file with any of the settings below."""
    values: Settings = field(default_factory=Settings, metadata={"inline": True})
    """Every setting."""


def run(parsed: Parsed[Reproduce]) -> int:
    """Trains, tests and reports; returns the exit code."""
    command = parsed.command
    require_empty(command.out)
    from lanewise.report.reproduce import reproduce

    reproduce(command.values, seed=command.seed, out=command.out, preset=command.preset)
    return 0
