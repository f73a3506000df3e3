"""The map of conditions: accidents and success by population, density and lanes.

Populations seen in training stand above those held out. Without traffic nobody drives it, so that
such a field is as high as all populations.
"""

from collections.abc import Sequence
from typing import Any, NamedTuple

from lanewise.evaluation.cells import Cell, fold, pool
from lanewise.evaluation.conditions import EMPTY, HORIZONS, JUDGED, NOBODY, Condition
from lanewise.report import figure_style as style
from lanewise.report.figure_style import Axes, Figure, Look, Normalize, PowerNorm, ScalarMappable
from lanewise.report.robust_tables import SEEN, sort
from lanewise.report.sweep_result import SweepResult, figure_of

GAP = 0.35
"""Between groups of rows or columns, in fields."""
UNCOUNTED = "0.9"
"""Grey of a field without a winnable cell."""
ALL = "all"


class Panel(NamedTuple):
    """What one of the two maps shows."""

    title: str
    outcome: str
    horizon: int
    over: str
    """Which cells count, a name in `DENOMINATORS`."""
    scale: ScalarMappable


def panels() -> list[Panel]:
    """Both maps; bright is good in both, and a square root tells few accidents from none."""
    colours = style.colormaps
    few = ScalarMappable(PowerNorm(0.5, 0.0, 100.0), colours["cividis_r"])
    even = ScalarMappable(Normalize(0.0, 100.0), colours["cividis"])
    accidents = f"accidents by {HORIZONS[JUDGED]} s, % of episodes"
    accidents += "; populations seen in training stand first"
    success = f"success by {HORIZONS[0]} s, % of episodes that can be won"
    return [
        Panel(accidents, "accidents", JUDGED, "all", few),
        Panel(success, "successes", 0, "winnable", even),
    ]


@style.look()
def draw(result: SweepResult[Condition]) -> Figure:
    """The map of all cells."""
    rows, columns = _rows(result), _columns(result)
    width = max(style.WIDTH, 2.2 + 0.45 * len(columns))
    figure = Figure(figsize=(width, 1.2 + 2 * (0.8 + 0.25 * len(rows))), layout="constrained")
    for axes, panel in zip(figure.subplots(2, 1), panels(), strict=True):
        for (density, lanes), x in columns.items():
            for population, y in [(NOBODY, None)] if density == EMPTY else rows.items():
                own = [c for c in result.cells if _in(c, population, density, lanes)]
                low, high = (min(rows.values()), max(rows.values())) if y is None else (y, y)
                _field(axes, (x, low, high), own, panel)
        _label(axes, result, rows, columns)
        axes.set_title(panel.title, loc="left", fontsize="medium", pad=18.0)
        ticks = [0, 1, 5, 20, 50, 100] if panel.outcome == "accidents" else [0, 25, 50, 75, 100]
        figure.colorbar(panel.scale, ax=axes, ticks=ticks, aspect=14, pad=0.02, format="%g")
    return figure


def _in(cell: Cell[Condition], population: str, density: str, lanes: object) -> bool:
    """Whether a cell belongs to a field; the field of all densities has all its population's."""
    here = cell.place
    return here.population == population and (
        density == ALL or (here.density == density and here.lanes == lanes)
    )


def _rows(result: SweepResult[Condition]) -> dict[str, float]:
    """Where each population stands, downwards: seen ones, a gap, those held out."""
    names = {c.place.population: sort(result, c) for c in result.cells}
    names.pop(NOBODY, None)
    seen = [name for name, kind in names.items() if kind == SEEN]
    others = [name for name in names if name not in seen]
    rows = {name: float(place) for place, name in enumerate(seen)}
    after = len(seen) + GAP * bool(seen)
    rows |= {name: after + place for place, name in enumerate(others)}
    return rows or {NOBODY: 0.0}


def _columns(result: SweepResult[Condition]) -> dict[tuple[str, object], float]:
    """Where each density and number of lanes stands, and all of a population."""
    there = fold(result.cells, "density")
    densities = [name for name in result.axes["density"] if (name,) in there]
    lanes = result.axes["lanes"]
    places: dict[tuple[str, object], float] = {}
    for group, density in enumerate(densities):
        for place, number in enumerate(lanes):
            places[density, number] = group * (len(lanes) + GAP) + place
    if densities != [EMPTY]:
        places[ALL, ""] = len(densities) * (len(lanes) + GAP)
    return places


def _field(
    axes: Axes, place: tuple[float, float, float], cells: Sequence[Cell[Condition]], panel: Panel
) -> None:
    x, low, high = place
    counts = pool(cells, panel.horizon, panel.over)
    percent = 100.0 * counts.rate(panel.outcome)
    scale: Any = panel.scale
    colour = scale.to_rgba(percent) if counts.episodes else UNCOUNTED
    _, ink = style.field(axes, x, low, high, colour)
    shown = figure_of(percent) if counts.episodes else "-"
    axes.text(x, (low + high) / 2, shown, color=ink, ha="center", va="center", fontsize=7.0)


def _label(
    axes: Axes,
    result: SweepResult[Condition],
    rows: dict[str, float],
    columns: dict[tuple[str, object], float],
) -> None:
    """Populations, densities and lanes around a panel."""
    axes.set(xlim=(-0.6, max(columns.values()) + 0.6))
    axes.set_ylim(max(rows.values()) + 0.6, -0.6)
    axes.spines[["left", "bottom"]].set_visible(False)
    axes.tick_params(length=0.0)
    axes.set_xticks(list(columns.values()), [str(lanes) for _, lanes in columns])
    axes.set_xlabel("lanes")
    named = [f"{name} (seen)" if name in result.seen else name for name in rows]
    axes.set_yticks(list(rows.values()), ["no traffic" if n == NOBODY else n for n in named])
    for density in dict.fromkeys(density for density, _ in columns):
        own = [x for (name, _), x in columns.items() if name == density]
        words: Look = {"ha": "center", "va": "bottom", "fontsize": "small"}
        axes.text(sum(own) / len(own), -0.65, density, **words)
