"""Measuring a road in a figure: dimension lines with their labels, as in a drawing."""

from lanewise.extras import needed_for
from lanewise.report.style import MINUS, MUTED, Look

with needed_for("a dimension line"):
    from matplotlib.axes import Axes
    from matplotlib.text import Text

THIN = 0.8


def measure(axes: Axes, start: float, end: float, y: float, label: str) -> Text:
    """A line with arrows from `start` to `end` m at height `y`, the label beside its middle.

    The label stands above the line where the road is below it, and below it otherwise.
    """
    line: Look = {"arrowstyle": "<->", "linewidth": 1.0, "shrinkA": 0.0, "shrinkB": 0.0}
    axes.annotate(
        "", (start, y), (end, y), arrowprops={**line, "mutation_scale": 8.0}, annotation_clip=False
    )
    return beside(axes, (start + end) / 2.0, y, label, "center")


def beside(axes: Axes, x: float, y: float, label: str, align: str) -> Text:
    """A label on the side of a dimension line that is away from the road."""
    top, bottom = sorted(axes.get_ylim())
    above = y < (top + bottom) / 2.0  # y points down, as in a picture from above
    return axes.annotate(
        label,
        (x, y),
        (0.0, 3.0 if above else -3.0),
        textcoords="offset points",
        ha=align,
        va="bottom" if above else "top",
        annotation_clip=False,
        # Lines that lead farther out pass behind the label.
        bbox={"facecolor": "white", "linewidth": 0.0, "pad": 0.8},
    )


def number(value: float) -> str:
    """A number as a label writes it, with a true minus."""
    return f"{value:g}".replace("-", MINUS)


def reach(axes: Axes, x: float, start: float, end: float) -> None:
    """A thin line that leads from a vehicle to a dimension line."""
    axes.plot(
        (x, x), (start, end), color=MUTED, linewidth=THIN, linestyle=(0, (2, 2)), clip_on=False
    )


def spread(axes: Axes, low: float, high: float, y: float, height: float) -> None:
    """A range as a bar with end marks, `height` m tall."""
    axes.fill_between((low, high), y - height / 2, y + height / 2, color="0.75", clip_on=False)
    for end in (low, high):
        axes.plot((end, end), (y - height, y + height), color="black", linewidth=1.2, clip_on=False)
