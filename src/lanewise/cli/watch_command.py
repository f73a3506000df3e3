"""``lanewise watch``: draws an episode from above into a GIF or MP4."""

from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated

from lanewise.cli.command_line import Changes, Parsed
from lanewise.errors import SettingsError
from lanewise.evaluation.settings import WORLDS
from lanewise.export import policy_file
from lanewise.fields.ranges import SEEDS, Between, OneOf
from lanewise.runs import pretrained
from lanewise.system import extras
from lanewise.system.progress import tell

FORMATS = (".gif", ".mp4")


@dataclass(frozen=True, kw_only=True)
class Watch:
    """Draw one test episode from above, with goal, speed and reward."""

    run: Path = field(default=pretrained.DRIVER, metadata={"positional": True})
    """Run folder, finished or not, or a checkpoint in it; a file of `lanewise export`; or
    pretrained/NAME or reference/NAME."""
    out: Path = field(metadata={"short": "-o"})
    """Clip to write, ending in .gif or .mp4."""
    seed: Annotated[int, SEEDS] = 0
    """Seed of the starts."""
    episode: Annotated[int, Between(0, 10_000_000)] = 0
    """Which episode of the seed, counted from 0."""
    world: Annotated[str, OneOf(WORLDS)] = "lanewise"
    """World to drive in."""
    test: Changes = field(default_factory=dict)
    """Settings of the test."""


def run(parsed: Parsed[Watch]) -> int:
    """Draws; returns the exit code."""
    command = parsed.command
    if command.out.suffix.lower() not in FORMATS:
        raise SettingsError(f"--out must end in .gif or .mp4, got {command.out}")
    policy_file.controller_name(command.run)
    from lanewise.report import output_files

    extras.check()
    output_files.check_writable(command.out)
    from lanewise.experiments import evaluate_trained
    from lanewise.export import exported
    from lanewise.report import clip

    controller = evaluate_trained.with_changes(exported.load(command.run), command.test, tell)
    tell("driving the episode")
    recording = evaluate_trained.record(controller, command.world, command.seed, command.episode)
    tell("drawing the clip")
    clip.render(recording, command.out)
    tell(f"wrote {command.out}")
    return 0
