"""From the results of an experiment to its report: Markdown, one offline page, JSON, figures."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from tempfile import TemporaryDirectory

from lanewise import config
from lanewise.evaluation import metrics
from lanewise.evaluation.metrics import Paired
from lanewise.evaluation.settings import WORLDS
from lanewise.experiments import claims, drives, figures, readings, report_data
from lanewise.experiments.claims import Claim, Seed
from lanewise.experiments.evidence import Evidence
from lanewise.experiments.experiment import Experiment
from lanewise.experiments.figures import COMPARED, FOLDER, PROFILE_SECONDS, SCHEDULES
from lanewise.experiments.report_data import ReportData
from lanewise.experiments.results import ArmResult, SeedResult
from lanewise.report import (
    clip,
    evaluation_table,
    experiment_tables,
    html_page,
    provenance,
    tables,
    training_curves,
)
from lanewise.report.figure_style import save
from lanewise.report.markup import cell, code
from lanewise.report.output_files import write_text
from lanewise.system.folder_io import OpenFolder, publish

REFERENCE = "single-level"
"""Arm that the others are held against."""
OTHERS = {"h_dqn": "h-dqn", "one_step": "one-step"}
"""Further arms that claims speak of, by field of `Seed`."""
REPORT = "report.md"
"""The page that is there once all of the report is."""


def write(
    out: OpenFolder,
    experiment: Experiment,
    results: Sequence[ArmResult],
    command: str,
    times: Mapping[str, float],
) -> tuple[Path, str]:
    """Write the report of an experiment into its folder; ``times`` are seconds by part of the work.

    Returns:
        (path of `report.md`, written last; its tables as text).

    Raises:
        LanewiseError: a file cannot be written, or the folder was moved, removed or replaced.
    """
    with TemporaryDirectory(prefix="lanewise-report-") as drawn:
        text = _draw(Path(drawn), experiment, results, command, times)
        publish(Path(drawn), out, last=REPORT)
    return out.path / REPORT, text


def _draw(
    out: Path,
    experiment: Experiment,
    results: Sequence[ArmResult],
    command: str,
    times: Mapping[str, float],
) -> str:
    """Write the report into an empty folder; its tables as text."""
    drawn = figures.write(out, results)
    clip.render(_shown(results).seeds[0].record(), out / "clip.gif")
    drives.write(out, results)
    lines = [line for result in _in_curves(results) for line in result.seeds[0].whole_training]
    if chunks := [line for line in lines if line["kind"] == "chunk"]:
        save(training_curves.draw_stages(chunks), out / "curves")
    made = provenance.origin()
    data = ReportData(experiment, command, results, _ledger(results), drawn, made, times)
    text = _markdown(data)
    write_text(out / "report.json", report_data.as_json(data))
    write_text(out / "report.html", html_page.render(text, experiment.title, out))
    write_text(out / REPORT, text)
    return _text(data)


def _shown(results: Sequence[ArmResult]) -> ArmResult:
    """The arm of the clip and of the list of settings."""
    return next((result for result in results if result.arm.name == COMPARED[-1]), results[0])


def _in_curves(results: Sequence[ArmResult]) -> list[ArmResult]:
    """The arms whose every stage is drawn: the paper's two, else the first."""
    return [r for r in results if r.arm.name in COMPARED] or [results[0]]


def _ledger(results: Sequence[ArmResult]) -> list[Claim]:
    """The claims over the seeds that both controllers have."""
    by_arm = {result.arm.name: {seed.job.seed: seed for seed in result.seeds} for result in results}
    if not all(name in by_arm for name in COMPARED):
        return []
    flat, ours = (by_arm[name] for name in COMPARED)
    explorers = [by_arm[name] for name in SCHEDULES if name != REFERENCE and name in by_arm]
    others = {field: by_arm.get(name, {}) for field, name in OTHERS.items()}
    seeds = [
        Seed(
            _evidence(ours[seed], PROFILE_SECONDS),
            _evidence(flat[seed], PROFILE_SECONDS),
            [_evidence(more[seed]) for more in explorers if seed in more],
            **{field: _evidence(arm[seed]) for field, arm in others.items() if seed in arm},
        )
        for seed in ours
        if seed in flat
    ]
    return claims.ledger(seeds)


