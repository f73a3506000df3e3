"""``lanewise train``: trains a controller into a run folder, or continues one."""

from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated

from lanewise.cli.command_line import Parsed
from lanewise.config.settings import PRESETS, TRAPS, Settings
from lanewise.controllers.registry import TRAINABLE
from lanewise.errors import shell_line
from lanewise.fields.ranges import SEEDS, OneOf
from lanewise.runs.run_folder import STAGES, RunFolder, open_high_level
from lanewise.system.progress import Progress, tell


@dataclass(frozen=True, kw_only=True)
class Train:
    """Train a controller into a run folder, or continue a run that was stopped.

    Settings come from the defaults, the preset, the trap, the settings file and the command
    line; later ones win. Defaults are those of preset quick; "row N" is that of the table in
    docs/paper.md.
    """

    controller: Annotated[str, OneOf(TRAINABLE)] = field(metadata={"positional": True})
    """Which controller to train: hierarchical, a high level that sets goals (step 1) and a low
    level that learns to reach them (step 2), as in the paper; single-level, the flat baseline on
    the same nine actions; planned, step 1 alone, whose goals a planner carries out; h-dqn, both
    levels learning at once."""
    out: Path
    """Run folder: new or empty, or a stopped run together with --resume."""
    seed: Annotated[int, SEEDS] = 0
    """Seed of everything random."""
    resume: bool = False
    """Continue the run in the folder, with its own settings, to the same bits as if it had never
    stopped."""
    high_level: Path | None = None
    """A run whose finished step 1 is taken over: a hierarchical controller then trains step 2
    alone."""
    tensorboard: bool = False
    """Also write TensorBoard's events, into the folder tensorboard of the run. A resumed run that
    has them continues them."""
    preset: Annotated[str, OneOf(tuple(PRESETS))] = "quick"
    """Training preset."""
    trap: Annotated[str, OneOf(tuple(TRAPS))] = "trap-10"
    """Scenario preset."""
    settings: Path | None = None
    """TOML file with any of the settings below, e.g. trap_speed = 9.5 under [scenario]."""
    values: Settings = field(default_factory=Settings)
    """Every setting."""


def run(parsed: Parsed[Train]) -> int:
    """Trains; returns the exit code."""
    command = parsed.command
    if command.high_level is not None and not command.resume:
        # Before the folder is made: a refused run leaves nothing behind.
        open_high_level(command.high_level, command.controller, command.values)
    if command.tensorboard:
        from lanewise.runs import metric_sinks

        metric_sinks.tensorboard_writer()
    with _folder(parsed) as folder:
        from lanewise.runs import training_loop
        from lanewise.training.plan import TrainingPlan

        plan = TrainingPlan.build(folder.settings, folder.controller)
        with Progress() as reporter:
            lender, events = command.high_level, command.tensorboard
            training_loop.train(folder, plan, reporter, high_level=lender, tensorboard=events)
        test = shell_line("lanewise", "evaluate", folder.path)
        tell(f"finished: {folder.path}; test it with: {test}")
    return 0


def how_to_continue(command: Train) -> str:
    """Says how an interrupted training is continued."""
    words = ["train", command.controller, "--out", str(command.out)]
    if command.high_level is not None and not (command.out / STAGES).exists():
        words += ["--high-level", str(command.high_level)]  # not taken over yet
    return f"continue with:\n  {shell_line('lanewise', *words, '--resume')}"


def _folder(parsed: Parsed[Train]) -> RunFolder:
    command = parsed.command
    if not command.resume:
        return RunFolder.create(command.out, command.values, command.controller, command.seed)
    return RunFolder.resume(
        command.out,
        command.values if parsed.settings_given else None,
        command.controller,
        command.seed if "seed" in parsed.given else None,
    )
