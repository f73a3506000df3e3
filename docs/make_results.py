"""Fill the tables and ages of pages and write ``docs/results.md`` from the stored result files.

python docs/make_results.py
"""

import json
from pathlib import Path
from statistics import mean
from typing import Any

import ages
import speed_tables

from lanewise import config
from lanewise.config.settings import Settings
from lanewise.evaluation.metrics import Summary
from lanewise.experiments import published
from lanewise.report import arms as tables
from lanewise.report.arms import UNKNOWN, ArmFigures

ROOT = Path(__file__).resolve().parents[1]
RESULTS = ROOT / "results"
BEGIN, END = "<!-- results -->", "<!-- /results -->"
EXAMPLES = ("<!-- examples -->", "<!-- /examples -->")
MEASURED = "<!-- measured -->"
STANDARD, PAPER = "standard/report.json", "paper/report.json"
READINGS, BENCH = "readings/report.json", "bench.json"
MAP = "ranges/wide/map.json"
OUTSIDE, BRIEFLY = "outside", "outside/brief"
"""Folders of other learners' tests: trained for long, and as the examples come."""
WORLDS = {"lanewise": "here", "highway-env": "in the real highway-env"}
HEADLINE = (
    *("planned", "hierarchical", "h-dqn"),
    *("single-level", "single-level-held", "rule-based", "search"),
)
"""Arms of the README's table; the others are in `docs/results.md`."""
ARMS = (
    "The flat arms are named by their exploration, ε from 0.5 to 0.02 over 1000 steps in each of "
    "32 worlds (row 15 of [the readings](docs/paper.md)); h-DQN trains both levels at once, the "
    "hierarchical arm one after the other; h-DQN's low level has a discount of 0.95, [found by a "
    "search](docs/quick-preset.md#h-dqn) that the flat arm did not get, where all else here has "
    "0.8; the search plans with the world itself, and so knows "
    "how everybody will drive, which no controller may."
)
SUCCESSES = (
    "*Success (paper)* is the paper's: the ego's rear bumper passes the front of every trap car "
    "before the episode ends. *Success* is stricter: and no accident happens, not even later. The "
    "paper published the first alone; results stored before both were counted have the second "
    f"alone ({UNKNOWN})."
)
ESCAPES = 0.9
"""A seed escapes if more than this share of its test episodes do."""
PICTURES = {
    "training": "Training, exploration included: success, reward and speed over episodes, mean and "
    "spread of five seeds. Step 2's episodes last 60 decisions, the others' 250, so rewards an "
    "episode are not to be compared between them; the tests above are",
    "film-strip": "Both controllers on the same start, second by second",
}
COLUMNS = (
    ("accumulated_reward", "reward", 1.0, 2, ""),
    ("average_speed", "speed", 1.0, 2, " m/s"),
    ("escape_rate", "success (paper)", 100.0, 2, " %"),
    ("success_rate", "success", 100.0, 2, " %"),
    ("travel_distance", "distance", 1.0, 1, " m"),
    ("accident_rate", "accidents", 100.0, 2, " %"),
)
Rows = list[dict[str, Any]]


def main() -> None:
    """Write every file."""
    for path, text in pages().items():
        path.write_text(text)


def pages() -> dict[Path, str]:
    """What each file must hold."""
    standard, bench = _read(STANDARD), _read(BENCH)
    readme = ROOT / "README.md"
    parts = (
        *(_summary(standard, _read(PAPER)), _outside(standard, _each(OUTSIDE))),
        *(_beyond(_read(MAP)), speed_tables.brief(bench, _machine(bench))),
    )
    examples = ROOT / "examples" / "README.md"
    speed = ROOT / "docs" / "speed.md"
    every_speed = speed_tables.whole(bench, _machine(bench))
    before, after = (part for part in speed.read_text().split(MEASURED)[::2])
    texts = _marked() | {
        readme: _between(readme.read_text(), BEGIN, END, "\n".join(parts)),
        speed: before + MEASURED + "\n\n" + every_speed + "\n" + MEASURED + after,
        examples: _between(examples.read_text(), *EXAMPLES, _briefly(_each(BRIEFLY))),
        ROOT / "docs" / "results.md": _details(standard)
        + _paper(_read(PAPER))
        + _readings(_read(READINGS)),
    }
    return {path: ages.filled(text) for path, text in texts.items()}


def _marked() -> dict[Path, str]:
    """The pages written by hand that name the age of a result, and the stored reports and maps."""
    by_hand = {path: path.read_text() for path in (ROOT / "docs").glob("*.md")}
    found = {path: text for path, text in by_hand.items() if ages.MARKED.search(text)}
    for path in sorted(RESULTS.rglob("*.md")):
        result = path.with_suffix(".json")
        if result.exists():
            name = str(result.relative_to(ROOT))
            found[path] = ages.below_title(path.read_text(), name)
    return found


