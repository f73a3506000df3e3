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
from lanewise.evaluation.comparison import Comparison
from lanewise.fields.ranges import show
from lanewise.report import sections
from lanewise.report.escape import cell, code
from lanewise.report.provenance import commits, source, versions
from lanewise.report.sections import Lines, Section, letter
from lanewise.report.table import NOTE, TERMINAL

PAIRED_NOTE = (
    "Differences are over the same starts; for shares, +n -m counts the starts that",
    "only this run, and only A, had; p is McNemar's exact one, of one comparison.",
    "They speak of these controllers; only several seeds speak of how they were made.",
)
SEEDS_NOTE = (
    "Interquartile mean: a quarter of the seeds left out at either end, rounded down.",
    "P(better): a new seed of this arm beats one of the other; a tie counts one half.",
    "Their 95 % intervals are stratified bootstrap ones over seeds, none where there",
    "is no spread. They are too narrow for few seeds: for the interquartile mean",
    "91 of 100 hold with 5 seeds, 76 with 3, 50 with 2, and fewer for P near 0 or 1.",
)
"""As measured in `tests/evaluation/test_aggregates.py`."""


@dataclass(frozen=True)
class Page:
    """A comparison and how it was made."""

    comparison: Comparison
    """The figures."""
    settings: Mapping[str, tuple[Any, ...]]
    """Settings that are not the same in all runs, by dotted name: one value a run."""
    seed: int
    """Of the starts."""
    scenario_of: str | None = None
    """The run whose scenario all drove in; none, their own, which is the same."""
    command: str = ""
    """The command that made it."""

    @property
    def world(self) -> str:
        """Where they drove."""
        return self.comparison.summaries[0].world

    @property
    def episodes(self) -> int:
        """How many each drove."""
        return self.comparison.summaries[0].episodes


def text(page: Page) -> str:
    """The comparison for a terminal of 80 columns."""
    parts = ["\n".join(one_line(line) for line in _legend(page)), _test(page) + "."]
    parts += _text_sections(sections.of(page.comparison))
    parts += ["\n".join(["Settings that differ", *map(one_line, _settings(page))])]
    return "\n\n".join([*parts, "\n".join(_notes(page.comparison))]) + "\n"


def markdown(page: Page) -> str:
    """The comparison as a Markdown page."""
    runs = [f"- {name}: {code(run)} ({cell(about)})" for name, run, about in _runs(page)]
    arms = [f"- {cell(line)}" for line in _arms(page.comparison)]
    parts = ["# Comparison of runs", "\n".join(runs + arms), cell(_test(page)) + "."]
    for section in sections.of(page.comparison):
        parts += [f"## {cell(section.title)}", _markdown_section(section)]
    parts += ["## Settings that differ", "\n".join(f"- {cell(line)}" for line in _settings(page))]
    parts += ["\n".join(map(cell, _notes(page.comparison))), _origin(page)]
    return "\n\n".join(parts) + "\n"


def to_json(page: Page) -> dict[str, Any]:
    """One object; runs and arms are named by their place in the lists, counted from 0."""
    comparison = page.comparison
    return {
        "world": page.world,
        "episodes": page.episodes,
        "seed": page.seed,
        "scenario_of": page.scenario_of,
        "runs": [
            {"run": run.name, "seed": run.seed, **summary.to_json()}
            for run, summary in zip(comparison.runs, comparison.summaries, strict=True)
        ],
        "settings": {name: list(values) for name, values in page.settings.items()},
        "differences": [
            {"run": number, "to": 0, **{name: d.to_json() for name, d in found.items()}}
            for number, found in enumerate(comparison.differences, 1)
        ],
        "arms": [
            {
                "controller": arm.controller,
                "runs": list(arm.runs),
                "seeds": list(arm.seeds),
                "values": {name: list(values) for name, values in arm.values.items()},
                "interquartile_mean": _estimates(arm.interquartile_mean),
            }
            for arm in comparison.arms
        ],
        "improvements": [
            {"arm": each.arm, "over": each.over, "probability": _estimates(each.probability)}
            for each in comparison.improvements
        ],
    }


def to_csv(page: Page) -> str:
    """One row a run and metric, numbers in full; an unknown value is empty."""
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


def _estimates(estimates: Mapping[str, Estimate]) -> dict[str, Any]:
    return {name: estimate.to_json() for name, estimate in estimates.items()}


def _runs(page: Page) -> list[tuple[str, str, str]]:
    """Letter, name, and what it is, of each run."""
    runs = enumerate(page.comparison.runs)
    return [(letter(i), run.name, f"{run.controller}, seed {run.seed}") for i, run in runs]


def _arms(comparison: Comparison) -> list[str]:
    if not comparison.has_seeds:
        return []
    return [
        f"arm {number}: {' '.join(map(letter, arm.runs))}"
        for number, arm in enumerate(comparison.arms, 1)
    ]


