"""Two-step training: the high level learns above a planner, then the low level learns below it."""

from pathlib import Path

from lanewise.config.settings import Settings
from lanewise.controllers import goals
from lanewise.extras import needed_for
from lanewise.report import control_loop, diagram, style
from lanewise.report.control_loop import Loop, Part
from lanewise.report.diagram import Kind
from lanewise.report.dimensions import number
from lanewise.report.style import MINUS, TIMES
from lanewise.training.settings import StageSettings

with needed_for("the schematic of two-step training"):
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

TITLE = 0.2
"""Height of a row's title, inches."""


def write(settings: Settings, path: Path | str) -> None:
    """Draw both steps of training into a PNG or SVG file.

    Args:
        settings: every number in the figure is theirs.
        path: ending in .png or .svg.

    Raises:
        LanewiseError: if the file cannot be written.
    """
    style.write(path, lambda: draw(settings))


@style.look()
def draw(settings: Settings) -> Figure:
    """The figure of `write`."""
    row = control_loop.HEIGHT + TITLE
    figure, axes = diagram.page(style.WIDTH, 2.0 * row + 0.4)
    _first(axes, row, settings)
    _second(axes, 0.0, settings)
    _handed_on(axes, row)
    figure.legend(handles=diagram.key(tuple(Kind)), loc="upper center", ncols=4, frameon=False)
    return figure


def _first(axes: Axes, base: float, settings: Settings) -> None:
    stage = settings.high_level
    summed = "summed over each goal"
    if stage.discount_across_goal == "per-decision":
        summed = "discounted within each goal"
    high = Part(Kind.LEARNS, "high-level controller", control_loop.high_level(settings), True)
    preview = settings.planner.preview
    looks = f"looks {preview} decision{'s' if preview > 1 else ''} ahead"
    planner = Part(Kind.RULES, "planner", (looks, *control_loop.low_level_actions(settings)))
    critic = control_loop.critic(settings.goals, "critic")
    control_loop.draw(axes, base, high, planner, settings, Loop(critic, f"reward, {summed}"))
    _title(axes, base, f"Step 1: the high level learns, {_budget(stage)}")


def _second(axes: Axes, base: float, settings: Settings) -> None:
    stage = settings.low_level
    paid = "reward"
    lateral, speed = number(goals.LATERAL_RANGE), number(goals.SPEED_RANGE)
    distance = f"($|\\Delta d|$ / {lateral} m + $|\\Delta v|$ / {speed} m/s)"
    if stage.tracking_weight:
        paid += f" {MINUS} {_factor(stage.tracking_weight)}{distance}"
    if stage.approach_weight:
        paid += f" + {_factor(stage.approach_weight)}fall of {distance}"
    high = Part(Kind.FROZEN, "high-level controller", control_loop.high_level(settings))
    low = Part(Kind.LEARNS, "low-level controller", control_loop.low_level(settings), True)
    critic = control_loop.critic(settings.goals, settings.goals.training_renewal)
    control_loop.draw(axes, base, high, low, settings, Loop(critic, paid))
    _title(axes, base, f"Step 2: the low level learns, {_budget(stage)}")


def _factor(weight: float) -> str:
    return "" if weight == 1.0 else f"{number(weight)} {TIMES} "


def _title(axes: Axes, base: float, text: str) -> None:
    height = base + control_loop.HEIGHT
    diagram.words(axes, (0.45, height), text, "left", fontsize=9.0, fontweight="bold")


def _handed_on(axes: Axes, row: float) -> None:
    """The high level's weights, from step 1 to step 2."""
    box, x = 0.45, 0.27
    upper, lower = (base + control_loop.BOXES + 0.47 for base in (row, 0.0))
    diagram.arrow(axes, ((box, upper), (x, upper), (x, lower), (box, lower)), color="#0072B2")
    axes.text(
        x - 0.05,
        upper - 0.75,
        "its weights, kept and frozen",
        rotation=90.0,
        ha="right",
        va="center",
        fontsize=7.5,
    )


def _budget(stage: StageSettings) -> str:
    parts = []
    if stage.episodes:
        parts.append(f"{stage.episodes:,} episodes")
    if stage.decisions:
        parts.append(f"{stage.decisions:,} decisions")
    return " or ".join(parts)
