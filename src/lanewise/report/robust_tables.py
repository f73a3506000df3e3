"""Tables of how a controller holds over conditions, as Markdown, and the cells they pool."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from lanewise.errors import shell_line
from lanewise.evaluation.conditions import (
    HORIZONS,
    JUDGED,
    KINDS,
    NOBODY,
    ConditionCell,
    ConditionGrid,
    HorizonCounts,
    pooled,
)
from lanewise.evaluation.episodes import ACCIDENT_KINDS
from lanewise.evaluation.grid import Reach
from lanewise.evaluation.statistics import Interval
from lanewise.report import tables
from lanewise.report.markup import code
from lanewise.report.sweep_map import figure_of

SEEN, HELD_OUT, ALONE = "seen in training", "held out", "no traffic"
"""Sorts of cells, by their population."""
WORST = 10
"""Cells that the page lists as the worst."""
OUTCOMES = {"accidents": "accidents", "escapes": "success (paper)", "successes": "success"}


@dataclass(frozen=True)
class RobustResult:
    """A controller over a grid of conditions."""

    controller: str
    training_seed: int
    trained_by: Mapping[str, Any]
    """The code its run was made with (`version.source`)."""
    trained_on: str
    """Which of these settings its training had otherwise, in words; empty where none."""
    settings: Mapping[str, Any]
    """Of its run, by dotted name, with the changes."""
    changes: Mapping[str, Any]
    """What the test changed besides, by dotted name."""
    seen: tuple[str, ...]
    """Populations it has met in training."""
    grid: ConditionGrid
    episodes: int
    """Of each cell."""
    seed: int
    """Of the starts."""
    clearance: float
    """m, as of `grid.Reach`."""
    run: str
    """As the user named it."""
    command: str
    reached: Mapping[tuple[float, float, int], Reach]
    """Which starts can be won by the first horizon, by speeds (ego, trap) in m/s and lanes."""
    cells: Sequence[ConditionCell]
    """All of them, in the grid's order."""

    def sort(self, cell: ConditionCell) -> str:
        """Whether a cell's population was seen in training; cells without traffic stand apart."""
        population = cell.condition.population
        return ALONE if population == NOBODY else SEEN if population in self.seen else HELD_OUT

    def sorts(self) -> dict[str, list[ConditionCell]]:
        """The cells of each sort that there is."""
        found = {name: [c for c in self.cells if self.sort(c) == name] for name in (SEEN, HELD_OUT)}
        found[ALONE] = [c for c in self.cells if self.sort(c) == ALONE]
        return {name: cells for name, cells in found.items() if cells}


def fold(cells: Sequence[ConditionCell], *axes: str) -> dict[tuple[Any, ...], list[ConditionCell]]:
    """The cells by their values on some axes; all other axes are folded together."""
    groups: dict[tuple[Any, ...], list[ConditionCell]] = {}
    for cell in cells:
        groups.setdefault(tuple(getattr(cell.condition, axis) for axis in axes), []).append(cell)
    return groups


def summary(result: RobustResult) -> str:
    """Accidents and success by sort, with intervals, and the worst cell."""
    rows = []
    for sort, cells in [*result.sorts().items(), ("all", list(result.cells))]:
        by_then, first = pooled(cells, JUDGED), pooled(cells, 0, winnable=True)
        worst = ranked(cells)[0].outcome.at(JUDGED)
        shown = [_with_interval(each, "accidents") for each in (by_then, worst)]
        shown += [_with_interval(first, name) for name in ("escapes", "successes")]
        rows.append([sort, str(by_then.cells), str(by_then.episodes), *shown])
    seconds, test = HORIZONS[JUDGED], HORIZONS[0]
    heads = ["population", "cells", "episodes", f"accidents by {seconds} s, mean", "worst cell"]
    heads += [f"{OUTCOMES[name]} by {test} s, winnable" for name in ("escapes", "successes")]
    return tables.markdown(heads, rows)


def by_axes(result: RobustResult, heads: Sequence[str], *axes: str) -> str:
    """Every outcome at every horizon, by the values on some axes."""
    rows = []
    for values, cells in fold(result.cells, *axes).items():
        names = [value if isinstance(value, str) else f"{value:g}" for value in values]
        if axes == ("population",):
            names.append(result.sort(cells[0]))
        rows.append([*names, str(len(cells)), *_outcomes(cells)])
    heads = [*heads, "cells"]
    heads += [f"{title}, {seconds} s" for title in OUTCOMES.values() for seconds in HORIZONS]
    texts = {"population": 2, "density": 1}
    return tables.markdown(heads, rows, texts=texts.get(axes[0], 0))


