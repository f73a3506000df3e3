"""Grid ``robust`` of ``lanewise sweep``: how a controller holds over conditions it may meet."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from lanewise import config
from lanewise.cli.command_line import Parsed, flag_of
from lanewise.cli.journal import Journal
from lanewise.config.settings import Settings
from lanewise.errors import SettingsError
from lanewise.evaluation import conditions
from lanewise.evaluation.conditions import (
    HORIZONS,
    JUDGED,
    Condition,
    ConditionCell,
    ConditionGrid,
    ConditionOutcome,
)
from lanewise.evaluation.grid import Reach

if TYPE_CHECKING:
    from lanewise.cli.sweep_command import Sweep
    from lanewise.evaluation.evaluator import EvaluationConfig
    from lanewise.report.robust_tables import RobustResult
    from lanewise.runs.trained import Trained

EPISODES = 100
"""Of each cell where the user does not say."""


class RobustSweep:
    """The grid of conditions, as the command asks for it (`SweptGrid`)."""

    page = "robust.md"
    outcome = ConditionOutcome

    def __init__(self, parsed: "Parsed[Sweep]") -> None:
        """Of a command."""
        command = self._command = parsed.command
        self.episodes = command.episodes if "episodes" in parsed.given else EPISODES
        self._grid = _grid(parsed)

    @property
    def axes(self) -> Mapping[str, object]:
        """The values of every axis."""
        return vars(self._grid)

    def check(self, settings: Settings) -> None:
        """Refuse an axis that names a value twice, and conditions that no run can be tested in."""
        conditions.check(self._grid)
        for condition in self.cells():
            varied = {*condition.settings, "evaluation.duration"}
            if both := varied & set(self._command.test):
                raise SettingsError(f"{flag_of(both.pop())} is grid robust's own; leave it out")
            settings_under(settings, condition)

    def starts(self) -> list[Condition]:
        """One condition of each approach that may be winnable."""
        return self._grid.searched()

    def cells(self) -> list[Condition]:
        """All conditions."""
        return [condition for group in self._grid.groups() for condition in group]

    def reach(self, controller: "Trained", known: Sequence[str]) -> Iterator[Reach]:
        """Which starts can be won, but for those whose escapes are known."""
        from lanewise.evaluation import sweep

        test = _test(controller, self.cells()[0]._replace(lanes=max(self._grid.lanes)))
        by_then = replace(test, duration=test.driving.decisions_in(HORIZONS[0]))
        left = self.starts()[len(known) :]
        return sweep.reach(by_then, self._command.clearance, left, known)

    def drive(self, controller: "Trained", done: int) -> Iterator[list[ConditionOutcome]]:
        """The outcomes of the cells, a group at a time, but for those that are done."""
        from lanewise.evaluation import condition_drives

        return condition_drives.run(
            lambda condition: _test(controller, condition),
            controller.parameters,
            self._command.seed,
            self.episodes,
            self._grid,
            done,
        )

    def rate(self, outcomes: Sequence[ConditionOutcome]) -> dict[str, float]:
        """How often it had an accident so far."""
        hits = sum(outcome.at(JUDGED).accidents for outcome in outcomes)
        return {"accident_rate": hits / (self.episodes * len(outcomes))}

    def result(
        self, journal: Journal[ConditionOutcome], training: Settings, **test: Any
    ) -> "RobustResult":
        """All that is known; ``test`` says who was tested and how."""
        from lanewise.report.robust_tables import RobustResult

        places = [condition.approach for condition in self.starts()]
        reached = dict(zip(places, journal.reached, strict=True))
        cells = []
        for condition, outcome in zip(self.cells(), journal.outcomes, strict=True):
            reach = reached.get(condition.approach)
            winnable = reach is not None and reach.winnable
            cells.append(ConditionCell(condition, winnable, outcome))
        return RobustResult(
            changes=self._command.test,
            seen=conditions.seen_in_training(training.scenario),
            grid=self._grid,
            run=str(self._command.run),
            reached=reached,
            cells=cells,
            **test,
        )

    def write(self, folder: str, result: "RobustResult") -> Path:
        """Write the map and its page."""
        from lanewise.report import robust_page

        return robust_page.write_robust(folder, result)

    def summary(self, result: "RobustResult") -> str:
        """Accidents and success of populations seen in training and held out."""
        from lanewise.report import robust_page

        return robust_page.summary(result)


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
    return ConditionGrid(**axes)


def _test(controller: "Trained", condition: Condition) -> "EvaluationConfig":
    from lanewise.experiments import evaluate_trained

    changed = settings_under(controller.settings, condition)
    return evaluate_trained.evaluation_config(replace(controller, settings=changed))