def _evidence(seed: SeedResult, seconds: int | None = None) -> Evidence:
    """What a seed left behind, with a drive of that length where one is asked for."""
    settled = len(seed.episodes) if seed.settled is None else int(seed.settled)
    drive = None if seconds is None else seed.record(seconds=seconds)
    return Evidence(seed.episodes, settled, seed.tests["lanewise"].summary.values, drive)


def _markdown(data: ReportData) -> str:
    parts = [
        f"# {cell(data.experiment.title)}",
        f"{code(data.command)}, {data.made['date']}",
        *_test_part(data),
        *_training_part(data),
        *_weights_part(data),
        *_ledger_part(data),
        *_figure_part(data),
        *_reading_part(data),
        "## What the figures mean",
        tables.meanings(),
        *_origin_part(data),
    ]
    return "\n\n".join(part.rstrip() for part in parts if part) + "\n"


def _test_part(data: ReportData) -> list[str]:
    """The paper's test table, and everything known about the seeds."""
    rows = data.figures
    if not data.arm_by_arm:
        table = evaluation_table.markdown(data.summaries)
        return ["## Test episodes", table, _pairs(data.paired)]
    parts = ["## Test phase", "Means over seeds, the lowest and the highest seed in parentheses."]
    for world in data.worlds:
        parts += [f"### In {cell(world)}", experiment_tables.tests(rows, world)]
    parts += [_pairs(data.paired)]
    if data.several_seeds:
        held = next((r.arm.title for r in data.results if r.arm.name == REFERENCE), None)
        table = experiment_tables.over_seeds(rows, held)
        parts += ["### Over seeds", _over_seeds_note(held), table]
    return [
        *parts,
        "### Every seed",
        "Rates with exact 95 % intervals, means with Student's.",
        experiment_tables.every_seed(rows, WORLDS),
    ]


def _over_seeds_note(held: str | None) -> str:
    note = (
        "Interquartile means with 95 % stratified bootstrap intervals over seeds (Agarwal et al. "
        "2021). With five seeds they hold in about 91 of 100 cases."
    )
    if held is None:
        return note
    return (
        f"{note} P is the probability that a seed of an arm beats one of *{cell(held)}*; a tie "
        "counts half. Its intervals hold in as few as 62 of 100 cases where it is near 0 or 1."
    )


def _training_part(data: ReportData) -> list[str]:
    trained = [arm for arm in data.figures if arm.training]
    if not trained:
        return []
    return [
        "## Training phase",
        f"Means of the last {metrics.TRAINING_WINDOW} training episodes of the last stage, which "
        "still explore. The paper does not say whether its reward is one a decision or one a "
        "second; episodes of step 2 may be shorter than those of the other stages (row 4 below).",
        experiment_tables.training(trained),
    ]


def _weights_part(data: ReportData) -> list[str]:
    """Kept and last weights, and a line about each seed whose kept ones are an accident."""
    stages = data.selected
    if not stages:
        return []
    episodes = next(iter(stages.values()))[0][1].line["fresh_episodes"]
    return [
        "## Kept and last weights",
        f"Greedy, on {episodes:,} validation starts by which no weights were chosen. *Chosen for* "
        "is what the kept weights did in the validation they were chosen by.",
        experiment_tables.weights(
            {title: [kept for _, kept in seeds] for title, seeds in stages.items()}
        ),
        "\n".join(
            f"- **{cell(title)}, seed {seed}**: {cell(warning)}"
            for title, seeds in stages.items()
            for seed, kept in seeds
            for warning in kept.warnings
        ),
    ]