def _read(name: str) -> Any:
    return json.loads((RESULTS / name).read_text())


def _age(name: str) -> str:
    """Where a page says how old a result is, by its name in ``results``."""
    return ages.mark(f"results/{name}")


def _each(folder: str) -> list[Any]:
    """The files of a folder, by name."""
    return [json.loads(path.read_text()) for path in sorted((RESULTS / folder).glob("*.json"))]


def _between(page: str, begin: str, end: str, text: str) -> str:
    """A page with the text between its marks replaced."""
    head, rest = page.split(begin)
    return head + begin + "\n\n" + text + "\n" + end + rest.split(end)[1]


def _figures(report: Any) -> list[ArmFigures]:
    """The arms of a stored report, as the tables want them."""
    found = []
    for arm in report["arms"]:
        tests = {
            world: [
                Summary.from_json(seed["tests"][world])
                for seed in arm["seeds"]
                if world in seed["tests"]
            ]
            for world in WORLDS
        }
        seeds = [seed["seed"] for seed in arm["seeds"]]
        effort = [seed["effort"] for seed in arm["seeds"] if seed["effort"]]
        unlike = published.unlike_test(config.replace(Settings(), arm["settings"]))
        found.append(
            ArmFigures(
                *(arm["title"], arm["controller"], seeds, tests),
                effort=effort,
                unlike_paper=unlike,
            )
        )
    return found


def _summary(report: Any, paper: Any) -> str:
    """The paper's test table with ours beside it, in both worlds, and two pictures."""
    names = [arm["name"] for arm in report["arms"]]
    chosen = zip(names, _figures(report), strict=True)
    arms = [figures for name, figures in chosen if name in HEADLINE]
    lines = [_age(STANDARD), ""]
    for world, title in WORLDS.items():
        lines += [
            f"Test episodes of 25 s {title}; means over seeds, in parentheses the lowest and the "
            "highest seed:",
            "",
            tables.tests(arms, world),
        ]
    lines += [
        SUCCESSES,
        "",
        f"All seeds, none left out; made by `{report['command']}` ({report['date'][:10]}) on "
        f"{_machine(report)}. All {len(names)} arms and how much was run are in "
        "[docs/results.md](docs/results.md), the whole report with its figures, every seed and the "
        "ledger of the paper's claims in [results/standard](results/standard/report.md).",
        "",
        ARMS,
        "",
    ]
    lines += [_at_the_papers_size(paper), "", _age(PAPER), "", _is_it_the_hierarchy(report), ""]
    for name, title in PICTURES.items():
        lines += [f"![{title}](results/standard/figures/{name}.png)", ""]
    return "\n".join(lines)


def _at_the_papers_size(report: Any) -> str:
    """The paper's training table with ours beside it, and the hierarchical controller's tests."""
    compared = [arm for arm in report["arms"] if arm["name"] in report["published"]["training"]]
    rows = [
        ArmFigures(
            *(arm["title"], arm["controller"], [seed["seed"] for seed in arm["seeds"]], {}),
            training=[[seed["training"]] for seed in arm["seeds"]],
            unlike_papers_training=published.unlike_training(
                config.replace(Settings(), arm["settings"])
            ),
        )
        for arm in compared
    ]
    tests = next(arm for arm in compared if arm["name"] == "hierarchical")["seeds"]
    here, there = (mean(seed["tests"][world]["success_rate"] for seed in tests) for world in WORLDS)
    tested = report["published"]["test"]["hierarchical"]
    rate = tested.get("escape_rate", tested.get("success_rate"))  # Older reports call it success.
    return (
        f"**At the paper's own size** (1000 and 2000 episodes, {len(tests)} seeds; "
        "[results/paper](results/paper/report.md)), means of the last 50 training episodes, which "
        "still explore:\n\n"
        f"{tables.training(rows)}\n"
        "The paper does not say whether its reward is one a decision or one a second. Its success "
        "counts an escape whether or not an accident follows; ours leaves out every episode with "
        "an accident, so the two do not count the same. In tests the hierarchical controller has "
        f"{100 * here:.2f} % success here and {100 * there:.2f} % in highway-env, by ours. The "
        f"published {100 * rate:.2f} % is by the paper's. Some settings that the paper leaves open "
        "were [fitted to its figures](docs/paper.md#what-was-fitted), so agreement with them is no "
        "independent confirmation."
    )


