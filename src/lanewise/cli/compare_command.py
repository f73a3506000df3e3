"""``lanewise compare``: drives several trained controllers on the same starts, side by side."""

import dataclasses
import json
import sys
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from lanewise import config
from lanewise.cli.command_line import Changes, Parsed, flag_of
from lanewise.config.settings import Settings, of_test
from lanewise.controllers.registry import CONTROLLERS, STAGES
from lanewise.errors import RunError, shell_line
from lanewise.evaluation.settings import WORLDS
from lanewise.experiments.published import belongs_to_test
from lanewise.export import policy_file
from lanewise.export.policy_file import PolicyFile
from lanewise.fields.ranges import EPISODES, SEEDS, OneOf, show
from lanewise.runs import run_folder
from lanewise.runs.run_folder import RunFolder
from lanewise.system.progress import Progress, tell

if TYPE_CHECKING:
    from lanewise.evaluation.episodes import Episodes
    from lanewise.runs.trained import Trained


@dataclass(frozen=True, kw_only=True)
class Compare:
    """Test several trained controllers on the same starts and show them side by side.

    Each with 95 % intervals, its difference to the first start by start, and the settings in which
    they differ. Runs that differ in their seed alone count as the seeds of one arm.
    """

    runs: tuple[Path, ...] = field(metadata={"positional": True})
    """Run folders, finished or not, checkpoints in them, files of `lanewise export`, or
    pretrained/NAME; at least two, and differences are to the first."""
    world: Annotated[str, OneOf(WORLDS)] = "lanewise"
    """World to drive in: ours, or the real highway-env from the same starts."""
    episodes: Annotated[int, EPISODES] = 300
    """Number of test episodes of each run."""
    seed: Annotated[int, SEEDS] = 0
    """Seed of the starts."""
    scenario_of: Path | None = None
    """Drive all in the scenario of this run; needed where their own differ."""
    json: bool = False
    """Print one JSON object instead of tables."""
    markdown: Path | None = None
    """Also write the tables to this Markdown file."""
    csv: Path | None = None
    """Also write one line a run and metric to this CSV file."""
    test: Changes = field(default_factory=dict)
    """Settings of the test."""


def run(parsed: Parsed[Compare]) -> int:
    """Compares; returns the exit code."""
    command = parsed.command
    folders = [policy_file.open_controller(path) for path in command.runs]
    settings = _settings(folders, command.scenario_of, command.test)
    from lanewise.report import output_files

    output_files.check_writable(*filter(None, (command.markdown, command.csv)))
    from lanewise.evaluation import comparison

    entries = [
        comparison.Entry(
            str(path), folder.controller, folder.seed, (folder.digest, _weights(path, folder))
        )
        for path, folder in zip(command.runs, folders, strict=True)
    ]
    comparison.arm_members(entries)
    from lanewise.experiments import evaluate_trained
    from lanewise.export import exported
    from lanewise.report import comparison_page as pages

    controllers = [exported.load(path) for path in command.runs]
    for number, (path, own) in enumerate(zip(command.runs, settings, strict=True)):
        loaded = controllers[number]
        if loaded.note:
            tell(loaded.note)
        if line := evaluate_trained.trained_on(loaded, own):
            tell(f"{path} was {line}")
        controllers[number] = dataclasses.replace(loaded, settings=own)
        entries[number] = dataclasses.replace(entries[number], controller=loaded.name)
    episodes = _drive(controllers, command)
    page = pages.ComparisonPage(
        comparison.compare(entries, episodes, command.world),
        _of_training(folders),
        command.seed,
        None if command.scenario_of is None else str(command.scenario_of),
        shell_line("lanewise", *sys.argv[1:]),
    )
    # Printed first: a file that cannot be written must not cost the figures.
    sys.stdout.write(json.dumps(pages.to_json(page)) + "\n" if command.json else pages.text(page))
    if command.markdown is not None:
        output_files.write_text(command.markdown, pages.markdown(page))
    if command.csv is not None:
        output_files.write_text(command.csv, pages.to_csv(page))
    return 0


def _weights(path: Path, controller: RunFolder | PolicyFile) -> Path | str | None:
    """Which of a run's weights a path names: seeds of one arm name the same."""
    return path.suffix if isinstance(controller, PolicyFile) else run_folder.split(path)[1]


def _of_training(folders: Sequence[RunFolder | PolicyFile]) -> dict[str, tuple[Any, ...]]:
    """The settings in which runs differ; those of a stage only if two runs that have it differ."""
    sections = [{each.section for each in CONTROLLERS[of.controller].stages} for of in folders]
    staged = {each.section for each in STAGES}

    def counts(name: str, values: Sequence[Any]) -> bool:
        section = name.partition(".")[0]
        having = [v for v, own in zip(values, sections, strict=True) if section in own]
        return section not in staged or any(value != having[0] for value in having)

    found = config.differences([folder.settings for folder in folders])
    return {name: values for name, values in found.items() if counts(name, values)}


def _drive(controllers: "Sequence[Trained]", command: Compare) -> "list[Episodes]":
    """The test episodes of each."""
    from lanewise.experiments import evaluate_trained

    episodes = []
    with Progress() as reporter:
        for number, (controller, path) in enumerate(zip(controllers, command.runs, strict=True), 1):
            reporter.note(f"testing {path} ({number} of {len(controllers)})")
            test = (command.world, command.episodes, command.seed, reporter)
            episodes.append(evaluate_trained.evaluate(controller, *test))
    return episodes


def _settings(
    folders: Sequence[RunFolder | PolicyFile], scenario_of: Path | None, changes: Changes
) -> list[Settings]:
    """The settings each run is tested with: its own, in the scenario asked for.

    Raises:
        RunError: the runs would not be tested alike.
    """
    settings = [folder.settings for folder in folders]
    if scenario_of is not None:
        theirs = config.flatten(policy_file.open_controller(scenario_of).settings)
        scenario = {name: v for name, v in theirs.items() if name.startswith("scenario.")}
        settings = [config.replace(each, scenario) for each in settings]
    settings = [config.replace(each, changes) for each in settings]
    for folder, own in zip(folders[1:], settings[1:], strict=True):
        for name, (first, other) in config.differences([settings[0], own]).items():
            if belongs_to_test(name):
                hint = ""
                if name.startswith("scenario."):
                    hint = "\n  --scenario-of RUN tests all in that run's scenario"
                elif of_test(name):
                    hint = f"\n  {flag_of(name)} VALUE tests all alike"
                raise RunError(
                    f"{folders[0].path} and {folder.path} are not tested alike: {name} is "
                    f"{show(first)}, not {show(other)}{hint}"
                )
    return settings
