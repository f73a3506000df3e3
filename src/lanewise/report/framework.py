"""The framework: the high level sets goals, the low level drives to them, the critic judges."""

from pathlib import Path

from lanewise.config.settings import Settings
from lanewise.extras import needed_for
from lanewise.report import control_loop, diagram, style
from lanewise.report.control_loop import Loop, Part
from lanewise.report.diagram import Kind

with needed_for("the schematic of the framework"):
    from matplotlib.figure import Figure


def write(settings: Settings, path: Path | str) -> None:
    """Draw the hierarchical controller as it is tested into a PNG or SVG file.

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
    figure, axes = diagram.page(style.WIDTH, control_loop.HEIGHT + 0.35)
    control_loop.draw(
        axes,
        0.0,
        Part(Kind.LEARNS, "high-level controller", control_loop.high_level(settings), True),
        Part(Kind.LEARNS, "low-level controller", control_loop.low_level(settings), True),
        settings,
        Loop(
            control_loop.critic(settings.goals, settings.goals.test_renewal),
            "reward, while training",
        ),
    )
    figure.legend(
        handles=diagram.key((Kind.LEARNS, Kind.RULES, Kind.WORLD)),
        loc="upper center",
        ncols=3,
        frameon=False,
    )
    return figure