def _is_it_the_hierarchy(report: Any) -> str:
    """The sceptic's question, answered by flat controllers with one thing changed each."""
    success = {arm["name"]: _rates(arm, "success_rate") for arm in report["arms"]}
    reward = {arm["name"]: _rates(arm, "accumulated_reward") for arm in report["arms"]}
    escaping = {
        name: [number for number, rate in enumerate(rates) if rate > ESCAPES]
        for name, rates in success.items()
    }
    longer = ", ".join(
        f"{len(escaping[f'single-level-discount-{digits}'])} with 0.{digits}"
        for digits in ("90", "97", "99")
    )
    held = "single-level-held"
    return (
        "**Is it the hierarchy, or only a longer view?** Mostly that a choice is kept. A flat "
        "controller that holds each of its choices for five decisions escapes with "
        f"{len(escaping[held])} of {len(success[held])} seeds, the hierarchical one with "
        f"{len(escaping['hierarchical'])} of {len(success['hierarchical'])}; where it does, it "
        f"earns {mean(reward[held][number] for number in escaping[held]):.2f}, the hierarchical "
        f"one {mean(reward['hierarchical']):.2f}. A longer discount alone helps rarely: of "
        f"{len(success['single-level-discount-97'])} seeds each {longer} escape, and "
        f"{len(escaping['single-level-5-step'])} with 5-step returns. The search shows what "
        f"there is to earn: {mean(reward['search']):.2f}."
    )


def _outside(report: Any, stored: list[Any]) -> str:
    """Learners of other libraries in the test table, beside ours and chance."""
    ours = ("hierarchical", "single-level")
    names = [arm["name"] for arm in report["arms"]]
    chosen = zip(names, _figures(report), strict=True)
    arms = [figures for name, figures in chosen if name in ours]
    arms += [_learner(each) for each in stored]
    for each in stored:
        kind = "goals" if each["unit"] == "goals" else "low-level actions"
        arms.append(_tested(f"random {kind}", each, "random"))
    lines = [
        "**Other people's learners on the trap**: agents of other libraries, trained in our "
        "environments and tested alike, here:",
        "",
        _age(OUTSIDE),
        "",
        tables.tests(arms, "lanewise"),
    ]
    for each in stored:
        minutes = mean(seed["seconds"] for seed in each["seeds"]) / 60
        lines.append(
            f"- {each['title']}: `{each['command']}` ({each['date'][:10]}, {_learnt_with(each)}; "
            f"{minutes:.1f} minutes a seed, tests included, on {_machine(each)}, which did other "
            "work too)"
        )
    return "\n".join([*lines, "", "The learners are short files in [examples](examples)."]) + "\n"


def _briefly(stored: list[Any]) -> str:
    """The examples as they come, one row each."""
    lines = [
        _age(BRIEFLY),
        "",
        "| file | learns with | budget | reward | random | success (paper), % | success, % "
        "| accidents, % |",
        "|---|---|---:|---:|---:|---:|---:|---:|",
    ]
    for each in stored:
        (seed,) = each["seeds"]
        learnt, random = (Summary.from_json(seed[who]) for who in ("learnt", "random"))
        cells = [
            *(f"`{each['example']}.py`", _learnt_with(each)),
            *(f"{each['steps']:,} {each['unit']}", f"{learnt.values['accumulated_reward']:.2f}"),
            f"{random.values['accumulated_reward']:.2f}",
            *(_percent(learnt, name) for name in ("escape_rate", "success_rate", "accident_rate")),
        ]
        lines.append("| " + " | ".join(cells) + " |")
    return "\n".join(lines) + "\n"


def _percent(summary: Summary, name: str) -> str:
    return f"{100 * summary.values[name]:.1f}" if name in summary.values else UNKNOWN


def _learner(stored: Any) -> ArmFigures:
    return _tested(f"{stored['title']}, {stored['steps']:,} {stored['unit']}", stored, "learnt")


def _tested(title: str, stored: Any, who: str) -> ArmFigures:
    """A row of the test table from a stored file of `examples/record.py`."""
    tests = [Summary.from_json(seed[who]) for seed in stored["seeds"]]
    seeds = [seed["seed"] for seed in stored["seeds"]]
    return ArmFigures(title, "outside", seeds, {"lanewise": tests})


def _learnt_with(stored: Any) -> str:
    return ", ".join(f"{name} {stored['versions'][name]}" for name in stored["learner"])


def _beyond(found: Any) -> str:
    """One paragraph and a picture on the grid of starts."""
    every, winnable = found["totals"]["all"], found["totals"]["winnable"]
    return (
        f"**Beyond the single start**: one controller trained over ranges of speeds, lanes and "
        f"distances escapes from {100 * winnable['success_rate']:.1f} % of the "
        f"{winnable['starts']:,} winnable starts of a grid ({100 * every['success_rate']:.1f} % of "
        f"all {every['starts']:,}; {found['episodes_per_start']} episodes each). Where it breaks, "
        f"and why, is in [docs/ranges.md](docs/ranges.md).\n\n{_age(MAP)}\n\n"
        "![Success and accidents by ego speed, trap speed and lanes]"
        "(results/ranges/wide/map.png)\n"
    )


