"""``lanewise sweep``: tests a trained controller over a grid and draws the map."""

import hashlib
import json
import sys
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Protocol

from lanewise import config
from lanewise.cli import journal as journals
from lanewise.cli.command_line import Changes, Parsed, flag_of
from lanewise.cli.journal import Journal
from lanewise.cli.robust_sweep import RobustSweep
from lanewise.cli.start_sweep import StartSweep
from lanewise.config.settings import Settings
from lanewise.errors import RunError, SettingsError, one_line, shell_line
from lanewise.evaluation.cells import CellOutcome, PlacedGrid, Reach, cells_of, check_axes
from lanewise.evaluation.conditions import DENSITIES, ConditionGrid, seen_in_training
from lanewise.evaluation.grid import Grid, check_searchable
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


class SweptGrid(Protocol):
    """What the command asks of a grid."""

    page: str
    """Name of the file that is written last."""
    episodes: int
    """Of each cell."""

    @property
    def grid(self) -> PlacedGrid[Any]:
        """Its axes and cells."""

    def check(self, settings: Settings) -> None:
        """Refuse cells that no test with these settings can have."""

    def horizons(self, settings: Settings) -> tuple[int, ...]:
        """Times at which a test with these settings is judged, s."""

    def reach(self, controller: "Trained", known: Sequence[str]) -> Iterator[Reach]:
        """Which starts can be won, but for those whose escapes are known."""

    def drive(self, controller: "Trained", done: int) -> Iterator[list[CellOutcome]]:
        """The outcomes of the cells, some at a time, but for those that are done."""


GRIDS: dict[str, Callable[[Parsed[Sweep]], SweptGrid]] = {
    "starts": StartSweep,
    "robust": RobustSweep,
}


def run(parsed: Parsed[Sweep]) -> int:
    """Tests and draws; returns the exit code."""
    command = parsed.command
    _refuse_other_axes(parsed)
    swept = GRIDS[command.grid](parsed)
    check_axes(vars(swept.grid))
    folder = RunFolder.open(pretrained.locate(command.run))
    settings = config.replace(folder.settings, command.test)
    check_searchable(settings.scenario)
    swept.check(settings)
    extras.check()
    if (command.out / swept.page).exists():
        raise RunError(f"{command.out} is complete: see {command.out / swept.page}")
    journals.check_place(command.out / JOURNAL)
    from lanewise.experiments import evaluate_trained
    from lanewise.runs import trained

    loaded = trained.load(command.run)
    controller = evaluate_trained.with_changes(loaded, command.test, tell)
    journal = journals.open_(command.out / JOURNAL, _identity(command, swept, controller))
    with journal.folder:
        with Progress() as reporter:
            _work(swept, controller, journal, reporter)
        _report(command, swept, folder, (loaded, controller), journal)
    return 0


def _refuse_other_axes(parsed: Parsed[Sweep]) -> None:
    """Refuses an axis that the grid does not have."""
    grid = parsed.command.grid
    for name in ROBUST_ALONE if grid == "starts" else STARTS_ALONE:
        if name in parsed.given:
            raise SettingsError(f"{flag_of(name)} is no axis of grid {grid}; leave it out")


def _identity(command: Sweep, swept: SweptGrid, controller: "Trained") -> dict[str, Any]:
    """What must be the same for a journal to be continued."""
    from lanewise.runs import checkpoint

    asked = {
        "grid": command.grid,
        "axes": vars(swept.grid),
        "controller": controller.name,
        "weights": hashlib.sha256(checkpoint.pack(controller.parameters)).hexdigest(),
        "test": command.test,
        "episodes": swept.episodes,
        "seed": command.seed,
        "clearance": command.clearance,
    }
    same: dict[str, Any] = json.loads(json.dumps(asked))
    return same


def _work(swept: SweptGrid, controller: "Trained", journal: Journal, reporter: Progress) -> None:
    """Does what the journal lacks."""
    reporter.stage("what can be won", len(swept.grid.searched()), len(journal.reached))
    for verdict in swept.reach(controller, [reach.escape for reach in journal.reached]):
        journal.add([verdict])
        lost = sum(not reach.winnable for reach in journal.reached)
        reporter.update(len(journal.reached), unwinnable=lost)
    reporter.stage("episodes", len(swept.grid.places()), len(journal.outcomes))
    for found in swept.drive(controller, len(journal.outcomes)):
        journal.add(found)
        counts = [outcome.at(0) for outcome in journal.outcomes]
        episodes = sum(each.episodes for each in counts)
        reporter.update(
            len(counts),
            success_rate=sum(each.successes for each in counts) / episodes,
            accident_rate=sum(each.accidents for each in counts) / episodes,
        )


def _report(
    command: Sweep,
    swept: SweptGrid,
    folder: RunFolder,
    tested: "tuple[Trained, Trained]",
    journal: Journal,
) -> None:
    """Writes the map; ``tested`` is the controller with its own settings and with the test's."""
    from lanewise.experiments import evaluate_trained
    from lanewise.report import robust_page, sweep_page
    from lanewise.report.sweep_result import SweepResult

    loaded, controller = tested
    settings = controller.settings
    result: SweepResult[Any] = SweepResult(
        controller=controller.name,
        training_seed=folder.seed,
        trained_by=folder.source,
        trained_on=evaluate_trained.trained_on(loaded, settings),
        seen=seen_in_training(loaded.settings.scenario),
        settings=config.flatten(settings),
        changes=command.test,
        run=str(command.run),
        command=shell_line("lanewise", *sys.argv[1:]),
        episodes=swept.episodes,
        seed=command.seed,
        clearance=command.clearance,
        horizons=swept.horizons(settings),
        axes=vars(swept.grid),
        cells=cells_of(swept.grid, journal.reached, journal.outcomes),
    )
    pages = robust_page if command.grid == "robust" else sweep_page
    page = journal.publish(lambda drawn: pages.write(drawn, result))
    sys.stdout.write(f"{pages.summary(result)}\n\nmap: {one_line(page)}\n")