def _legend(page: Page) -> list[str]:
    runs = [(name, one_line(run), about) for name, run, about in _runs(page)]
    width = max(len(run) for _, run, _ in runs)
    lines = [f"{name:<2} {run:<{width}}  {about}" for name, run, about in runs]
    return lines + _arms(page.comparison)


def _test(page: Page) -> str:
    line = f"{page.episodes} test episodes each in {page.world}, starts of seed {page.seed}"
    return f"{line}, scenario of {page.scenario_of}" if page.scenario_of else line


def _origin(page: Page) -> str:
    packages = (f"{name} {number}" for name, number in versions().items())
    made = ", ".join([*packages, commits([source()])])
    return f"{code(page.command)}, {datetime.now(UTC).isoformat(timespec='seconds')}; {cell(made)}"


def _settings(page: Page) -> list[str]:
    """A line a setting: each value with the runs that have it."""
    lines = []
    for name, values in page.settings.items():
        runs: dict[str, list[str]] = {}
        for index, value in enumerate(values):
            runs.setdefault(show(value), []).append(letter(index))
        held = ", ".join(f"{value} ({' '.join(letters)})" for value, letters in runs.items())
        lines.append(f"{name}: {held}")
    return lines or ["none"]


def _notes(comparison: Comparison) -> tuple[str, ...]:
    return NOTE + PAIRED_NOTE + (SEEDS_NOTE if comparison.has_seeds else ())


@dataclass(frozen=True)
class _Widths:
    """How the tables of a page are laid out, so that their columns are aligned."""

    label: int
    cells: tuple[int, ...]
    first: int = 0
    """Which column of the tables the first of these is."""

    @property
    def columns(self) -> slice:
        """Of the tables."""
        return slice(self.first, self.first + len(self.cells))

    def blocks(self, count: int) -> list["_Widths"]:
        """So many, below one another, of equally many columns but for the last."""
        each = -(-len(self.cells) // count)
        starts = range(0, len(self.cells), each)
        return [_Widths(self.label, self.cells[at : at + each], at) for at in starts]

    def fitting(self) -> list["_Widths"]:
        """As few blocks as fit a terminal."""
        tried = (self.blocks(count) for count in range(1, len(self.cells)))
        fits = (blocks for blocks in tried if all(each.total <= TERMINAL for each in blocks))
        return next(fits, self.blocks(len(self.cells)))

    @property
    def gap(self) -> str:
        """Between columns: narrow where wide figures would leave the terminal."""
        wide = self.label + sum(self.cells) + 2 * len(self.cells)
        return "  " if wide <= TERMINAL else " "

    @property
    def total(self) -> int:
        return self.label + sum(self.cells) + len(self.gap) * len(self.cells)


def _text_sections(tables: Sequence[Section]) -> list[str]:
    """Each as text, every cell's lines under one another."""
    rows = [row for table in tables for row in (("", table.heads), *table.rows)]
    columns = zip(*(cells for _, cells in rows), strict=True)
    widths = _Widths(
        max(len(name) for name, _ in rows),
        tuple(max(len(line) for lines in column for line in lines) for column in columns),
    )
    blocks = widths.fitting()
    return [
        "\n".join([table.title, *(line for block in blocks for line in _text_block(table, block))])
        for table in tables
    ]


def _text_block(table: Section, widths: _Widths) -> list[str]:
    """Some columns of a table."""
    lines = [*_text_row("", table.heads[widths.columns], widths), "-" * widths.total]
    for name, cells in table.rows:
        lines += _text_row(name, cells[widths.columns], widths)
    return lines


def _text_row(name: str, cells: Sequence[Lines], widths: _Widths) -> list[str]:
    rows = []
    for number in range(max(map(len, cells))):
        words = [lines[number] if number < len(lines) else "" for lines in cells]
        shown = [word.rjust(width) for word, width in zip(words, widths.cells, strict=True)]
        label = ("" if number else name).ljust(widths.label)
        rows.append(widths.gap.join([label, *shown]).rstrip())
    return rows


def _markdown_section(table: Section) -> str:
    heads = " | ".join(cell(", ".join(filter(None, head))) for head in table.heads)
    lines = [f"| | {heads} |", "|---|" + "---:|" * len(table.heads)]
    lines += [
        f"| {name} | " + " | ".join(map(_one_line, cells)) + " |" for name, cells in table.rows
    ]
    return "\n".join(lines)


def _one_line(lines: Lines) -> str:
    """A value with what belongs under it in parentheses, where an interval stands already."""
    value, below = lines[0], ", ".join(lines[1:])
    if below and not below.startswith("("):
        below = f"({below})"
    return cell(f"{value} {below}")
