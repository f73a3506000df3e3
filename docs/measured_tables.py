"""Tables of benchmarks and campaigns from their stored files, for ``make_results.py``."""

import json
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import ages

from lanewise.bench.session import extras, number
from lanewise.bench.suite import Measurement
from lanewise.report import tables
from lanewise.runs import pretrained

sys.path.append(str(Path(__file__).resolve().parents[1] / "benchmarks"))
import ratios as compared

AGE = ages.mark("results/bench.json", "what it says of updates and trainings")


def ratios(bench: Any) -> str:
    """What the benchmark's figures say about one another, on all cores."""
    rows = [
        f"| {ratio.what} | {number(ratio.value)} {ratio.unit} | {ratio.how} |"
        for ratio in compared.of(_measured(bench), bench["machine"]["cores"])
        if "1 core," not in ratio.what or "decision of one world" in ratio.what
    ]
    return "\n".join(["| | | from |", "|---|---:|---|", *rows]) + "\n"


def speed(bench: Any, machine: str) -> str:
    """Every figure of the benchmark, by part and case."""
    versions = ", ".join(f"{name} {version}" for name, version in bench["versions"].items())
    lines = [
        f"`{bench['command']}`, {bench['date'][:10]}, on {machine}; each measurement",
        f"{bench['seconds']:g} s. {versions}.",
        "",
        AGE,
        "",
        "| part | case | who | figure | besides |",
        "|---|---|---|---:|---|",
    ]
    for figure in _measured(bench):
        value = f"{number(figure.value)} {figure.unit}"
        lines.append(
            f"| {figure.part} | {figure.case} | {figure.subject} | {value} | {extras(figure)} |"
        )
    return "\n".join(lines) + "\n"


def _measured(bench: Any) -> list[Measurement]:
    return [Measurement(**figure) for figure in bench["figures"]]


def driver(stored: Any) -> str:
    """Every row of `benchmarks/driver.py`: the shipped seed, in parentheses all seeds."""
    story = pretrained.PRETRAINED / "driver" / "provenance.json"
    shipped = json.loads(story.read_text())["seed"]
    runs = sorted(stored["runs"].values(), key=lambda run: run["training_seed"] != shipped)
    heads = [f"seed {shipped} ({len(runs)} seeds), %", "success, 25 s"]
    heads += [f"accidents, {second} s" for second in stored["horizons"]]
    rows = []
    for name in runs[0]["rows"]:
        tested = [run["rows"][name] for run in runs]
        successes = [100 * row["successes"][0] / row["episodes"] for row in tested]
        accidents = (
            [100 * sum(row["kinds"][horizon]) / row["episodes"] for row in tested]
            for horizon in range(len(stored["horizons"]))
        )
        rows.append([name, _spread(successes), *map(_spread, accidents)])
    means = (
        f"{name.replace('_', ' ')} {_spread([run['paper_means'][name] for run in runs])}"
        for name in runs[0]["paper_means"]
    )
    told = f"At the paper's test start in 25 s: {', '.join(means)}."
    return f"{tables.markdown(heads, rows)}\n\n{told}\n"


def _spread(values: Sequence[float]) -> str:
    """The first, and the lowest and highest of several."""
    every = f" ({min(values):.2f} to {max(values):.2f})" if len(values) > 1 else ""
    return f"{values[0]:.2f}{every}"


def campaigns(results: Path) -> str:
    """What each campaign found, in one line."""
    rows = ["| command | made with | what it found |", "|---|---|---|"]
    for name, say in SAYINGS.items():
        found = json.loads((results / f"{name}.json").read_text())
        made = f"commit {found['commit'][:7]}, " if found.get("commit") else ""
        rows.append(f"| `{found['command']}` | {made}{found['date'][:10]} | {say(found)} |")
    return "\n".join(rows)


def _resumes(found: Any) -> str:
    return (
        f"{found['trials']} trainings stopped {found['stops']} times: "
        f"{found['inside_an_episode']} inside episodes, {found['inside_a_goal']} inside goals, "
        f"{found['epsilon_is_falling']} while epsilon fell; "
        f"{len(found['differences'])} files differ"
    )


def _kills(found: Any) -> str:
    others = sum(found["moments"].values()) - found["kills"]
    return (
        f"{found['kills']} kills and {others} failed writes while saving: "
        f"{len(found['wrong'])} times something else than the old or the new checkpoint was left"
    )


def _soak(found: Any) -> str:
    first, *rest = (each["largest_memory_mib"] for each in found["rounds"])
    return (
        f"{len(found['rounds'])} reproductions in {found['minutes']} min, stopped "
        f"{sum(found['stops'].values())} times: {len(found['differences'])} files differ; memory "
        f"of a process at most {first:,} MiB in the first, which compiles, "
        f"{', '.join(map(str, rest))} MiB in the others"
    )


SAYINGS: dict[str, Callable[[Any], str]] = {
    "resumes": _resumes,
    "kills": _kills,
    "soak": _soak,
    "faults": lambda found: f"{found['caught']} of {found['faults']} deliberate faults caught",
}
"""By file in `results/trust`, what it says."""
