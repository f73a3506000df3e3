"""The paper's test table with ours beside it: as Markdown, for a terminal, and as JSON."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import isfinite, nan
from typing import Any

from lanewise.evaluation.episodes import ACCIDENTS
from lanewise.evaluation.metrics import (
    METRICS,
    PUBLISHED,
    PUBLISHED_EPISODES,
    Metric,
    Summary,
    published_interval,
)
from lanewise.evaluation.statistics import Interval
from lanewise.report.escape import cell, code, line

NOTE = (
    "In parentheses 95 % intervals: exact (Clopper-Pearson) for shares of episodes,",
    "Student's for means over episodes, the delta method's for ratios of sums.",
    "Success: past the trap without an accident, not even later; the paper's success",
    "forgives a later accident.",
)
"""Lines, each short enough for a terminal."""
TERMINAL = 80
"""Columns of the narrowest terminal worth fitting."""
LEFT_OUT = "Published figures are left out where the paper did something else:"
CAUSES = ACCIDENTS[1:]


@dataclass(frozen=True)
class Column:
    """One controller in one world, or as published."""

    controller: str
    """Name of the controller."""
    source: str
    """`published`, or the name of the world."""
    summary: Summary
    """Its figures."""


def columns(summaries: Sequence[Summary]) -> list[Column]:
    """Columns of the table: controller by controller, the published one before ours.

    Controllers come in the paper's order, others after them as given; a published column stands
    only beside a controller of ours whose tests are all the paper's.
    """
    ours = list(dict.fromkeys(s.controller for s in summaries))
    ordered = [c for c in PUBLISHED if c in ours] + [c for c in ours if c not in PUBLISHED]
    result = []
    for controller in ordered:
        own = [s for s in summaries if s.controller == controller]
        if controller in PUBLISHED and all(s.unlike_paper == "" for s in own):
            result.append(Column(controller, "published", _published(controller)))
        result += [Column(controller, s.world, s) for s in own]
    return result


def left_out(why: Mapping[str, str]) -> list[str]:
    """Lines that say why no published figures stand beside some tests; none where none is missed.

    Args:
        why: the reason, by what it is a test of.
    """
    names: dict[str, list[str]] = {}
    for name, reason in why.items():
        names.setdefault(line(reason), []).append(line(name))
    found = [f"- {', '.join(of)}: {reason}" for reason, of in names.items()]
    return [LEFT_OUT, *found] if found else []


def _left_out(summaries: Sequence[Summary]) -> list[str]:
    why: dict[str, str] = {}
    for summary in summaries:
        if summary.controller in PUBLISHED and summary.unlike_paper:
            why.setdefault(summary.controller, summary.unlike_paper)
    return left_out(why)


def _published(controller: str) -> Summary:
    intervals = {name: published_interval(controller, name) for name in PUBLISHED[controller]}
    known = {name: interval for name, interval in intervals.items() if interval is not None}
    return Summary(controller, "published", PUBLISHED_EPISODES, PUBLISHED[controller], {}, known)


def markdown(summaries: Sequence[Summary]) -> str:
    """The table as Markdown, with a note on the intervals."""
    heads = [f"{c.controller}, {c.source}" for c in columns(summaries)]
    rows = _rows(columns(summaries))
    lines = ["| | " + " | ".join(cell(head) for head in heads) + " |"]
    lines.append("|---|" + "---:|" * len(heads))
    lines += [f"| {cell(title)} | " + " | ".join(cells) + " |" for title, cells in rows]
    notes = ["\n".join(part) for part in (map(cell, _left_out(summaries)), NOTE)]
    return "\n\n".join(["\n".join(lines), *filter(None, notes)]) + "\n"


def text(summaries: Sequence[Summary]) -> str:
    """The table for a terminal: one block a controller, within 80 columns for two worlds."""
    blocks = []
    every = columns(summaries)
    for controller in dict.fromkeys(c.controller for c in every):
        block = [c for c in every if c.controller == controller]
        rows = [(line(controller), [c.source for c in block]), *_rows(block)]
        label = max(len(title) for title, _ in rows)
        widths = [max(len(cells[i]) for _, cells in rows) for i in range(len(block))]
        wide = label + sum(widths) + 2 * len(widths)
        gap = "  " if wide <= TERMINAL else " "
        lines = [
            gap.join(
                [title.ljust(label), *(c.rjust(w) for c, w in zip(cells, widths, strict=True))]
            )
            for title, cells in rows
        ]
        rule = "-" * len(lines[0])
        blocks.append("\n".join([lines[0].rstrip(), rule, *(row.rstrip() for row in lines[1:])]))
    notes = ["\n".join(part) for part in (_left_out(summaries), NOTE)]
    return "\n\n".join([*blocks, *filter(None, notes)]) + "\n"


def meanings() -> str:
    """What every metric means, as a Markdown list."""
    return "\n".join(f"- **{cell(metric.title)}**: {cell(metric.meaning)}." for metric in METRICS)


def listing(values: Mapping[str, Any]) -> str:
    """Names and values as a Markdown table."""
    lines = ["| | |", "|---|---|"]
    return "\n".join(
        lines + [f"| {cell(name)} | {code(value)} |" for name, value in values.items()]
    )


def _rows(table: Sequence[Column]) -> list[tuple[str, list[str]]]:
    rows = [("episodes", [str(c.summary.episodes) for c in table])]
    for metric in METRICS:
        if any(isfinite(c.summary.values.get(metric.name, nan)) for c in table):
            rows.append((_title(metric), [_figure(metric, c.summary) for c in table]))
        if metric.name == "accident_rate":
            rows += [_cause_row(cause, table) for cause in CAUSES]
    return rows


def _cause_row(cause: str, table: Sequence[Column]) -> tuple[str, list[str]]:
    counts = [c.summary.accidents.get(cause) for c in table]
    return "  " + cause.replace("_", " "), ["-" if n is None else str(n) for n in counts]


def _title(metric: Metric) -> str:
    # No square brackets: some terminals' markup would swallow them.
    return f"{metric.title}, {unit(metric)}" if unit(metric) else metric.title


def _figure(metric: Metric, summary: Summary) -> str:
    value = summary.values.get(metric.name, nan)
    if not isfinite(value):
        return "-"
    interval = summary.intervals.get(metric.name)
    shown = number(metric, value)
    return shown if interval is None else f"{shown} {bounds(metric, interval)}"


def unit(metric: Metric) -> str:
    """The unit a metric is shown in, or how it is counted; empty for plain numbers."""
    return "%" if metric.rate else metric.unit or metric.counted


def number(metric: Metric, value: float, sign: str = "") -> str:
    """A metric's value as shown; with the sign ``+`` also where it is positive."""
    return f"{_scale(metric) * value:{sign}.{_digits(metric)}f}"


def bounds(metric: Metric, interval: Interval) -> str:
    """A metric's interval as shown."""
    # One digit fewer for rates: their intervals are wide, and the columns narrow.
    digits = 1 if metric.rate else _digits(metric)
    low, high = (f"{_scale(metric) * end:.{digits}f}" for end in interval)
    return f"({low}, {high})"


def spread(values: Sequence[float], digits: int) -> str:
    """Mean over seeds, the lowest and the highest in parentheses.

    "-" if there is no seed, or if one seed's value is unknown.
    """
    if not len(values) or not all(map(isfinite, values)):
        return "-"
    mean = f"{sum(values) / len(values):.{digits}f}"
    if len(values) == 1:
        return mean
    return f"{mean} ({min(values):.{digits}f} to {max(values):.{digits}f})"


def _scale(metric: Metric) -> float:
    return 100.0 if metric.rate else 1.0


def _digits(metric: Metric) -> int:
    return 1 if metric.name == "travel_distance" else 2
