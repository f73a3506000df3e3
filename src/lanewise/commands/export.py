"""``lanewise export``: writes a trained controller as a file that runs without Lanewise."""

import json
import sys
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from lanewise.commands.arguments import Parsed
from lanewise.commands.evaluate import WITH_GOALS
from lanewise.controllers.settings import RENEWALS
from lanewise.errors import RunError
from lanewise.export import formats
from lanewise.ranges import SEEDS, Between, OneOf
from lanewise.runs import pretrained
from lanewise.runs.run_folder import RunFolder
from lanewise.system.progress import Progress, tell

if TYPE_CHECKING:
    from lanewise.export.check import Agreement
    from lanewise.runs.trained import Trained

WITHOUT_POLICY = {
    "rule-based": "it is the traffic's own rules, which the world carries out, and not a policy",
    "search": "it plans with the world itself and the future of everyone in it",
}
"""Reference drivers, and why they cannot be exported."""


@dataclass(frozen=True, kw_only=True)
class Export:
    """Write a controller as an ONNX model or for NumPy alone, memory and planner included."""

    run: Path = field(metadata={"positional": True})
    """Run folder of a trained controller, or pretrained/NAME."""
    out: Path = field(metadata={"short": "-o"})
    """New file to write, ending in .onnx, or in .npz for NumPy."""
    renewal: Annotated[str, OneOf(RENEWALS)] | None = None
    """When the goal is renewed, instead of what the run's settings say."""
    check: Annotated[int, Between(0, 10_000_000)] = 0
    """Compare at least so many decisions with the controller, which drives from training starts."""
    seed: Annotated[int, SEEDS] = 0
    """Seed of these starts."""
    json: bool = field(default=False, metadata={"switch": True})
    """Print one JSON object instead of a line."""


def run(parsed: Parsed[Export]) -> int:
    """Exports; returns 1 if a check found decisions that differ, else 0."""
    command = parsed.command
    _refuse(command)
    from lanewise.export import contents
    from lanewise.runs import trained

    controller = trained.load(command.run)
    digest = RunFolder.open(pretrained.locate(command.run)).digest
    policy = contents.policy(controller, digest, command.renewal)
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


def _refuse(command: Export) -> None:
    """Everything that can be known before JAX is there.

    Raises:
        LanewiseError: the controller or the file is not one to export, or a package is missing.
    """
    name = pretrained.controller_name(command.run)
    if name in WITHOUT_POLICY:
        raise RunError(f"{command.run} cannot be exported: {WITHOUT_POLICY[name]}")
    if command.renewal is not None and name not in WITH_GOALS:
        raise RunError(f"--renewal: {command.run} is {name} and has no goals")
    formats.check(command.out, reading=command.check > 0)


def _compare(controller: "Trained", command: Export) -> "Agreement":
    """The written file beside the controller."""
    from lanewise.export import check

    with Progress() as reporter:
        reporter.stage(f"comparing {command.out.name}", command.check)
        return check.agreement(
            controller,
            formats.step(command.out),
            command.check,
            command.seed,
            command.renewal,
            reporter.update,
        )
