"""Fill the tables and ages of pages from the stored result files: ``python docs/make_results.py``.

A table stands between ``<!-- table: KIND WORDS -->`` and ``<!-- /table -->``. `TABLES` lists the
kinds; the words say which results, by their names in ``results``. What pages say around the tables
is written by hand. `ages` fills the marks that say how old a result is.
"""

import json
import re
from collections.abc import Callable, Sequence
from pathlib import Path
from statistics import mean
from typing import Any

import ages
import measured_tables

from lanewise import config
from lanewise.config.settings import Settings
from lanewise.evaluation.metrics import Summary
from lanewise.experiments import published
from lanewise.report import experiment_tables, seed_figure, tables
from lanewise.report.experiment_tables import ArmFigures
from lanewise.report.figure_style import save

ROOT = Path(__file__).resolve().parents[1]
RESULTS = ROOT / "results"
PAGES = ("README.md", "docs/*.md", "examples/README.md")
TABLE = re.compile(r"(<!-- table: ([^>\n]+) -->\n).*?(<!-- /table -->)", re.DOTALL)
WORLDS = ("lanewise", "highway-env")
HEADLINE = ("hierarchical", "h-dqn", "single-level", "search")
"""Arms of the README's table."""
LITERAL = "paper-literal"
"""The experiment `paper`, in parts."""
COLUMNS = (
    ("accumulated_reward", "reward", 1.0, 2, ""),
    ("average_speed", "speed", 1.0, 2, " m/s"),
    ("escape_rate", "success (paper)", 100.0, 2, " %"),
    ("success_rate", "success", 100.0, 2, " %"),
    ("travel_distance", "distance", 1.0, 1, " m"),
    ("accident_rate", "accidents", 100.0, 2, " %"),
)
"""Of the table of readings: metric, title, factor, decimal places, unit."""


def main() -> None:
    """Write every page, and draw what a report in parts cannot draw itself."""
    for path, text in pages().items():
        path.write_text(text)
    literal = seed_figure.draw(figures(_read(LITERAL)), WORLDS[0])
    save(literal, RESULTS / LITERAL / "seeds", (".png",))


def pages() -> dict[Path, str]:
    """What each page must hold; stored reports and maps get their age below the title."""
    found = {}
    for path in sorted(path for pattern in PAGES for path in ROOT.glob(pattern)):
        found[path] = TABLE.sub(_filled, path.read_text())
    for path in sorted(RESULTS.rglob("*.md")):
        if path.with_suffix(".json").exists():
            name = str(path.with_suffix(".json").relative_to(ROOT))
            found[path] = ages.below_title(path.read_text(), name)
    return {path: ages.filled(text) for path, text in found.items()}


def _filled(found: re.Match[str]) -> str:
    begin, words, end = found.groups()
    kind, *names = words.split()
    return f"{begin}\n{TABLES[kind](*names).rstrip()}\n\n{end}"


def _read(name: str) -> Any:
    """A stored file, or a folder of reports of one experiment's arms as one report."""
    if (RESULTS / name).is_file():
        return json.loads((RESULTS / name).read_text())
    parts = _each(name)
    return parts[0] | {"arms": [arm for part in parts for arm in part["arms"]]}


def _each(folder: str) -> list[Any]:
    """The files of a folder, by name."""
    return [json.loads(path.read_text()) for path in sorted((RESULTS / folder).glob("*.json"))]


def figures(report: Any, only: Sequence[str] = ()) -> list[ArmFigures]:
    """The arms of a stored report, as the tables want them."""
    found = []
    for arm in report["arms"]:
        if only and arm["name"] not in only:
            continue
        settings, seeds = config.replace(Settings(), arm["settings"]), arm["seeds"]
        stored = {
            world: [s["tests"][world] for s in seeds if world in s["tests"]] for world in WORLDS
        }
        found.append(
            ArmFigures(
                title=arm["title"],
                controller=arm["controller"],
                seeds=[seed["seed"] for seed in seeds],
                tests={world: list(map(Summary.from_json, each)) for world, each in stored.items()},
                training=[[seed["training"]] for seed in seeds],
                effort=[seed["effort"] for seed in seeds if seed["effort"]],
                unlike_paper=published.unlike_test(settings),
                unlike_papers_training=published.unlike_training(settings),
            )
        )
    return found


def over_seeds(report: str, reference: str) -> str:
    """Aggregates over seeds, beside one arm."""
    stored = _read(report)
    title = next(arm["title"] for arm in stored["arms"] if arm["name"] == reference)
    return experiment_tables.over_seeds(figures(stored), title)


