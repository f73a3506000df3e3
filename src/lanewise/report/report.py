"""A report folder: the tables, the figure and the clip, with all that is needed to repeat them."""

import json
import os
import platform
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from datetime import UTC, datetime
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

from lanewise.evaluation.episodes import Recording
from lanewise.evaluation.metrics import METRICS, Paired, Summary
from lanewise.report import table
from lanewise.report.escape import cell, code, finite
from lanewise.report.files import write_text

PACKAGES = ("lanewise", "jax", "jaxlib", "optax", "numpy", "gymnasium", "highway-env")


@dataclass(frozen=True)
class Report:
    """What a report tells."""

    title: str
    """Its first line."""
    command: str
    """The command that made it."""
    summaries: Sequence[Summary]
    """The columns of the test table."""
    settings: Mapping[str, Any] = field(default_factory=dict)
    """The settings worth showing, dotted name to value."""
    curves: Sequence[Mapping[str, Any]] = ()
    """Metrics rows of training, for the learning curves; none, no figure."""
    recording: Recording | None = None
    """An episode for the clip; none, no clip."""
    paired: Mapping[str, Paired] = field(default_factory=dict)
    """By controller: the same starts in both worlds."""
    notes: Sequence[str] = ()
    """Remarks, one paragraph each, such as where it fell short."""
    times: Mapping[str, float] = field(default_factory=dict)
    """How long each part took, s."""
    machine: Mapping[str, Any] = field(default_factory=dict)
    """More about the machine, such as its accelerator; added to what the system tells."""


def write_report(directory: Path | str, report: Report) -> Path:
    """Write `report.md`, `report.json`, `curves.png`, `curves.svg` and `clip.gif`.

    Returns:
        The path of `report.md`, written last: where it is, the rest is complete.

    Raises:
        LanewiseError: if a file cannot be written or a package for figures is missing.
    """
    directory = Path(directory)
    made = {
        "date": datetime.now(UTC).isoformat(timespec="seconds"),
        "command": report.command,
        "versions": versions(),
        "machine": {**machine(), **report.machine},
    }
    if report.curves:
        # Imported here, as tables alone do without the packages for figures.
        from lanewise.report.curves import write_curves

        write_curves(report.curves, directory / "curves.png")
        write_curves(report.curves, directory / "curves.svg")
    if report.recording is not None:
        from lanewise.report.clip import render

        render(report.recording, directory / "clip.gif")
    write_text(directory / "report.json", _json(report, made))
    write_text(directory / "report.md", _markdown(report, made))
    return directory / "report.md"


def versions() -> dict[str, str]:
    """Versions of Python and of the packages a result depends on, as far as installed."""
    found = {"python": platform.python_version()}
    for name in PACKAGES:
        try:
            found[name] = version(name)
        except PackageNotFoundError:
            continue
    return found


def machine() -> dict[str, Any]:
    """What the system tells about the machine; no name that would tell whose it is."""
    return {
        "system": platform.system(),
        "architecture": platform.machine(),
        "processor": _processor(),
        "cores": len(os.sched_getaffinity(0))
        if hasattr(os, "sched_getaffinity")
        else os.cpu_count(),
    }


def _processor() -> str:
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    except OSError:
        return platform.processor()
    names = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    return names[0] if names else platform.processor()


def _json(report: Report, made: Mapping[str, Any]) -> str:
    content = {
        "title": report.title,
        **made,
        "settings": dict(report.settings),
        "tests": table.to_json(report.summaries),
        "paired": {name: pair.to_json() for name, pair in report.paired.items()},
        "times": dict(report.times),
        "notes": list(report.notes),
    }
    return json.dumps(finite(content), indent=2, allow_nan=False, ensure_ascii=False) + "\n"


def _markdown(report: Report, made: Mapping[str, Any]) -> str:
    parts = [f"# {cell(report.title)}", f"{code(made['command'])}, {made['date']}"]
    parts += ["## Test episodes", table.markdown(report.summaries).rstrip(), _pairs(report.paired)]
    parts += [cell(note) for note in report.notes]
    if report.curves:
        parts += ["## Training", "![Success rate, reward and speed while training](curves.png)"]
    if report.recording is not None:
        name = cell(report.recording.controller)
        parts += ["## One test episode", f"![The road from above: {name}](clip.gif)"]
    parts += ["## What the figures mean", meanings()]
    parts += ["## How it was made", listing({**made["versions"], **made["machine"]})]
    if report.times:
        parts.append(listing({part: f"{took:.1f} s" for part, took in report.times.items()}))
    if report.settings:
        parts += ["## Settings", listing(report.settings)]
    return "\n\n".join(part for part in parts if part) + "\n"


def _pairs(paired: Mapping[str, Paired]) -> str:
    lines = []
    for name, pair in paired.items():
        line = f"- {cell(name)}, same starts in both worlds: {100 * pair.share:.2f} % of "
        line += f"{pair.episodes} outcomes identical"
        if pair.differing:
            line += "; different at start " + ", ".join(map(str, pair.differing))
        lines.append(line)
    return "\n".join(lines)


def meanings() -> str:
    """What every metric means, as a Markdown list."""
    return "\n".join(f"- **{cell(metric.title)}**: {cell(metric.meaning)}." for metric in METRICS)


def listing(values: Mapping[str, Any]) -> str:
    """Names and values as a Markdown table."""
    lines = ["| | |", "|---|---|"]
    return "\n".join(
        lines + [f"| {cell(name)} | {code(value)} |" for name, value in values.items()]
    )
