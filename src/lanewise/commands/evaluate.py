"""``lanewise evaluate``: tests a trained controller on the test start."""

from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated

from lanewise.commands.arguments import Parsed
from lanewise.commands.train import SEEDS
from lanewise.controllers.settings import RENEWALS
from lanewise.ranges import Between, OneOf
from lanewise.runs.folder import RunFolder

WORLDS = ("lanewise", "highway-env")


@dataclass(frozen=True, kw_only=True)
class Evaluate:
    """Test a trained controller: greedy episodes of 25 s from the test start."""

    run: Path = field(metadata={"positional": True})
    """Run folder of a trained controller."""
    world: Annotated[str, OneOf(WORLDS)] = "lanewise"
    """World to drive in: ours, or the real highway-env from the same starts."""
    episodes: Annotated[int, Between(1, 10_000_000)] = 300
    """Number of test episodes."""
    seed: Annotated[int, SEEDS] = 0
    """Seed of the starts: start i of a seed is the same in every world."""
    renewal: Annotated[str, OneOf(RENEWALS)] | None = None
    """When the goal is renewed, instead of what the run's settings say."""
    json: bool = field(default=False, metadata={"switch": True})
    """Print one JSON object instead of a table."""
    episodes_out: Path | None = None
    """Also write one line per episode to this CSV file."""


def run(parsed: Parsed[Evaluate]) -> int:
    """Tests; returns the exit code."""
    command = parsed.command
    folder = RunFolder.open(command.run)
    from lanewise.evaluation.command import evaluate

    evaluate(
        folder,
        world=command.world,
        episodes=command.episodes,
        seed=command.seed,
        renewal=command.renewal,
        as_json=command.json,
        episodes_out=command.episodes_out,
    )
    return 0
