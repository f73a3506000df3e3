"""The tables of a comparison: what stands in which row and cell, however it is printed."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import isfinite

from lanewise.evaluation.aggregates import Estimate
from lanewise.evaluation.comparison import COMPARED, Comparison, Difference
from lanewise.evaluation.metrics import METRICS, Metric, Summary
from lanewise.evaluation.paired import RateDifference
from lanewise.evaluation.statistics import Interval
from lanewise.report.table import bounds, number, unit

SHOWN = tuple(metric for metric in METRICS if metric.name in COMPARED)
"""Columns, in the order of the tables."""

Lines = tuple[str, ...]
"""A cell: its value, then what belongs under it."""


@dataclass(frozen=True)
class Section:
    """A table with a row a run, an arm or a pair of arms, and a column a metric."""

    title: str
    """What its figures are."""
    heads: Sequence[Lines]
    """Of the columns: the metric, and the unit where the figures are in it."""
    rows: Sequence[tuple[str, Sequence[Lines]]]
    """Label and cells."""


def letter(index: int) -> str:
    """A run's short name: A to Z, then AA, AB and so on."""
    before, last = divmod(index, 26)
    return (letter(before - 1) if before else "") + chr(ord("A") + last)


def of(comparison: Comparison) -> list[Section]:
    """The tables: runs, differences to the first, and over seeds where an arm has several."""
    heads = [(metric.title, unit(metric)) for metric in SHOWN]
    runs = [(letter(i), _run(summary)) for i, summary in enumerate(comparison.summaries)]
    differences = [
        (letter(i), [_difference(metric, found[metric.name]) for metric in SHOWN])
        for i, found in enumerate(comparison.differences, 1)
    ]
    sections = [
        Section("Runs", heads, runs),
        Section("Minus A, start by start", heads, differences),
    ]
    if comparison.has_seeds:
        means = [
            (str(i), _means(arm.interquartile_mean)) for i, arm in enumerate(comparison.arms, 1)
        ]
        sections.append(Section("Interquartile mean over the seeds of an arm", heads, means))
    return sections + _improvements(comparison)


def _improvements(comparison: Comparison) -> list[Section]:
    """A table for each arm that others are held against."""
    ways = [
        (metric.title, "more" if COMPARED[metric.name].more_is_better else "fewer")
        for metric in SHOWN
    ]
    tables: dict[int, list[tuple[str, Sequence[Lines]]]] = {}
    for each in comparison.improvements:
        row = (str(each.arm + 1), _chances(each.probability))
        tables.setdefault(each.over, []).append(row)
    return [Section(f"P(better than arm {i + 1})", ways, rows) for i, rows in tables.items()]


def _run(summary: Summary) -> list[Lines]:
    return [
        (
            number(metric, summary.values[metric.name]),
            *_interval(metric, summary.intervals.get(metric.name)),
        )
        for metric in SHOWN
    ]


def _means(estimates: Mapping[str, Estimate]) -> list[Lines]:
    found = [(metric, estimates[metric.name]) for metric in SHOWN]
    return [
        (number(metric, each.value), *_interval(metric, each.interval)) for metric, each in found
    ]


def _interval(metric: Metric, interval: Interval | None) -> Lines:
    """The line below a value; none where the interval is unknown."""
    if interval is None or not isfinite(interval[0]):
        return ()
    return (bounds(metric, interval),)


def _difference(metric: Metric, found: Difference) -> Lines:
    value = number(metric, found.value, "+")
    if not isinstance(found, RateDifference):
        return (value, *_interval(metric, found.interval))
    p_value = f"p {found.p_value:.3f}" if found.p_value >= 0.001 else "p <0.001"
    return value, f"+{found.only_second} -{found.only_first}", p_value


def _chances(estimates: Mapping[str, Estimate]) -> list[Lines]:
    rows = []
    for metric in SHOWN:
        value, (low, high) = estimates[metric.name].value, estimates[metric.name].interval
        below = (f"({low:.2f}, {high:.2f})",) if isfinite(low) else ()
        rows.append((f"{value:.2f}", *below))
    return rows
