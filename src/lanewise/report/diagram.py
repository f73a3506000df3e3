"""Boxes and arrows on an empty page measured in inches, for the schematics without a road."""

from collections.abc import Sequence
from enum import Enum
from typing import Any, NamedTuple

from lanewise.extras import needed_for
from lanewise.report.style import Look

with needed_for("a schematic"):
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from matplotlib.patches import FancyArrowPatch, FancyBboxPatch, Patch
    from matplotlib.path import Path as Curve
    from matplotlib.text import Text

Point = tuple[float, float]

LINE = 0.165
"""Height of a line of a box's text, inches."""
SMALLEST = 4.0
"""Font size below which nobody could read it, points."""


class Kind(Enum):
    """What a box does; each is told from the others by fill, edge and dashes."""

    LEARNS = "learns"
    FROZEN = "learnt, frozen"
    RULES = "follows rules"
    WORLD = "simulated"


_LOOKS: dict[Kind, Look] = {
    Kind.LEARNS: {"facecolor": "#CFE3F3", "edgecolor": "#0072B2", "linewidth": 2.2},
    Kind.FROZEN: {"facecolor": "white", "edgecolor": "#0072B2", "linewidth": 1.2},
    Kind.RULES: {"facecolor": "white", "edgecolor": "0.2", "linewidth": 1.0},
    Kind.WORLD: {"facecolor": "0.91", "edgecolor": "0.2", "linewidth": 1.0},
}
_DASHES: dict[Kind, Any] = {Kind.FROZEN: (0, (1.5, 1.5)), Kind.RULES: (0, (5, 2))}


class Box(NamedTuple):
    """A box's place, inches from the lower left."""

    left: float
    bottom: float
    width: float
    height: float

    @property
    def right(self) -> float:
        """Its right edge."""
        return self.left + self.width

    @property
    def top(self) -> float:
        """Its upper edge."""
        return self.bottom + self.height

    @property
    def middle(self) -> float:
        """Its centre's height."""
        return self.bottom + self.height / 2.0

    @property
    def centre(self) -> float:
        """Its centre from the left."""
        return self.left + self.width / 2.0


def page(width: float, height: float) -> tuple[Figure, Axes]:
    """A figure whose only axes is an invisible sheet in inches."""
    figure = Figure(figsize=(width, height))
    axes = figure.add_axes((0.0, 0.0, 1.0, 1.0))
    axes.set_xlim(0.0, width)
    axes.set_ylim(0.0, height)
    axes.set_axis_off()
    return figure, axes


def box(axes: Axes, place: Box, kind: Kind, title: str, lines: Sequence[str] = ()) -> None:
    """A box with a title and lines of text, in its middle."""
    axes.add_patch(
        FancyBboxPatch(
            (place.left, place.bottom),
            place.width,
            place.height,
            boxstyle="round,pad=0,rounding_size=0.06",
            linestyle=_DASHES.get(kind, "-"),
            **_LOOKS[kind],
        )
    )
    top = place.middle + LINE * len(lines) / 2.0
    for number, words in enumerate((title, *lines)):
        text = axes.text(
            place.centre,
            top - LINE * number,
            words,
            ha="center",
            va="center",
            fontsize=8.5 if number == 0 else 7.5,
            fontweight="bold" if number == 0 else "normal",
        )
        _fit(text, place.width - 0.12)


def _fit(text: Text, inches: float) -> None:
    """Make a text smaller until it has room; widths do not quite follow sizes."""
    room = inches * text.get_figure(root=True).get_dpi()  # type: ignore[union-attr]
    while text.get_window_extent().width > room and float(text.get_fontsize()) > SMALLEST:
        text.set_fontsize(float(text.get_fontsize()) - 0.25)


def arrow(axes: Axes, points: Sequence[Point], *, dashed: bool = False, color: str = "0") -> None:
    """An arrow along corners, the head at the last."""
    codes = [Curve.MOVETO, *[Curve.LINETO] * (len(points) - 1)]
    axes.add_patch(
        FancyArrowPatch(
            path=Curve(list(points), codes),
            arrowstyle="-|>",
            mutation_scale=9.0,
            linewidth=1.1,
            linestyle=(0, (4, 2)) if dashed else "-",
            color=color,
            joinstyle="miter",
            shrinkA=0.0,
            shrinkB=0.0,
        )
    )


def words(axes: Axes, place: Point, text: str, align: str = "center", **more: Any) -> None:
    """A label; its lowest line stands at the place."""
    look: Look = {"fontsize": 7.5, "ha": align, "va": "bottom", "linespacing": 1.25}
    axes.text(*place, text, **{**look, **more})


def key(kinds: Sequence[Kind]) -> list[Patch]:
    """Legend entries of kinds of boxes."""
    return [
        Patch(linestyle=_DASHES.get(kind, "-"), label=kind.value, **_LOOKS[kind]) for kind in kinds
    ]
