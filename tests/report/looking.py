"""Looking at a figure as its reader would: where its words stand."""

from itertools import combinations

from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.text import Text


def words(figure: Figure) -> list[tuple[str, tuple[float, float, float, float]]]:
    """Every text a reader sees, with its box (left, bottom, right, top) in pixels."""
    FigureCanvasAgg(figure).draw()
    hidden = set()
    for axes in figure.axes:
        for axis in (axes.xaxis, axes.yaxis):
            low, high = sorted(axis.get_view_interval())
            for tick in [*axis.get_major_ticks(), *axis.get_minor_ticks()]:
                outside = not low - 1e-9 <= tick.get_loc() <= high + 1e-9
                if outside or not axes.axison:
                    hidden |= {tick.label1, tick.label2}
    seen = []
    for text in figure.findobj(Text):
        if text in hidden or not text.get_visible() or not text.get_text().strip():
            continue
        box = text.get_window_extent()
        seen.append((text.get_text(), (box.x0, box.y0, box.x1, box.y1)))
    return seen


def check_words(figure: Figure, slack: float = 0.5) -> None:
    """Fail where a word leaves the figure or runs into another."""
    seen = words(figure)
    assert seen
    width, height = figure.bbox.width, figure.bbox.height
    for name, (left, bottom, right, top) in seen:
        inside = -slack <= left and right <= width + slack
        inside = inside and -slack <= bottom and top <= height + slack
        assert inside, f"{name!r} leaves the figure"
    for (name, a), (other, b) in combinations(seen, 2):
        apart = a[2] <= b[0] + slack or b[2] <= a[0] + slack
        apart = apart or a[3] <= b[1] + slack or b[3] <= a[1] + slack
        assert apart, f"{name!r} runs into {other!r}"
