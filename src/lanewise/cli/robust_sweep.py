"""Grid ``robust`` of ``lanewise sweep``: how a controller holds over conditions it may meet."""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

from lanewise import config
from lanewise.cli.command_line import Parsed, flag_of
from lanewise.config.settings import Settings
from lanewise.errors import SettingsError
from lanewise.evaluation.cells import CellOutcome, Reach
from lanewise.evaluation.conditions import HORIZONS, Condition, ConditionGrid

if TYPE_CHECKING:
    from lanewise.cli.sweep_command import Sweep
    from lanewise.evaluation.evaluator import EvaluationConfig
    from lanewise.runs.trained import Trained

EPISODES = 100
"""Of each cell where the user does not say."""


class RobustSweep:
    """The grid of conditions, as the command asks for it (`SweptGrid`)."""

    page = "robust.md"

    def __init__(self, parsed: "Parsed[Sweep]") -> None:
        """Of a command."""
        command = self._command = parsed.command
        self.episodes = command.episodes if "episodes" in parsed.given else EPISODES
        self.grid = _grid(parsed)

    def check(self, settings: Settings) -> None:
        """Refuse conditions that no test with these settings can have."""
        for condition in self.grid.places():
            varied = {*condition.settings, "evaluation.duration"}
            if both := varied & set(self._command.test):
                raise SettingsError(f"{flag_of(both.pop())} is grid robust's own; leave it out")
            settings_under(settings, condition)

    def horizons(self, settings: Settings) -> tuple[int, ...]:
        """The same for all controllers, s."""
        return HORIZONS

    def reach(self, controller: "Trained", known: Sequence[str]) -> Iterator[Reach]:
        """Which starts can be won, but for those whose escapes are known."""
        from lanewise.evaluation import sweep

        test = _test(controller, self.grid.places()[0]._replace(lanes=max(self.grid.lanes)))
        by_then = replace(test, duration=test.driving.decisions_in(HORIZONS[0]))
        left = self.grid.searched()[len(known) :]
        return sweep.reach(by_then, self._command.clearance, left, known)

    def drive(self, controller: "Trained", done: int) -> Iterator[list[CellOutcome]]:
        """The outcomes of the cells, a group at a time, but for those that are done."""
        from lanewise.evaluation import condition_drives

        return condition_drives.run(
            lambda condition: _test(controller, condition),
            controller.parameters,
            self._command.seed,
            self.episodes,
            self.grid,
            done,
        )


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