def _ledger_part(data: ReportData) -> list[str]:
    if not data.ledger:
        return []
    return [
        "## What reproduces, what does not, and why",
        "Each claim is computed seed by seed: it holds if every seed says so, fails if none does, "
        "otherwise it depends. Words in quotation marks are the paper's, and so is success here: "
        "past the trap before the end, whether or not an accident follows.",
        "| the paper says | verdict | seeds | measured |\n|---|---|---:|---|\n"
        + "\n".join(
            f"| {cell(claim.text)} | **{claim.verdict}** | {sum(claim.seeds)} of "
            f"{len(claim.seeds)} | {cell(claim.figures)} |"
            for claim in data.ledger
        ),
    ]


def _figure_part(data: ReportData) -> list[str]:
    parts = ["## Figures"]
    for name, caption in data.drawn.items():
        parts += [f"![{cell(caption)}]({FOLDER}/{name}.png)", f"*{cell(caption)}*"]
    if any(result.seeds[0].lines for result in _in_curves(data.results)):
        parts += [
            "![Success, reward and speed while training](curves.png)",
            "*Every stage of the first seeds over its decisions*",
        ]
    shown = cell(_shown(data.results).arm.title)
    return [*parts, f"![The road from above: {shown}](clip.gif)", f"*One test episode: {shown}*"]


def _reading_part(data: ReportData) -> list[str]:
    """The rows of the reading, with the settings of every arm."""
    arms = []
    for result in data.results:
        arm, settings = result.arm, config.flatten(result.settings)
        takes_over = bool(arm.high_level)
        arms.append(readings.ArmSettings(arm.title, arm.controller, settings, takes_over))
    return [
        "## What the paper leaves open, row by row",
        f"Settings are those of the arms above. {readings.STAR}",
        readings.table(arms),
    ]


def _origin_part(data: ReportData) -> list[str]:
    made, took, shown = data.made, data.times.get("everything"), _shown(data.results)
    trained_by = [seed.trained_by for result in data.results for seed in result.seeds]
    return [
        "## How it was made",
        tables.listing({**made["versions"], **made["machine"]}),
        provenance.trained_by([source for source in trained_by if source is not None]),
        "" if took is None else f"The last call of the command took {took:.1f} s.",
        "### What was run",
        "Means over seeds. A training's time includes compilation and whatever shared the machine; "
        "an arm that takes over the step 1 of another has step 2 alone to show.",
        experiment_tables.effort(data.figures),
        "### Settings of the arms",
        f"| arm | settings that differ from preset {data.experiment.preset} |\n|---|---|\n"
        + "\n".join(map(_changes, data.results)),
        f"## Settings: {cell(shown.arm.title)}",
        tables.listing(config.flatten(shown.settings)),
    ]


def _changes(result: ArmResult) -> str:
    changes = ", ".join(code(f"{name} = {value}") for name, value in result.arm.changes.items())
    return f"| {cell(result.arm.title)} | {changes} |"


def _pairs(paired: Mapping[str, Mapping[int, Paired]]) -> str:
    """One line an arm: how many starts end alike in both worlds."""
    lines = []
    for name, pairs in paired.items():
        total = sum(pair.episodes for pair in pairs.values())
        same = total - sum(len(pair.differing) for pair in pairs.values())
        line = f"- {cell(name)}: {same} of {total} starts end alike in both worlds"
        differing = [(seed, start) for seed, pair in pairs.items() for start in pair.differing]
        if differing:
            line += "; not " + ", ".join(f"{i} of seed {seed}" for seed, i in differing[:20])
        lines.append(line)
    return "\n".join(lines)


def _text(data: ReportData) -> str:
    """The tables for a terminal."""
    rows = data.figures
    if data.arm_by_arm:
        found = "\n".join(
            f"in {world}, means over seeds (their number in parentheses)\n"
            + experiment_tables.text([arm for arm in rows if arm.tests.get(world)], world)
            for world in data.worlds
        )
    else:
        found = evaluation_table.text(data.summaries)
    lines = [line.removeprefix("- ") for line in _pairs(data.paired).splitlines()]
    lines += [f"{claim.verdict}: {claim.text}" for claim in data.ledger]
    return found + "\n" + "".join(f"{line}\n" for line in lines)
