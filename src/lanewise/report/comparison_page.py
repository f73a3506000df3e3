"""A comparison of runs: for a terminal, as Markdown, as JSON and as comma-separated text."""

import csv
import io
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from math import isfinite, nan
from typing import Any

from lanewise.errors import one_line
from lanewise.evaluation.aggregates import Estimate
from lanewise.evaluation.comparison import COMPARED, FEWER_IS_BETTER, Comparison, Difference
from lanewise.evaluation.metrics import Metric
from lanewise.evaluation.statistics import RateDifference
from lanewise.fields.ranges import show
from lanewise.report import tables
from lanewise.report.evaluation_table import NOTE
from lanewise.report.markup import cell, code
from lanewise.report.provenance import commits, source, versions
from lanewise.report.tables import bounds, number, unit

COLUMNS = 3
"""Metrics in a table for a terminal; more would be wider than 80 columns."""
PAIRED_NOTE = (
    "Differences are over the same starts; for shares, +n -m counts the starts that",
    "only this run, and only A, had; p is McNemar's exact p-value, not corrected for",
    "many comparisons. They describe these controllers only: to compare ways of",
    "training, give several seeds of each.",
)
SEEDS_NOTE = (
    "Interquartile mean: a quarter of the seeds left out at either end, rounded down.",
    "P(better): a new seed of this arm beats one of the other; a tie counts one half.",
    "Their 95 % intervals are stratified bootstrap intervals over seeds. Equal seeds",
    "have no interval. They are too narrow for few seeds: for the interquartile",
    "mean 91 of 100 hold with 5 seeds, 76 with 3, 50 with 2; for P near 0 or 1 fewer.",
)
"""As measured in `tests/evaluation/test_aggregates.py`."""


@dataclass(frozen=True)
class ComparisonPage:
    """A comparison and how it was made."""

    comparison: Comparison
    settings: Mapping[str, tuple[Any, ...]]
    """Settings that are not the same in all runs, by dotted name: one value for each run."""
    seed: int
    """Of the starts."""
    scenario_of: str | None = None
    """The run whose scenario all drove in; None if each drove in its own, and all are the same."""
    command: str = ""


Section = tuple[str, Sequence[str], Sequence[Sequence[str]]]
"""A table's title, what stands below the metrics' titles, and rows: a label, then a cell for each
metric, with a value and in parentheses what belongs to it."""


def text(page: ComparisonPage) -> str:
    """The comparison for a terminal of 80 columns."""
    width = max(len(one_line(run.name)) for run in page.comparison.runs)
    runs = [
        f"{_letter(index):<2} {one_line(run.name):<{width}}  {run.controller}, seed {run.seed}"
        for index, run in enumerate(page.comparison.runs)
    ]
    parts = ["\n".join(one_line(line) for line in runs + _arms(page.comparison)), _test(page) + "."]
    for title, units, rows in _sections(page.comparison):
        blocks, below = [title], [[one.replace(" (", "\n(") for one in row] for row in rows]
        for first in range(0, len(COMPARED), COLUMNS):
            some = slice(first, first + COLUMNS)
            heads = [["", *(metric.title for metric in COMPARED[some])], ["", *units[some]]]
            blocks.append(tables.text(heads, [[label, *cells[some]] for label, *cells in below]))
        parts.append("\n".join(blocks))
    parts.append("\n".join(["Settings of the runs that differ", *map(one_line, _settings(page))]))
    return "\n\n".join([*parts, "\n".join(_notes(page.comparison))]) + "\n"


def markdown(page: ComparisonPage) -> str:
    """The comparison as a Markdown page."""
    runs = [
        f"- {_letter(index)}: {code(run.name)} ({cell(f'{run.controller}, seed {run.seed}')})"
        for index, run in enumerate(page.comparison.runs)
    ]
    arms = [f"- {cell(line)}" for line in _arms(page.comparison)]
    parts = ["# Comparison of runs", "\n".join(runs + arms), cell(_test(page)) + "."]
    for section, units, rows in _sections(page.comparison):
        titles = zip((metric.title for metric in COMPARED), units, strict=True)
        heads = ["", *(cell(", ".join(filter(None, head))) for head in titles)]
        shown = [list(map(cell, row)) for row in rows]
        parts += [f"## {cell(section)}", tables.markdown(heads, shown)]
    parts += [
        "## Settings of the runs that differ",
        "\n".join(f"- {cell(line)}" for line in _settings(page)),
    ]
    packages = (f"{name} {number}" for name, number in versions().items())
    made = cell(", ".join([*packages, commits([source()])]))
    date = datetime.now(UTC).isoformat(timespec="seconds")
    parts += ["\n".join(map(cell, _notes(page.comparison)))]
    return "\n\n".join([*parts, f"{code(page.command)}, {date}; {made}"]) + "\n"


