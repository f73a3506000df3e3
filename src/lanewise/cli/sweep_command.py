"""``lanewise sweep``: tests a trained controller over a grid of starts and draws the map."""

import hashlib
import json
import sys
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from lanewise import config
from lanewise.cli import journal as journals
from lanewise.cli.command_line import Changes, Parsed, flag_of
from lanewise.cli.journal import Journal
from lanewise.config.settings import Settings
from lanewise.errors import RunError, SettingsError, one_line, shell_line
from lanewise.evaluation import grid as grids
from lanewise.evaluation.conditions import DENSITIES, ConditionGrid
from lanewise.evaluation.grid import Cell, Grid, PointResult
from lanewise.fields.ranges import SEEDS, Between, OneOf
from lanewise.runs import pretrained
from lanewise.runs.run_folder import RunFolder
from lanewise.scenario.settings import (
    EgoSpeed,
    FrontDistance,
    Lanes,
    Populations,
    SideDistance,
    TrapSpeed,
)
from lanewise.system import extras
from lanewise.system.progress import Progress, tell

if TYPE_CHECKING:
    from lanewise.runs.trained import Trained

JOURNAL = "progress.json"
"""What is done so far, in the output folder until all is."""
STARTS_ALONE = ("front_distance", "side_distance", "spacing", "vehicles_behind")
ROBUST_ALONE = ("population", "density", "noise", "latency")
"""Axes that one grid has and the other has not."""


@dataclass(frozen=True, kw_only=True)
class Sweep:
    """Test a trained controller over a grid and draw a map of the results.

    Each axis takes one or more values; every combination is a cell. Grid `starts` varies where the
    ego and the trap start. Grid `robust` varies what a controller may meet: who drives the traffic,
    how dense it is, speeds, lanes, noise and latency. It judges after 25, 60 and 120 s. The same
    command continues what was interrupted.
    """

    run: Path = field(metadata={"positional": True})
    """Run folder, finished or not, or a checkpoint in it; or pretrained/NAME."""
    out: Path
    """Folder for the map: new or empty, or one this command was stopped in."""
    grid: Annotated[str, OneOf(("starts", "robust"))] = "starts"
    """What varies."""
    episodes: Annotated[int, Between(1, 100_000)] = 20
    """Episodes of each start; of grid robust 100 unless given."""
    seed: Annotated[int, SEEDS] = 0
    """Seed of the traffic."""
    clearance: Annotated[float, Between(0.0, 1.5, "m")] = 0.1
    """Distance from the trap cars that an escape must keep to count as one with clearance."""
    ego_speed: Annotated[tuple[float, ...], EgoSpeed] = Grid.ego_speed
    """The ego's speeds at the start; of grid robust 10 12 10 13 unless given."""
    trap_speed: Annotated[tuple[float, ...], TrapSpeed] = Grid.trap_speed
    """Speeds of the trap cars; of grid robust one for each speed of the ego, 10 10 8 11 unless
    given."""
    lanes: Annotated[tuple[int, ...], Lanes] = Grid.lanes
    """Numbers of lanes; of grid robust 2 3 5 unless given."""
    front_distance: Annotated[tuple[float, ...], FrontDistance] = Grid.front_distance
    """Values of D1. Grid starts alone."""
    side_distance: Annotated[tuple[float, ...], SideDistance] = Grid.side_distance
    """Values of D2. Grid starts alone."""
    spacing: Annotated[tuple[float, ...], Between(0.0, 1000.0, "m")] = Grid.spacing
    """Mean distances from one traffic vehicle to the next. Grid starts alone."""
    vehicles_behind: Annotated[tuple[int, ...], Between(0, 100)] = Grid.vehicles_behind
    """Numbers of traffic vehicles behind the ego. Grid starts alone."""
    population: Annotated[tuple[str, ...], Populations] = ConditionGrid.population
    """Whose drivers the traffic consists of. Grid robust alone."""
    density: Annotated[tuple[str, ...], OneOf(tuple(DENSITIES))] = ConditionGrid.density
    """How much traffic there is. Grid robust alone."""
    noise: Annotated[tuple[float, ...], Between(0.0, 10.0)] = ConditionGrid.noise
    """Standard deviations of the normal error of every feature, as scaled. Grid robust alone."""
    latency: Annotated[tuple[float, ...], Between(0.0, 10.0, "s")] = ConditionGrid.latency
    """Times from a decision until it takes effect. Grid robust alone."""
    test: Changes = field(default_factory=dict)
    """Settings of the test; one that an axis varies is that axis's only value."""


