"""The paper's test table with ours beside it: a column for each controller and world."""

from collections.abc import Sequence
from math import isfinite, nan

from lanewise.evaluation.episodes import ACCIDENT_KINDS
from lanewise.evaluation.metrics import (
    METRICS,
    PUBLISHED,
    PUBLISHED_EPISODES,
    Summary,
    published_intervals,
)
from lanewise.report import tables
from lanewise.report.markup import cell, line

NOTE = (
    "In parentheses 95 % intervals: exact (Clopper-Pearson) for shares of episodes,",
    "Student's for means over episodes, the delta method's for ratios of sums.",
    "Success: past the trap without an accident, not even later; the paper's success",
    "forgives a later accident.",
)
"""Lines, each short enough for a terminal."""


def columns(summaries: Sequence[Summary]) -> list[Summary]:
    """Columns of the table: controllers in the paper's order, then others as given.

    A published column (its world is ``published``) stands only before a controller whose tests are
    all the paper's.
    """
    ours = dict.fromkeys(s.controller for s in summaries)
    result = []
    for controller in dict.fromkeys([*(c for c in PUBLISHED if c in ours), *ours]):
        own = [s for s in summaries if s.controller == controller]
        if controller in PUBLISHED and all(s.unlike_paper == "" for s in own):
            known, intervals = PUBLISHED[controller], published_intervals(controller)
            count = PUBLISHED_EPISODES
            result.append(Summary(controller, "published", count, known, {}, {}, intervals))
        result += own
    return result


def markdown(summaries: Sequence[Summary]) -> str:
    """The table as Markdown, with notes below it."""
    every = columns(summaries)
    heads = ["", *(cell(f"{each.controller}, {each.world}") for each in every)]
    rows = [(cell(title), *cells) for title, *cells in _rows(every)]
    notes = ["\n".join(part) for part in (map(cell, _left_out(summaries)), NOTE)]
    return "\n\n".join([tables.markdown(heads, rows), *filter(None, notes)]) + "\n"


def text(summaries: Sequence[Summary]) -> str:
    """The table for a terminal: one block for each controller, 80 columns wide for two worlds."""
    blocks = []
    every = columns(summaries)
    for controller in dict.fromkeys(each.controller for each in every):
        block = [each for each in every if each.controller == controller]
        heads = [line(controller), *(each.world for each in block)]
        blocks.append(tables.text([heads], _rows(block)))
    notes = ["\n".join(part) for part in (_left_out(summaries), NOTE)]
    return "\n\n".join([*blocks, *filter(None, notes)]) + "\n"


def _left_out(summaries: Sequence[Summary]) -> list[str]:
    unlike = [each for each in summaries if each.controller in PUBLISHED and each.unlike_paper]
    return tables.left_out({each.controller: each.unlike_paper for each in unlike})


def _rows(every: Sequence[Summary]) -> list[list[str]]:
    rows = [["episodes", *(str(each.episodes) for each in every)]]
    for metric in METRICS:
        if any(isfinite(each.values.get(metric.name, nan)) for each in every):
            cells = (tables.with_interval(metric, each) for each in every)
            rows.append([tables.head(metric), *cells])
        if metric.name == "accident_rate":
            for kind in ACCIDENT_KINDS:
                if any(each.accident_kinds.get(kind) for each in every):
                    counts = (each.accident_kinds.get(kind, tables.UNKNOWN) for each in every)
                    rows.append([f"  {kind.replace('_', ' ')}", *map(str, counts)])
    return rows