def _rates(arm: Any, name: str) -> list[float]:
    """A figure of the tests here, seed by seed."""
    return [seed["tests"]["lanewise"][name] for seed in arm["seeds"]]


def _details(report: Any) -> str:
    """All arms, both worlds, aggregates over seeds."""
    arms = _figures(report)
    reference = next(arm["title"] for arm in report["arms"] if arm["name"] == "single-level")
    lines = [
        "# Results",
        "",
        "Written by `python docs/make_results.py` from the stored files, not by hand. Weights were",
        "chosen on validation starts; each controller drove the test starts once. Every seed, the",
        "figures and the paper's claims are in",
        "[the report of `standard`](../results/standard/report.md), made by",
        f"`{report['command']}` ({report['date'][:10]}) on {_machine(report)}.",
        "",
        SUCCESSES,
        "",
        _age(STANDARD),
        "",
        "## What was run",
        "",
        f"{_hours(report):.1f} hours of trainings and tests together, two at a time. Means over "
        "seeds; an arm that takes",
        "over the step 1 of another has step 2 alone to show.",
        "",
        *_tables(arms, "## Every arm, {}"),
        "",
        "## Over seeds",
        "",
        "Interquartile means with 95 % stratified bootstrap intervals over seeds, and how likely a",
        f"seed of an arm beats one of *{reference}*.",
        "",
        tables.over_seeds(arms, reference).rstrip(),
    ]
    return "\n".join(lines) + "\n"


def _paper(report: Any) -> str:
    """The arms that were run at the paper's size."""
    arms = _figures(report)
    lines = [
        "",
        "## At the paper's size",
        "",
        f"`{report['command']}` ({report['date'][:10]}, {_machine(report)},",
        f"{_hours(report):.1f} hours of trainings and tests together, two at a time), with the",
        "preset `paper` of that day: 2000 episodes of at most 250 decisions, 1000 for step 1, the",
        "paper's exploration; the best weights of step 1, the last ones of the others; but 32",
        "worlds, an update for every eight decisions, and our time limit and tracking reward.",
        "Today's preset is what the paper states.",
        "Its other arms were not run. Curves, tables and claims are in",
        "[the report](../results/paper/report.md). That both controllers escape while they explore",
        "fails as computed there, until epsilon settles (some 120 episodes); in the curves",
        "the flat one escapes now and then between episodes 250 and 1,600, and then no more.",
        "",
        _age(PAPER),
        "",
        *_tables(arms, "Tests {}:"),
    ]
    return "\n".join(lines) + "\n"


def _tables(arms: list[ArmFigures], title: str) -> list[str]:
    """What was run, then the tests in both worlds, each under the title with its world's name."""
    lines = [tables.run(arms).rstrip()]
    for world, name in WORLDS.items():
        lines += ["", title.format(name), "", tables.tests(arms, world).rstrip()]
    return lines


def _hours(report: Any) -> float:
    """Wall time of every training and test, added up."""
    seeds = [seed for arm in report["arms"] for seed in arm["seeds"]]
    trained = sum(seed["effort"]["seconds"] for seed in seeds if seed["effort"])
    tested = sum(sum(seed["test_seconds"].values()) for seed in seeds)
    return float(trained + tested) / 3600


def _machine(report: Any) -> str:
    return f"{report['machine']['cores']} cores of an {report['machine']['processor']}"


def _readings(report: Any) -> str:
    """The literal readings beside the default."""
    lines = [
        "",
        "## Which readings carry the claim",
        "",
        f"`{report['command']}` ({report['date'][:10]}). Each arm changes the settings named, all",
        "else equal; arms that differ in step 2 or in tests alone take over the default's step 1",
        "runs. Means over seeds of the test episodes here, success seed by seed.",
        "",
        _age(READINGS),
        "",
        "| reading | settings | success of each seed | " + " | ".join(c[1] for c in COLUMNS) + " |",
        "|---|---|---|" + "---:|" * len(COLUMNS),
    ]
    for arm in report["arms"]:
        tests = [seed["tests"]["lanewise"] for seed in arm["seeds"]]
        flags = ((name.replace("_", "-"), value) for name, value in arm["changes"].items())
        changes = ", ".join(f"`--{name} {value}`" for name, value in flags)
        seeds = ", ".join(f"{100 * test['success_rate']:.1f}" for test in tests)
        lines.append(f"| {arm['title']} | {changes} | {seeds} | {_line(tests)} |")
    return "\n".join(lines) + "\n"


def _line(tests: Rows) -> str:
    return " | ".join(
        f"{mean(t[k] for t in tests) * s:.{d}f}{u}" if all(k in t for t in tests) else UNKNOWN
        for k, _, s, d, u in COLUMNS
    )


if __name__ == "__main__":
    main()
