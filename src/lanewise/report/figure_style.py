"""How every figure looks, and how it is written: one place for fonts, lines, bands and files."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from lanewise.report.markup import line
from lanewise.report.output_files import replacing
from lanewise.system.extras import needed_for

with needed_for("a figure"):
    import matplotlib.style
    from matplotlib import colormaps as colormaps
    from matplotlib.artist import Artist as Artist
    from matplotlib.axes import Axes as Axes
    from matplotlib.cm import ScalarMappable as ScalarMappable
    from matplotlib.collections import PolyCollection as PolyCollection
    from matplotlib.colors import Normalize as Normalize
    from matplotlib.colors import PowerNorm as PowerNorm
    from matplotlib.colors import to_rgb
    from matplotlib.figure import Figure as Figure
    from matplotlib.lines import Line2D as Line2D
    from matplotlib.patches import Patch as Patch
    from matplotlib.patches import Polygon as Polygon
    from matplotlib.patches import Rectangle as Rectangle

Floats = NDArray[np.float64]
Look = dict[str, Any]
"""Keywords of a matplotlib artist."""

FORMATS = (".png", ".svg")
WIDTH, DPI = 7.2, 200
"""Width of a figure, inches: both columns of a journal page; resolution of a PNG."""
DRAWN, THIN = 1.6, 0.5
"""Widths of a curve and of a band's edge, points."""
GRID, MUTED = "0.9", "0.35"
"""Greys of the grid and of what is less important."""


class Style(NamedTuple):
    """A curve's colour, its dashes and its marker."""

    colour: str
    dashes: tuple[int, tuple[float, ...]]
    marker: str


# Okabe and Ito's colours differ for every kind of colour vision; dashes and markers in grey print.
STYLES = (
    Style("#000000", (0, ()), "o"),
    Style("#0072B2", (0, (5, 1.5)), "s"),
    Style("#D55E00", (0, (1, 1)), "^"),
    Style("#009E73", (0, (6, 1.5, 1, 1.5)), "D"),
    Style("#CC79A7", (0, (3, 1, 1, 1, 1, 1)), "v"),
    Style("#E69F00", (0, (9, 2)), "P"),
    Style("#56B4E9", (0, (2, 2)), "X"),
)
OWN = {"single-level": 0, "hierarchical": 1, "planned": 2, "h-dqn": 3}
"""Controllers that look the same in every figure, by their place in `STYLES`."""

_RC: dict[Any, Any] = {
    "font.family": "DejaVu Sans",
    "font.size": 9.0,
    # Words are measured at the resolution they are drawn at, and their widths follow their sizes.
    "figure.dpi": DPI,
    "text.hinting": "none",
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": False,
    "mathtext.fontset": "dejavusans",
    "hatch.linewidth": 0.5,
    "svg.fonttype": "none",
    "svg.hashsalt": "lanewise",
}


@contextmanager
def look() -> Iterator[None]:
    """The settings of every figure, whatever the user's own are; also a decorator of `draw`."""
    with matplotlib.style.context(["default", _RC]):
        yield


def save(figure: Figure, path: Path, suffixes: Iterable[str] = FORMATS) -> None:
    """Write a freshly drawn figure under each suffix; the same data give the same bytes."""
    for suffix in suffixes:
        # Without the date in it, the same data give the same file.
        metadata = {"Date": None} if suffix == ".svg" else {"Software": "lanewise"}
        with look(), replacing(path.with_name(path.name + suffix)) as beside:
            figure.savefig(beside, format=suffix[1:], dpi=DPI, metadata=metadata)


def styles(titles: Iterable[str]) -> dict[str, Style]:
    """A style for each title: controllers keep their own, others take what is left, in order."""
    titles = list(titles)
    own = {title: OWN[title.lower()] for title in titles if title.lower() in OWN}
    left = iter(number for number in range(len(STYLES)) if number not in own.values())
    return {title: STYLES[own[title] if title in own else next(left)] for title in titles}


def curve(axes: Axes, x: Floats, y: Floats, style: Style, **more: Any) -> None:
    """One curve."""
    axes.plot(x, y, color=style.colour, linestyle=style.dashes, linewidth=DRAWN, **more)


def band(
    axes: Axes, x: Floats, low: Floats, high: Floats, style: Style, *, stepped: bool = False
) -> None:
    """What lies between two curves, pale; stepped: each value holds till the next.

    The thin edges keep the style's dashes, so that bands differ in grey too.
    """
    pale: Look = {"color": style.colour, "alpha": 0.13, "linewidth": 0.0}
    axes.fill_between(x, low, high, step="post" if stepped else None, **pale)
    thin: Look = {"color": style.colour, "alpha": 0.7, "linewidth": THIN, "linestyle": style.dashes}
    for edge in (low, high):
        axes.plot(x, edge, drawstyle="steps-post" if stepped else "default", **thin)


def field(axes: Axes, x: float, low: float, high: float, fill: Any) -> tuple[Rectangle, str]:
    """A field of a map over rows from ``low`` to ``high``, and the ink to write in it."""
    colour = to_rgb(fill)
    # Luma, as in ITU-R BT.601.
    ink = "black" if np.dot(colour, (0.299, 0.587, 0.114)) > 0.5 else "white"
    look: Look = {"facecolor": colour, "edgecolor": "white", "linewidth": 0.8}
    box = Rectangle((x - 0.5, low - 0.5), 1.0, high - low + 1.0, **look)
    axes.add_patch(box)
    return box, ink


def keys(
    arms: Mapping[str, Sequence[Any]], looks: Mapping[str, Style], noun: str, band: str
) -> list[Artist]:
    """Legend entries of curves, each with how many it is the mean of, and of their bands if any."""
    handles: list[Artist] = []
    for title, own in looks.items():
        count = len(arms[title])
        label = f"{plain(title)} ({count} {noun}{'s' if count > 1 else ''})"
        handles.append(Line2D([], [], color=own.colour, ls=own.dashes, lw=DRAWN, label=label))
    if any(len(each) > 1 for each in arms.values()):
        handles.append(Patch(facecolor="0.87", edgecolor="0.4", linewidth=THIN, label=band))
    return handles


def legend(figure: Figure, handles: Sequence[Artist], most: int = 3) -> None:
    """A legend above the panels, in as many columns as its labels leave room for."""
    longest = max(len(str(handle.get_label())) for handle in handles)
    # A letter of this size is 0.075 inches wide on average, a handle with its space 0.65.
    columns = int(WIDTH / (0.65 + 0.075 * longest))
    figure.legend(
        handles=handles,
        loc="outside upper center",
        ncols=max(1, min(most, columns, len(handles))),
        frameon=False,
    )


def plain(title: str) -> str:
    """A title as it stands, on one line: nothing in it is read as mathematics."""
    return line(title).replace("$", r"\$")


def panels(figure: Figure, count: int) -> list[Axes]:
    """Panels one below the other over one horizontal axis, with a grid and a letter each."""
    stacked = list(figure.subplots(count, 1, sharex=True, squeeze=False)[:, 0])
    for letter, axes in zip("abcdefgh", stacked, strict=False):
        axes.grid(color=GRID, linewidth=0.6)
        axes.set_axisbelow(True)
        axes.margins(x=0.01)
        axes.set_title(f"({letter})", loc="left", fontsize="medium", pad=3.0)
    return stacked