def by_kind(result: RobustResult) -> str:
    """Accidents by kind, % of all episodes at every horizon and of each sort at the judged one."""
    horizons = range(len(HORIZONS))
    columns = {f"{HORIZONS[h]} s": pooled(result.cells, h) for h in horizons}
    for sort, cells in result.sorts().items():
        columns[f"{sort}, {HORIZONS[JUDGED]} s"] = pooled(cells, JUDGED)
    rows = [
        [ACCIDENT_KINDS[kind], *(_percent(c.kinds[place], c.episodes) for c in columns.values())]
        for place, kind in enumerate(KINDS)
    ]
    rows.append(["any", *(_percent(c.accidents, c.episodes) for c in columns.values())])
    return tables.markdown(["accident", *columns], rows)


def winnable(result: RobustResult) -> str:
    """Which starts can be won, by speeds and lanes."""
    rows = []
    for (ego, trap, lanes), reach in result.reached.items():
        verdicts = ("yes" if reach.winnable else "no", "yes" if reach.clear else "no")
        if not reach.decided:
            verdicts = ("undecided", verdicts[1])
        rows.append([f"{ego:g}", f"{trap:g}", str(lanes), *verdicts])
    heads = ["ego, m/s", "trap, m/s", "lanes", "winnable", f"with {result.clearance:g} m clearance"]
    return tables.markdown(heads, rows, texts=0)


def ranked(cells: Sequence[ConditionCell]) -> list[ConditionCell]:
    """The cells with the most accidents at the judged horizon first; of equals, with traffic."""

    def badness(cell: ConditionCell) -> tuple[int, ...]:
        hits = (cell.outcome.at(horizon).accidents for horizon in (JUDGED, 0, -1))
        return (next(hits), int(cell.condition.population != NOBODY), *hits)

    return sorted(cells, key=badness, reverse=True)


def worst(result: RobustResult) -> str:
    """The worst cells, and below them a command for each that shows its first accident."""
    rows, commands = [], []
    for cell in ranked(result.cells)[:WORST]:
        at, condition = cell.outcome.at(JUDGED), cell.condition
        if not at.accidents:
            break
        kind = ACCIDENT_KINDS[KINDS[at.kinds.index(max(at.kinds))]]
        axes = [value if isinstance(value, str) else f"{value:g}" for value in condition]
        rows.append([*axes, result.sort(cell), _with_interval(at, "accidents"), kind])
        commands.append(watch_line(result, cell))
    if not rows:
        return f"There is no accident by {HORIZONS[JUDGED]} s in any cell."
    heads = ["population", "density", "ego, m/s", "trap, m/s", "lanes", "noise", "latency, s"]
    heads += ["", f"accidents by {HORIZONS[JUDGED]} s", "most often"]
    lines = "\n".join(f"{number}. {code(line)}" for number, line in enumerate(commands, 1))
    table = tables.markdown(heads, rows, texts=2)
    return f"{table}\n\nTo watch the first accident of each:\n\n{lines}"


def watch_line(result: RobustResult, cell: ConditionCell) -> str:
    """The command that draws a cell's first accident by the judged horizon."""
    words = ["--episode", cell.outcome.first_accident[JUDGED]]
    words += ["--seed", result.seed, "--evaluation.duration", HORIZONS[JUDGED]]
    for name, value in {**result.changes, **cell.condition.settings}.items():
        if name in result.changes or value != result.settings[name]:
            several = value if isinstance(value, tuple) else (value,)
            words += [f"--{name.replace('_', '-')}", *(several or ("none",))]
    return shell_line("lanewise", "watch", result.run, *words, "-o", "clip.mp4")


def _outcomes(cells: Sequence[ConditionCell]) -> list[str]:
    """Accidents of all cells and both successes of the winnable ones at every horizon, %."""
    found = []
    for name in OUTCOMES:
        for horizon in range(len(HORIZONS)):
            counts = pooled(cells, horizon, winnable=name != "accidents")
            found.append(_percent(getattr(counts, name), counts.episodes))
    return found


def _percent(count: int, episodes: int) -> str:
    return figure_of(100.0 * (count / episodes)) if episodes else tables.UNKNOWN


def _with_interval(counts: HorizonCounts, name: str) -> str:
    interval: Interval | None = counts.interval(name)
    if interval is None:
        return tables.UNKNOWN
    low, high = (100.0 * end for end in interval)
    return f"{100.0 * counts.rate(name):.2f} % ({low:.2f}, {high:.2f})"