def training(report: str) -> str:
    """The paper's training table with ours beside it."""
    stored = _read(report)
    return experiment_tables.training(figures(stored, list(stored["published"]["training"])))


def outside(report: str, folder: str) -> str:
    """Learners of other libraries in the test table, beside ours and chance."""
    arms, stored = figures(_read(report), ("hierarchical", "single-level")), _each(folder)
    arms += [
        _tested(f"{each['title']}, {each['steps']:,} {each['unit']}", each, "learnt")
        for each in stored
    ]
    for each in stored:
        kind = "goals" if each["unit"] == "goals" else "low-level actions"
        arms.append(_tested(f"random {kind}", each, "random"))
    lines = [experiment_tables.tests(arms, "lanewise")]
    for each in stored:
        minutes = mean(seed["seconds"] for seed in each["seeds"]) / 60
        lines.append(
            f"- {each['title']}: `{each['command']}` ({each['date'][:10]}, {_learnt_with(each)}; "
            f"{minutes:.1f} minutes a seed, tests included, on {_machine(each)}, which did other "
            "work too)"
        )
    return "\n".join(lines)


def examples(folder: str) -> str:
    """The examples as they come, one row each."""
    heads = ["file", "learns with", "budget", "reward", "random"]
    heads += ["success (paper), %", "success, %", "accidents, %"]
    rows = []
    for each in _each(folder):
        (seed,) = each["seeds"]
        learnt, random = (seed[who] for who in ("learnt", "random"))
        rates = [learnt.get(name) for name in ("escape_rate", "success_rate", "accident_rate")]
        rows.append(
            [
                f"`{each['example']}.py`",
                _learnt_with(each),
                f"{each['steps']:,} {each['unit']}",
                f"{learnt['accumulated_reward']:.2f}",
                f"{random['accumulated_reward']:.2f}",
                *(tables.UNKNOWN if rate is None else f"{100 * rate:.1f}" for rate in rates),
            ]
        )
    return tables.markdown(heads, rows, texts=2)


def readings(report: str) -> str:
    """The literal readings beside the default."""
    rows = []
    for arm in _read(report)["arms"]:
        tests = [seed["tests"]["lanewise"] for seed in arm["seeds"]]
        flags = (f"`--{name.replace('_', '-')} {value}`" for name, value in arm["changes"].items())
        seeds = ", ".join(f"{100 * test['success_rate']:.1f}" for test in tests)
        means = (
            f"{mean(test[name] for test in tests) * factor:.{places}f}{unit}"
            if all(name in test for test in tests)
            else tables.UNKNOWN
            for name, _, factor, places, unit in COLUMNS
        )
        rows.append([arm["title"], ", ".join(flags), seeds, *means])
    heads = ["reading", "settings", "success of each seed", *(title for _, title, *_ in COLUMNS)]
    return tables.markdown(heads, rows, texts=3)


def _tested(title: str, stored: Any, who: str) -> ArmFigures:
    """A row of the test table from a stored file of `examples/record.py`."""
    tests = [Summary.from_json(seed[who]) for seed in stored["seeds"]]
    return ArmFigures(
        title, "outside", [seed["seed"] for seed in stored["seeds"]], {"lanewise": tests}
    )


def _learnt_with(stored: Any) -> str:
    return ", ".join(f"{name} {stored['versions'][name]}" for name in stored["learner"])


def _machine(stored: Any) -> str:
    return f"{stored['machine']['cores']} cores of an {stored['machine']['processor']}"


TABLES: dict[str, Callable[..., str]] = {
    "headline": lambda report: experiment_tables.tests(
        figures(_read(report), HEADLINE), "lanewise"
    ),
    "tests": lambda report, world: experiment_tables.tests(figures(_read(report)), world),
    "effort": lambda report: experiment_tables.effort(figures(_read(report))),
    "over_seeds": over_seeds,
    "training": training,
    "outside": outside,
    "examples": examples,
    "readings": readings,
    "speed": lambda report: measured_tables.speed(_read(report), _machine(_read(report))),
    "ratios": lambda report: measured_tables.ratios(_read(report)),
    "driver": lambda stored: measured_tables.driver(_read(stored)),
    "campaigns": lambda folder: measured_tables.campaigns(RESULTS / folder),
}
"""By the kind that a mark names."""


if __name__ == "__main__":
    main()
