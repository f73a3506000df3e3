"""Tables of how a controller holds over conditions, as Markdown, and the cells they pool."""

from collections.abc import Sequence

from lanewise.errors import shell_line
from lanewise.evaluation.cells import KINDS, Cell, fold, pool
from lanewise.evaluation.conditions import HORIZONS, JUDGED, NOBODY, Condition
from lanewise.evaluation.episodes import ACCIDENT_KINDS
from lanewise.report import tables
from lanewise.report.markup import code
from lanewise.report.sweep_result import TITLES, SweepResult, figure_of, share

SEEN, HELD_OUT, ALONE = "seen in training", "held out", "no traffic"
"""Sorts of cells, by their population."""
WORST = 10
"""Cells that the page lists as the worst."""


def sort(result: SweepResult[Condition], cell: Cell[Condition]) -> str:
    """Whether a cell's population was seen in training; cells without traffic stand apart."""
    population = cell.place.population
    return ALONE if population == NOBODY else SEEN if population in result.seen else HELD_OUT


def sorts(result: SweepResult[Condition]) -> dict[str, list[Cell[Condition]]]:
    """The cells of each sort that there is."""
    found = {
        name: [cell for cell in result.cells if sort(result, cell) == name]
        for name in (SEEN, HELD_OUT, ALONE)
    }
    return {name: cells for name, cells in found.items() if cells}


def summary(result: SweepResult[Condition]) -> str:
    """Accidents and success by sort, with intervals, and the worst cell."""
    rows = []
    for name, cells in [*sorts(result).items(), ("all", list(result.cells))]:
        by_then, first = pool(cells, JUDGED), pool(cells, 0, "winnable")
        worst = ranked(cells)[0].outcome.at(JUDGED)
        shown = [share(each, "accidents") for each in (by_then, worst)]
        shown += [share(first, outcome) for outcome in ("escapes", "successes")]
        rows.append([name, str(by_then.cells), str(by_then.episodes), *shown])
    seconds, test = HORIZONS[JUDGED], HORIZONS[0]
    heads = ["population", "cells", "episodes", f"accidents by {seconds} s, mean", "worst cell"]
    heads += [f"{TITLES[name]} by {test} s, winnable" for name in ("escapes", "successes")]
    return tables.markdown(heads, rows)


def by_axes(result: SweepResult[Condition], heads: Sequence[str], *axes: str) -> str:
    """Every outcome at every horizon, by the values on some axes."""
    rows = []
    for values, cells in fold(result.cells, *axes).items():
        names = [value if isinstance(value, str) else f"{value:g}" for value in values]
        if axes == ("population",):
            names.append(sort(result, cells[0]))
        rows.append([*names, str(len(cells)), *_outcomes(cells)])
    heads = [*heads, "cells"]
    heads += [f"{title}, {seconds} s" for title in TITLES.values() for seconds in HORIZONS]
    texts = {"population": 2, "density": 1}
    return tables.markdown(heads, rows, texts=texts.get(axes[0], 0))


def by_kind(result: SweepResult[Condition]) -> str:
    """Accidents by kind, % of all episodes at every horizon and of each sort at the judged one."""
    horizons = range(len(HORIZONS))
    columns = {f"{HORIZONS[h]} s": pool(result.cells, h) for h in horizons}
    for name, cells in sorts(result).items():
        columns[f"{name}, {HORIZONS[JUDGED]} s"] = pool(cells, JUDGED)
    rows = [
        [ACCIDENT_KINDS[kind], *(_percent(c.kinds[place], c.episodes) for c in columns.values())]
        for place, kind in enumerate(KINDS)
    ]
    rows.append(["any", *(_percent(c.accidents, c.episodes) for c in columns.values())])
    return tables.markdown(["accident", *columns], rows)


def winnable(result: SweepResult[Condition]) -> str:
    """Which starts can be won, by speeds and lanes."""
    rows = []
    searched = {cell.place.approach: cell.reach for cell in result.cells if cell.reach}
    for (ego, trap, lanes), reach in searched.items():
        verdicts = ("yes" if reach.winnable else "no", "yes" if reach.clear else "no")
        if not reach.decided:
            verdicts = ("undecided", verdicts[1])
        rows.append([f"{ego:g}", f"{trap:g}", str(lanes), *verdicts])
    heads = ["ego, m/s", "trap, m/s", "lanes", "winnable", f"with {result.clearance:g} m clearance"]
    return tables.markdown(heads, rows, texts=0)


def ranked(cells: Sequence[Cell[Condition]]) -> list[Cell[Condition]]:
    """The cells with the most accidents at the judged horizon first; of equals, with traffic."""

    def badness(cell: Cell[Condition]) -> tuple[int, ...]:
        hits = (cell.outcome.at(horizon).accidents for horizon in (JUDGED, 0, -1))
        return (next(hits), int(cell.place.population != NOBODY), *hits)

    return sorted(cells, key=badness, reverse=True)


def worst(result: SweepResult[Condition]) -> str:
    """The worst cells, and below them a command for each that shows its first accident."""
    rows, commands = [], []
    for cell in ranked(result.cells)[:WORST]:
        at, condition = cell.outcome.at(JUDGED), cell.place
        if not at.accidents:
            break
        kind = ACCIDENT_KINDS[KINDS[at.kinds.index(max(at.kinds))]]
        axes = [value if isinstance(value, str) else f"{value:g}" for value in condition]
        rows.append([*axes, sort(result, cell), share(at, "accidents"), kind])
        commands.append(watch_line(result, cell))
    if not rows:
        return f"There is no accident by {HORIZONS[JUDGED]} s in any cell."
    heads = ["population", "density", "ego, m/s", "trap, m/s", "lanes", "noise", "latency, s"]
    heads += ["", f"accidents by {HORIZONS[JUDGED]} s", "most often"]
    lines = "\n".join(f"{number}. {code(line)}" for number, line in enumerate(commands, 1))
    table = tables.markdown(heads, rows, texts=2)
    return f"{table}\n\nTo watch the first accident of each:\n\n{lines}"


def watch_line(result: SweepResult[Condition], cell: Cell[Condition]) -> str:
    """The command that draws a cell's first accident by the judged horizon."""
    words = ["--episode", cell.outcome.first_accident[JUDGED]]
    words += ["--seed", result.seed, "--evaluation.duration", HORIZONS[JUDGED]]
    for name, value in {**result.changes, **cell.place.settings}.items():
        if name in result.changes or value != result.settings[name]:
            several = value if isinstance(value, tuple) else (value,)
            words += [f"--{name.replace('_', '-')}", *(several or ("none",))]
    return shell_line("lanewise", "watch", result.run, *words, "-o", "clip.mp4")


def _outcomes(cells: Sequence[Cell[Condition]]) -> list[str]:
    """Accidents of all cells and both successes of the winnable ones at every horizon, %."""
    found = []
    for name in TITLES:
        for horizon in range(len(HORIZONS)):
            counts = pool(cells, horizon, "all" if name == "accidents" else "winnable")
            found.append(_percent(getattr(counts, name), counts.episodes))
    return found


def _percent(count: int, episodes: int) -> str:
    return figure_of(100.0 * (count / episodes)) if episodes else tables.UNKNOWN
