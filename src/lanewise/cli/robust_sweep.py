"""``lanewise sweep --grid robust``: how a controller holds over conditions that it may meet."""

import hashlib
import json
import sys
from dataclasses import replace
from typing import TYPE_CHECKING, Any

from lanewise import config
from lanewise.cli import journal as journals
from lanewise.cli.command_line import Parsed, flag_of
from lanewise.cli.journal import Journal
from lanewise.config.settings import Settings
from lanewise.errors import RunError, SettingsError, one_line, shell_line
from lanewise.evaluation import conditions
from lanewise.evaluation.conditions import (
    HORIZONS,
    JUDGED,
    Condition,
    ConditionCell,
    ConditionGrid,
    ConditionOutcome,
)
from lanewise.evaluation.grid import check_searchable
from lanewise.runs import pretrained
from lanewise.runs.run_folder import RunFolder
from lanewise.system import extras
from lanewise.system.progress import Progress, tell

if TYPE_CHECKING:
    from lanewise.cli.sweep_command import Sweep

JOURNAL, PAGE = "progress.json", "robust.md"
EPISODES = 100
"""Of each cell where the user does not say."""


def run(parsed: "Parsed[Sweep]") -> int:
    """Tests and draws; returns the exit code."""
    grid, episodes = _grid(parsed), _episodes(parsed)
    command = replace(parsed.command, episodes=episodes)
    folder = RunFolder.open(pretrained.locate(command.run))
    own = config.replace(folder.settings, command.test)
    check_searchable(own.scenario)
    for group in grid.groups():
        for condition in group:
            varied = {*condition.settings, "evaluation.duration"}
            if both := varied & set(command.test):
                raise SettingsError(f"{flag_of(both.pop())} is grid robust's own; leave it out")
            settings_under(own, condition)
    extras.check()
    if (command.out / PAGE).exists():
        raise RunError(f"{command.out} is complete: see {command.out / PAGE}")
    journals.check_place(command.out / JOURNAL)
    from lanewise.experiments import evaluate_trained
    from lanewise.runs import checkpoint, trained

    controller = evaluate_trained.with_changes(trained.load(command.run), command.test, tell)
    identity = {
        "kind": "Sweep of conditions",
        "controller": controller.name,
        "weights": hashlib.sha256(checkpoint.pack(controller.parameters)).hexdigest(),
        "test": command.test,
        **{name: getattr(command, name) for name in ("episodes", "seed", "clearance")},
        **vars(grid),
    }
    plain = json.loads(json.dumps(identity))
    journal = journals.open_(command.out / JOURNAL, plain, ConditionOutcome)
    with journal.folder:
        with Progress() as reporter:
            _work(command, grid, controller, journal, reporter)
        _report(command, grid, folder, controller, journal)
    return 0


def settings_under(settings: Settings, condition: Condition) -> Settings:
    """Settings of a run under a condition, its tests as long as the last horizon.

    Raises:
        SettingsError: the condition contradicts another setting of the run.
    """
    return config.replace(settings, condition.settings | {"evaluation.duration": HORIZONS[-1]})


def _grid(parsed: "Parsed[Sweep]") -> ConditionGrid:
    """The axes, those that both grids have with values of this one."""
    command, given = parsed.command, parsed.given
    axes: dict[str, Any] = {
        name: getattr(command, name) for name in ("population", "density", "noise", "latency")
    }
    if "lanes" in given:
        axes["lanes"] = command.lanes
    if given & {"ego_speed", "trap_speed"}:
        ego, trap = (
            getattr(command, name) if name in given else () for name in ("ego_speed", "trap_speed")
        )
        if len(ego) != len(trap):
            raise SettingsError(
                "--ego-speed and --trap-speed are pairs in grid robust: give as many of each, "
                f"got {len(ego)} and {len(trap)}"
            )
        axes["speeds"] = tuple(zip(ego, trap, strict=True))
    grid = ConditionGrid(**axes)
    conditions.check(grid)
    return grid


def _episodes(parsed: "Parsed[Sweep]") -> int:
    return parsed.command.episodes if "episodes" in parsed.given else EPISODES


def _work(
    command: "Sweep",
    grid: ConditionGrid,
    controller: Any,
    journal: Journal[ConditionOutcome],
    reporter: Progress,
) -> None:
    """Does what the journal lacks."""
    from lanewise.evaluation import condition_drives
    from lanewise.evaluation.evaluator import EvaluationConfig
    from lanewise.experiments import evaluate_trained

    def test_of(condition: Condition) -> EvaluationConfig:
        changed = settings_under(controller.settings, condition)
        return evaluate_trained.evaluation_config(replace(controller, settings=changed))

    places, done = grid.winnable_places(), len(journal.reached)
    reporter.stage("what can be won", len(places), done)
    known = [reach.escape for reach in journal.reached]
    widest = test_of(grid.groups()[0][-1]._replace(lanes=max(grid.lanes)))
    for verdict in condition_drives.reach(widest, command.clearance, places[done:], known):
        journal.add([verdict])
        reporter.update(len(journal.reached))
    total = sum(map(len, grid.groups()))
    reporter.stage("conditions", total, len(journal.outcomes))
    for found in condition_drives.run(
        test_of,
        controller.parameters,
        command.seed,
        command.episodes,
        grid,
        len(journal.outcomes),
    ):
        journal.add(found)
        rate = sum(each.at(JUDGED).accidents for each in journal.outcomes) / (
            command.episodes * len(journal.outcomes)
        )
        reporter.update(len(journal.outcomes), accident_rate=rate)


def _report(
    command: "Sweep",
    grid: ConditionGrid,
    folder: RunFolder,
    controller: Any,
    journal: Journal[ConditionOutcome],
) -> None:
    from lanewise.report import robust_page

    reached = dict(zip(grid.winnable_places(), journal.reached, strict=True))
    all_conditions = [condition for group in grid.groups() for condition in group]
    cells = []
    for condition, outcome in zip(all_conditions, journal.outcomes, strict=True):
        place = (condition.ego_speed, condition.trap_speed, condition.lanes)
        winnable = place in reached and reached[place].winnable
        cells.append(ConditionCell(condition, winnable, outcome))
    found = robust_page.RobustResult(
        controller=controller.name,
        training_seed=folder.seed,
        trained_by=folder.source,
        settings=config.flatten(controller.settings),
        changes=command.test,
        seen=conditions.seen_in_training(folder.settings.scenario),
        grid=grid,
        episodes=command.episodes,
        seed=command.seed,
        clearance=command.clearance,
        run=str(command.run),
        command=shell_line("lanewise", *sys.argv[1:]),
        reached=reached,
        cells=cells,
    )
    page = journal.publish(lambda drawn: robust_page.write_robust(drawn, found))
    sys.stdout.write(f"{robust_page.summary(found)}\n\nmap: {one_line(page)}\n")
