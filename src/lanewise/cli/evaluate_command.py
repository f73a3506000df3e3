"""``lanewise evaluate``: tests a trained controller on the test start."""

import json
import sys
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated

from lanewise.cli.command_line import Changes, Parsed
from lanewise.controllers.registry import CONTROLLERS
from lanewise.controllers.settings import RENEWALS
from lanewise.errors import RunError, one_line
from lanewise.evaluation.settings import WORLDS
from lanewise.export import policy_file
from lanewise.fields.ranges import EPISODES, SEEDS, OneOf
from lanewise.runs import pretrained
from lanewise.system.progress import Progress


@dataclass(frozen=True, kw_only=True)
class Evaluate:
    """Test a trained controller: greedy episodes of 25 s from the test start."""

    run: Path = field(default=pretrained.DRIVER, metadata={"positional": True})
    """Run folder, finished or not, or a checkpoint in it; a file of `lanewise export`; or
    pretrained/NAME or reference/NAME."""
    world: Annotated[str, OneOf(WORLDS)] = "lanewise"
    """World to drive in: ours, or the real highway-env from the same starts."""
    episodes: Annotated[int, EPISODES] = 300
    """Number of test episodes."""
    seed: Annotated[int, SEEDS] = 0
    """Seed of the starts: start i of a seed is the same in every world."""
    renewal: Annotated[str, OneOf(RENEWALS)] | None = None
    """When the goal is renewed, instead of what the run's settings say."""
    json: bool = False
    """Print one JSON object instead of a table."""
    episodes_out: Path | None = None
    """Also write one line per episode to this CSV file."""
    test: Changes = field(default_factory=dict)
    """Settings of the test."""


def check_renewal(renewal: str | None, run: Path, controller: str) -> None:
    """Refuses ``--renewal`` for a controller without goals, and for one that was exported."""
    if renewal is not None and not CONTROLLERS[controller].has_goals:
        raise RunError(f"--renewal: {run} is {controller} and has no goals")
    if renewal is not None and policy_file.is_policy_file(run):
        raise RunError(f"--renewal: {run} renews goals as it was exported; export it anew with it")


def run(parsed: Parsed[Evaluate]) -> int:
    """Tests; returns the exit code."""
    command = parsed.command
    name = policy_file.controller_name(command.run)
    check_renewal(command.renewal, command.run, name)
    from lanewise.report import output_files

    if command.episodes_out is not None:
        output_files.check_writable(command.episodes_out)
    from lanewise.evaluation import metrics
    from lanewise.experiments import evaluate_trained, published
    from lanewise.export import exported
    from lanewise.report import evaluation_table

    with Progress() as reporter:
        controller = evaluate_trained.with_changes(
            exported.load(command.run), command.test, reporter.note
        )
        episodes = evaluate_trained.evaluate(
            controller, command.world, command.episodes, command.seed, reporter, command.renewal
        )
    summary = metrics.summarise(
        episodes,
        controller=controller.name,
        world=command.world,
        unlike_paper=published.unlike_test(controller.settings),
    )
    # Printed first: a file that cannot be written must not cost the figures.
    seed = f", seed {controller.seed}" if controller.feature_count else ""
    head = one_line(f"{command.run}: {controller.name}{seed}")
    table = f"{head}\n\n{evaluation_table.text([summary])}"
    sys.stdout.write(json.dumps(summary.to_json()) + "\n" if command.json else table)
    if command.episodes_out is not None:
        output_files.write_text(command.episodes_out, metrics.to_csv(episodes))
    return 0