def run(parsed: Parsed[Sweep]) -> int:
    """Tests and draws; returns the exit code."""
    command = parsed.command
    _refuse_other_axes(parsed)
    if command.grid == "robust":
        from lanewise.cli import robust_sweep

        return robust_sweep.run(parsed)
    grid = _grid(parsed)
    folder = RunFolder.open(pretrained.locate(command.run))
    _check(grid, config.replace(folder.settings, command.test))
    extras.check()
    if (command.out / "map.md").exists():
        raise RunError(f"{command.out} is complete: see {command.out / 'map.md'}")
    journals.check_place(command.out / JOURNAL)
    from lanewise.experiments import evaluate_trained
    from lanewise.runs import trained

    loaded = trained.load(command.run)
    controller = evaluate_trained.with_changes(loaded, command.test, tell)
    identity = _identity(command, controller)
    journal = journals.open_(command.out / JOURNAL, identity, PointResult)
    with journal.folder:
        with Progress() as reporter:
            _work(command, grid, controller, journal, reporter)
        trained_on = evaluate_trained.trained_on(loaded, controller.settings)
        _report(command, grid, folder, (controller, trained_on), journal)
    return 0


def _refuse_other_axes(parsed: Parsed[Sweep]) -> None:
    """Refuses an axis that the grid does not have."""
    grid = parsed.command.grid
    for name in ROBUST_ALONE if grid == "starts" else STARTS_ALONE:
        if name in parsed.given:
            raise SettingsError(f"{flag_of(name)} is no axis of grid {grid}; leave it out")


def _grid(parsed: Parsed[Sweep]) -> Grid:
    """The grid, where a setting of the test gives an axis its only value."""
    axes = {axis.name: getattr(parsed.command, axis.name) for axis in fields(Grid)}
    for axis, setting in grids.SETTINGS.items():
        if setting not in parsed.command.test:
            continue
        if axis in parsed.given:
            raise SettingsError(
                f"{flag_of(axis)} and {flag_of(setting)} are the same axis; give one of them"
            )
        axes[axis] = (parsed.command.test[setting],)
    return Grid(**axes)


def _check(grid: Grid, settings: Settings) -> None:
    """Refuses an axis that names a value twice, and starts that no run could have."""
    grids.check(grid)
    grids.check_searchable(settings.scenario)
    # With the most vehicles behind: whether they fit depends on the spacing.
    crowded = {grids.SETTINGS["vehicles_behind"]: max(grid.vehicles_behind)}
    for axis, setting in grids.SETTINGS.items():
        for value in getattr(grid, axis):
            try:
                config.replace(settings, crowded | {setting: value})
            except SettingsError as error:
                raise SettingsError(f"--{axis.replace('_', '-')}: {error}") from error


def _work(
    command: Sweep,
    grid: Grid,
    controller: "Trained",
    journal: Journal[PointResult],
    reporter: Progress,
) -> None:
    """Does what the journal lacks."""
    from lanewise.evaluation import sweep
    from lanewise.experiments import evaluate_trained

    points = grid.points()
    course = sweep.config(evaluate_trained.evaluation_config(controller), grid)
    # What can be won does not depend on traffic: one of each set of traffics suffices.
    apart = points[:: grid.traffics]
    done = len(journal.reached)
    reporter.stage("what can be won", len(apart), done)
    known = [reach.escape for reach in journal.reached]
    for verdict in sweep.reach(course, command.clearance, apart[done:], known):
        journal.add([verdict])
        lost = sum(not reach.winnable for reach in journal.reached)
        reporter.update(len(journal.reached), unwinnable=lost)
    reporter.stage("episodes", len(points), len(journal.outcomes))
    for found in sweep.run(
        course, controller.parameters, command.seed, command.episodes, points, len(journal.outcomes)
    ):
        journal.add(found)
        rate = sum(o.successes for o in journal.outcomes) / sum(
            o.episodes for o in journal.outcomes
        )
        reporter.update(len(journal.outcomes), success_rate=rate)


def _identity(command: Sweep, controller: "Trained") -> dict[str, Any]:
    """What must be the same for a journal to be continued."""
    from lanewise.runs import checkpoint

    weights = hashlib.sha256(checkpoint.pack(controller.parameters)).hexdigest()
    others = ("run", "out", "grid", *ROBUST_ALONE)
    asked = {name: value for name, value in vars(command).items() if name not in others}
    plain = {"kind": "Sweep", "controller": controller.name, "weights": weights, **asked}
    same: dict[str, Any] = json.loads(json.dumps(plain))
    return same


def _report(
    command: Sweep,
    grid: Grid,
    folder: RunFolder,
    test: "tuple[Trained, str]",
    journal: Journal[PointResult],
) -> None:
    """Draws the map; ``test`` is who drove, and how its training differed."""
    from lanewise.report import sweep_page

    controller, trained_on = test
    cells = [
        Cell(point, journal.reached[index // grid.traffics], journal.outcomes[index])
        for index, point in enumerate(grid.points())
    ]
    found = sweep_page.SweepResult(
        controller=controller.name,
        training_seed=folder.seed,
        trained_by=folder.source,
        settings=config.flatten(controller.settings),
        trained_on=trained_on,
        grid=grid,
        episodes=command.episodes,
        seed=command.seed,
        clearance=command.clearance,
        command=shell_line("lanewise", *sys.argv[1:]),
        cells=cells,
    )
    page = journal.publish(lambda drawn: sweep_page.write_sweep(drawn, found))
    sys.stdout.write(f"{sweep_page.totals(cells)}\n\nmap: {one_line(page)}\n")
