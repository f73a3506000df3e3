"""From the results of an experiment to its report."""

from collections.abc import Mapping, Sequence
from pathlib import Path

from lanewise import config
from lanewise.evaluation import metrics
from lanewise.experiments.experiment import Experiment
from lanewise.experiments.results import WORLDS, ArmResult
from lanewise.report import report, table


def write(
    out: Path,
    experiment: Experiment,
    results: Sequence[ArmResult],
    command: str,
    times: Mapping[str, float],
) -> tuple[Path, str]:
    """Write the report of an experiment into its folder.

    Args:
        out: the folder.
        experiment: what was run.
        results: of its finished jobs.
        command: that made them.
        times: seconds by part of the work.

    Returns:
        (path of the report, its table as text).
    """
    firsts = [result.seeds[0] for result in results]
    summaries = [
        seed.tests[world].summary for seed in firsts for world in WORLDS if world in seed.tests
    ]
    pairs = {
        seed.job.arm: metrics.paired(*(seed.tests[world].episodes for world in WORLDS))
        for seed in firsts
        if len(seed.tests) == len(WORLDS)
    }
    shown = firsts[0]
    path = report.write_report(
        out,
        report.Report(
            title=experiment.title,
            command=command,
            summaries=summaries,
            settings=config.flatten(shown.job.settings) | {"seed": shown.job.seed},
            curves=[line for seed in firsts for line in seed.lines if line["kind"] == "chunk"],
            recording=shown.record(),
            paired=pairs,
            times=times,
        ),
    )
    lines = [
        f"{name}: {pair.share:.1%} of {pair.episodes} starts end alike in both worlds\n"
        for name, pair in pairs.items()
    ]
    return path, table.text(summaries) + "".join(lines)
