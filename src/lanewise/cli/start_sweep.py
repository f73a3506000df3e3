"""Grid ``starts`` of ``lanewise sweep``: from where a controller gets out of the trap."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import fields
from pathlib import Path
from typing import TYPE_CHECKING, Any

from lanewise import config
from lanewise.cli.command_line import Parsed, flag_of
from lanewise.cli.journal import Journal
from lanewise.config.settings import Settings
from lanewise.errors import SettingsError
from lanewise.evaluation import grid as grids
from lanewise.evaluation.grid import Cell, Grid, Point, PointResult, Reach

if TYPE_CHECKING:
    from lanewise.cli.sweep_command import Sweep
    from lanewise.evaluation.evaluator import EvaluationConfig
    from lanewise.report.sweep_page import SweepResult
    from lanewise.runs.trained import Trained


class StartSweep:
    """The grid of starts, as the command asks for it (`SweptGrid`)."""

    page = "map.md"
    outcome = PointResult

    def __init__(self, parsed: "Parsed[Sweep]") -> None:
        """Of a command; a setting of the test gives an axis its only value."""
        command = self._command = parsed.command
        self.episodes = command.episodes
        axes = {axis.name: getattr(command, axis.name) for axis in fields(Grid)}
        for axis, setting in grids.SETTINGS.items():
            if setting not in command.test:
                continue
            if axis in parsed.given:
                raise SettingsError(
                    f"{flag_of(axis)} and {flag_of(setting)} are the same axis; give one of them"
                )
            axes[axis] = (command.test[setting],)
        self._grid = Grid(**axes)

    @property
    def axes(self) -> Mapping[str, object]:
        """The values of every axis."""
        return vars(self._grid)

    def check(self, settings: Settings) -> None:
        """Refuse an axis that names a value twice, and starts that no run could have."""
        grid = self._grid
        grids.check(grid)
        # With the most vehicles behind: whether they fit depends on the spacing.
        crowded = {grids.SETTINGS["vehicles_behind"]: max(grid.vehicles_behind)}
        for axis, setting in grids.SETTINGS.items():
            for value in getattr(grid, axis):
                try:
                    config.replace(settings, crowded | {setting: value})
                except SettingsError as error:
                    raise SettingsError(f"{flag_of(axis)}: {error}") from error

    def starts(self) -> list[Point]:
        """One of each set of traffics: what can be won does not depend on traffic."""
        return self.cells()[:: self._grid.traffics]

    def cells(self) -> list[Point]:
        """All starts."""
        return self._grid.points()

    def reach(self, controller: "Trained", known: Sequence[str]) -> Iterator[Reach]:
        """Which starts can be won, but for those whose escapes are known."""
        from lanewise.evaluation import sweep

        left = self.starts()[len(known) :]
        return sweep.reach(self._test(controller), self._command.clearance, left, known)

    def drive(self, controller: "Trained", done: int) -> Iterator[list[PointResult]]:
        """The outcomes of the cells, some at a time, but for those that are done."""
        from lanewise.evaluation import sweep

        return sweep.run(
            self._test(controller),
            controller.parameters,
            self._command.seed,
            self.episodes,
            self.cells(),
            done,
        )

    def rate(self, outcomes: Sequence[PointResult]) -> dict[str, float]:
        """How often it succeeded so far."""
        episodes = sum(outcome.episodes for outcome in outcomes)
        return {"success_rate": sum(outcome.successes for outcome in outcomes) / episodes}

    def result(
        self, journal: Journal[PointResult], training: Settings, **test: Any
    ) -> "SweepResult":
        """All that is known; ``test`` says who was tested and how."""
        from lanewise.report.sweep_page import SweepResult

        cells = [
            Cell(point, journal.reached[index // self._grid.traffics], journal.outcomes[index])
            for index, point in enumerate(self.cells())
        ]
        return SweepResult(grid=self._grid, cells=cells, **test)

    def write(self, folder: str, result: "SweepResult") -> Path:
        """Write the map and its page."""
        from lanewise.report import sweep_page

        return sweep_page.write_sweep(folder, result)

    def summary(self, result: "SweepResult") -> str:
        """The shares over each denominator."""
        from lanewise.report import sweep_page

        return sweep_page.totals(result.cells)

    def _test(self, controller: "Trained") -> "EvaluationConfig":
        from lanewise.evaluation import sweep
        from lanewise.experiments import evaluate_trained

        return sweep.config(evaluate_trained.evaluation_config(controller), self._grid)
