"""Tables as Markdown and for terminals, and how a metric's figures are written in them."""

from collections.abc import Mapping, Sequence
from itertools import zip_longest
from math import isfinite, nan
from typing import Any

from lanewise.evaluation.aggregates import Estimate
from lanewise.evaluation.metrics import METRICS, Metric, Summary
from lanewise.evaluation.statistics import Interval
from lanewise.report.markup import cell, code, line

Row = Sequence[str]

UNKNOWN = "-"
"""A cell without a figure."""
TERMINAL = 80
"""Columns of the narrowest terminal worth fitting."""
LEFT_OUT = "Published figures are left out where the paper did something else:"


def markdown(heads: Row, rows: Sequence[Row], *, texts: int = 1) -> str:
    """A Markdown table of cells that are Markdown already; the first `texts` columns align left."""
    rule = "|---" * texts + "|---:" * (len(heads) - texts) + "|"
    shown = ["| " + " | ".join(row) + " |" for row in (heads, *rows)]
    return "\n".join([shown[0], rule, *shown[1:]])


def text(heads: Sequence[Row], rows: Sequence[Row]) -> str:
    """A table for a terminal: the first column aligns left, a rule stands below the heads.

    A line break in a cell puts what follows below it. Columns move closer to fit into 80.
    """
    split = [zip_longest(*(cell.split("\n") for cell in row), fillvalue="") for row in rows]
    lines = [*heads, *(below for row in split for below in row)]
    widths = [max(map(len, column)) for column in zip(*lines, strict=True)]
    gap = "  " if sum(widths) + 2 * (len(widths) - 1) <= TERMINAL else " "
    shown = [
        gap.join([row[0].ljust(widths[0]), *map(str.rjust, row[1:], widths[1:])]).rstrip()
        for row in lines
    ]
    rule = "-" * (sum(widths) + len(gap) * (len(widths) - 1))
    return "\n".join([*shown[: len(heads)], rule, *shown[len(heads) :]])


def listing(values: Mapping[str, Any]) -> str:
    """Names and values as a Markdown table."""
    rows = [(cell(name), code(value)) for name, value in values.items()]
    return markdown(("", ""), rows, texts=2)


def meanings() -> str:
    """What every metric means, as a Markdown list."""
    return "\n".join(f"- **{cell(metric.title)}**: {cell(metric.meaning)}." for metric in METRICS)


def left_out(why: Mapping[str, str | None]) -> list[str]:
    """Lines that say why no published figures stand beside some tests, by their titles."""
    names: dict[str, list[str]] = {}
    for name, reason in why.items():
        if reason:
            names.setdefault(line(reason), []).append(line(name))
    found = [f"- {', '.join(of)}: {reason}" for reason, of in names.items()]
    return [LEFT_OUT, *found] if found else []


def unit(metric: Metric) -> str:
    """The unit a metric is shown in, or how it is counted; empty for plain numbers."""
    return "%" if metric.rate else metric.unit or metric.counted


def head(metric: Metric) -> str:
    """A metric's title with its unit."""
    # No square brackets: some terminals' markup would swallow them.
    return f"{metric.title}, {unit(metric)}" if unit(metric) else metric.title


def scale(metric: Metric) -> float:
    """From a metric's stored value to the one shown."""
    return 100.0 if metric.rate else 1.0


def digits(metric: Metric) -> int:
    """Decimal places of a metric."""
    return 1 if metric.name == "travel_distance" else 2


def number(metric: Metric, value: float, sign: str = "") -> str:
    """A metric's value as shown, a dash if unknown; the sign ``+`` shows also positive signs."""
    return f"{scale(metric) * value:{sign}.{digits(metric)}f}" if isfinite(value) else UNKNOWN


def bounds(metric: Metric, interval: Interval | None) -> str:
    """A metric's interval as shown; empty if unknown."""
    if interval is None or not isfinite(interval[0]):
        return ""
    # One digit fewer for rates: their intervals are wide, and the columns narrow.
    places = 1 if metric.rate else digits(metric)
    low, high = (f"{scale(metric) * end:.{places}f}" for end in interval)
    return f"({low}, {high})"


def with_interval(metric: Metric, summary: Summary) -> str:
    """A metric of a test with its interval."""
    shown = number(metric, summary.values.get(metric.name, nan))
    return f"{shown} {bounds(metric, summary.intervals.get(metric.name))}".rstrip()


def estimated(metric: Metric, found: Estimate) -> str:
    """A metric over seeds with its interval."""
    return f"{number(metric, found.value)} {bounds(metric, found.interval)}".rstrip()


def chance(found: Estimate) -> str:
    """A probability with its interval."""
    low, high = found.interval
    return f"{found.value:.2f}" + (f" ({low:.2f}, {high:.2f})" if isfinite(low) else "")


def spread(values: Sequence[float], places: int) -> str:
    """Mean over seeds, the extremes in parentheses; a dash for no seed or an unknown value."""
    if not len(values) or not all(map(isfinite, values)):
        return UNKNOWN
    mean = f"{sum(values) / len(values):.{places}f}"
    if len(values) == 1:
        return mean
    return f"{mean} ({min(values):.{places}f} to {max(values):.{places}f})"
