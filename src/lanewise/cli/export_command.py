"""``lanewise export``: writes a trained controller as a file that runs without Lanewise."""

import json
import sys
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from lanewise.cli.command_line import Changes, Parsed, flag_of
from lanewise.cli.evaluate_command import check_renewal
from lanewise.controllers.registry import CONTROLLERS
from lanewise.controllers.settings import RENEWALS
from lanewise.errors import RunError
from lanewise.export import formats
from lanewise.fields.ranges import SEEDS, Between, OneOf
from lanewise.runs import pretrained
from lanewise.runs.run_folder import RunFolder
from lanewise.system.progress import Progress, tell

if TYPE_CHECKING:
    from lanewise.export.check import Agreement
    from lanewise.runs.trained import Trained


@dataclass(frozen=True, kw_only=True)
class Export:
    """Write a controller as an ONNX model or for NumPy alone.

    The file includes the controller's memory and planner.
    """

    run: Path = field(metadata={"positional": True})
    """Run folder, finished or not, or a checkpoint in it; or pretrained/NAME."""
    out: Path = field(metadata={"short": "-o"})
    """New file to write, ending in .onnx, or in .npz for NumPy."""
    renewal: Annotated[str, OneOf(RENEWALS)] | None = None
    """When the goal is renewed, instead of what the run's settings say."""
    check: Annotated[int, Between(0, 10_000_000)] = 0
    """Compare at least this many decisions with the controller's, which drives from training
    starts, or from test starts if --scenario.* is given."""
    seed: Annotated[int, SEEDS] = 0
    """Seed of these starts."""
    json: bool = False
    """Print one JSON object instead of a line."""
    test: Changes = field(default_factory=dict)
    """Settings of the drives of --check."""


def run(parsed: Parsed[Export]) -> int:
    """Exports; returns 1 if a check found decisions that differ, else 0."""
    command = parsed.command
    name = pretrained.controller_name(command.run)
    if reason := CONTROLLERS[name].not_exportable:
        raise RunError(f"{command.run} cannot be exported: {reason}")
    check_renewal(command.renewal, command.run, name)
    if command.test and not command.check:
        raise RunError(f"{flag_of(next(iter(command.test)))} is for --check N; give both")
    formats.check(command.out, reading=command.check > 0)
    from lanewise.experiments import evaluate_trained
    from lanewise.export import contents
    from lanewise.runs import trained

    own = trained.load(command.run)
    controller = evaluate_trained.with_changes(own, command.test, tell)
    digest = RunFolder.open(pretrained.locate(command.run)).digest
    policy = contents.policy(own, digest, command.renewal)
    formats.save(policy, command.out)
    tell(f"wrote {command.out}")
    found = _compare(controller, command) if command.check else None
    if command.json:
        result = None if found is None else found.to_json()
        told = {name: policy.about[name] for name in ("controller", "seed", "settings_digest")}
        sys.stdout.write(json.dumps(told | {"out": str(command.out), "check": result}) + "\n")
    elif found is not None:
        sys.stdout.write(f"{found}\n")
    return 1 if found is not None and found.different else 0


def _compare(controller: "Trained", command: Export) -> "Agreement":
    """The decisions of the written file beside the controller's."""
    from lanewise.export import check

    with Progress() as reporter:
        reporter.stage(f"comparing {command.out.name}", command.check)
        return check.agreement(
            controller,
            formats.read(command.out).step,
            command.check,
            command.seed,
            command.renewal,
            reporter.update,
            "test" if set(command.test) - {"evaluation.duration"} else "training",
        )
