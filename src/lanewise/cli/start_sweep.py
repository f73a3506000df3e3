"""Grid ``starts`` of ``lanewise sweep``: from where a controller gets out of the trap."""

from collections.abc import Iterator, Sequence
from dataclasses import fields
from typing import TYPE_CHECKING

from lanewise import config
from lanewise.cli.command_line import Parsed, flag_of
from lanewise.config.settings import Settings
from lanewise.errors import SettingsError
from lanewise.evaluation import grid as grids
from lanewise.evaluation.cells import CellOutcome, Reach
from lanewise.evaluation.grid import Grid

if TYPE_CHECKING:
    from lanewise.cli.sweep_command import Sweep
    from lanewise.evaluation.evaluator import EvaluationConfig
    from lanewise.runs.trained import Trained


class StartSweep:
    """The grid of starts, as the command asks for it (`SweptGrid`)."""

    page = "map.md"

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
        self.grid = Grid(**axes)

    def check(self, settings: Settings) -> None:
        """Refuse starts that no test with these settings can have."""
        grid = self.grid
        # With the most vehicles behind: whether they fit depends on the spacing.
        crowded = {grids.SETTINGS["vehicles_behind"]: max(grid.vehicles_behind)}
        for axis, setting in grids.SETTINGS.items():
            for value in getattr(grid, axis):
                try:
                    config.replace(settings, crowded | {setting: value})
                except SettingsError as error:
                    raise SettingsError(f"{flag_of(axis)}: {error}") from error

    def horizons(self, settings: Settings) -> tuple[int, ...]:
        """The end of the test alone, s."""
        return (settings.evaluation.duration,)

    def reach(self, controller: "Trained", known: Sequence[str]) -> Iterator[Reach]:
        """Which starts can be won, but for those whose escapes are known."""
        from lanewise.evaluation import sweep

        left = self.grid.searched()[len(known) :]
        return sweep.reach(self._test(controller), self._command.clearance, left, known)

    def drive(self, controller: "Trained", done: int) -> Iterator[list[CellOutcome]]:
        """The outcomes of the cells, some at a time, but for those that are done."""
        from lanewise.evaluation import sweep

        return sweep.run(
            self._test(controller),
            controller.parameters,
            self._command.seed,
            self.episodes,
            self.grid.places(),
            done,
        )

    def _test(self, controller: "Trained") -> "EvaluationConfig":
        from lanewise.evaluation import sweep
        from lanewise.experiments import evaluate_trained

        return sweep.config(evaluate_trained.evaluation_config(controller), self.grid)