def to_json(page: ComparisonPage) -> dict[str, Any]:
    """One object; runs and arms are named by their place in the lists, counted from 0."""
    comparison = page.comparison
    return {
        "world": comparison.summaries[0].world,
        "episodes": comparison.summaries[0].episodes,
        "seed": page.seed,
        "scenario_of": page.scenario_of,
        "runs": [
            {"run": run.name, "seed": run.seed, **summary.to_json()}
            for run, summary in zip(comparison.runs, comparison.summaries, strict=True)
        ],
        "settings": dict(page.settings),
        "differences": [
            {"run": number, "to": 0, **_plain(found)}
            for number, found in enumerate(comparison.differences, 1)
        ],
        "arms": [
            vars(arm) | {"interquartile_mean": _plain(arm.interquartile_mean)}
            for arm in comparison.arms
        ],
        "improvements": [
            vars(each) | {"probability": _plain(each.probability)}
            for each in comparison.improvements
        ],
    }


def to_csv(page: ComparisonPage) -> str:
    """One row for each run and metric, numbers in full; an unknown value is empty."""
    arms = {run: number for number, arm in enumerate(page.comparison.arms) for run in arm.runs}
    out = io.StringIO()
    writer = csv.writer(out, lineterminator="\n")
    writer.writerow(["run", "controller", "seed", "arm", "metric", "value", "low", "high"])
    runs = zip(page.comparison.runs, page.comparison.summaries, strict=True)
    for index, (run, summary) in enumerate(runs):
        for name, value in summary.values.items():
            figures = (value, *summary.intervals.get(name, (nan, nan)))
            shown = [repr(figure) if isfinite(figure) else "" for figure in figures]
            writer.writerow([run.name, run.controller, run.seed, arms[index], name, *shown])
    return out.getvalue()


def _letter(index: int) -> str:
    """A run's short name: A to Z, then AA, AB and so on."""
    before, last = divmod(index, 26)
    return (_letter(before - 1) if before else "") + chr(ord("A") + last)


def _sections(comparison: Comparison) -> list[Section]:
    """The tables: runs, differences to the first, and over seeds where an arm has several."""
    units = [unit(metric) for metric in COMPARED]
    runs = [
        [_letter(i), *(tables.with_interval(m, each) for m in COMPARED)]
        for i, each in enumerate(comparison.summaries)
    ]
    differences = [
        [_letter(i), *(_difference(metric, found[metric.name]) for metric in COMPARED)]
        for i, found in enumerate(comparison.differences, 1)
    ]
    found: list[Section] = [
        ("Runs", units, runs),
        ("Minus A, start by start", units, differences),
    ]
    if not comparison.has_seeds:
        return found
    means = [
        [str(i), *(tables.estimated(m, arm.interquartile_mean[m.name]) for m in COMPARED)]
        for i, arm in enumerate(comparison.arms, 1)
    ]
    found.append(("Interquartile mean over the seeds of an arm", units, means))
    ways = ["fewer" if metric.name in FEWER_IS_BETTER else "more" for metric in COMPARED]
    for over in range(len(comparison.arms) - 1):
        chances = [
            [str(each.arm + 1), *(tables.chance(each.probability[m.name]) for m in COMPARED)]
            for each in comparison.improvements
            if each.over == over
        ]
        found.append((f"P(better than arm {over + 1})", ways, chances))
    return found


def _difference(metric: Metric, found: Difference) -> str:
    value = number(metric, found.value, "+")
    if not isinstance(found, RateDifference):
        return f"{value} {bounds(metric, found.interval)}".rstrip()
    p_value = f"p {found.p_value:.3f}" if found.p_value >= 0.001 else "p <0.001"
    return f"{value} (+{found.only_second} -{found.only_first}, {p_value})"


def _plain(figures: Mapping[str, Estimate | Difference]) -> dict[str, Any]:
    return {name: figure.to_json() for name, figure in figures.items()}


def _arms(comparison: Comparison) -> list[str]:
    arms = enumerate(comparison.arms if comparison.has_seeds else (), 1)
    return [f"arm {number}: {' '.join(map(_letter, arm.runs))}" for number, arm in arms]


def _test(page: ComparisonPage) -> str:
    first = page.comparison.summaries[0]
    said = f"{first.episodes} test episodes each in {first.world}, starts of seed {page.seed}"
    return f"{said}, scenario of {page.scenario_of}" if page.scenario_of else said


def _settings(page: ComparisonPage) -> list[str]:
    """A line for each setting: each value with the runs that have it."""
    lines = []
    for name, values in page.settings.items():
        runs: dict[str, list[str]] = {}
        for index, value in enumerate(values):
            runs.setdefault(show(value), []).append(_letter(index))
        held = ", ".join(f"{value} ({' '.join(letters)})" for value, letters in runs.items())
        lines.append(f"{name}: {held}")
    return lines or ["none"]


def _notes(comparison: Comparison) -> tuple[str, ...]:
    return NOTE + PAIRED_NOTE + (SEEDS_NOTE if comparison.has_seeds else ())
