"""The figures of an experiment's report, each drawn if the experiment has what it shows."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from lanewise.evaluation.settings import WORLDS
from lanewise.experiments.results import ArmResult, SeedResult
from lanewise.report import (
    film_strip,
    framework,
    goal_track,
    profiles,
    seeds,
    start_ranges,
    training_curves,
    trap_schematic,
    two_steps,
)
from lanewise.report.arms import ArmFigures
from lanewise.runs import metrics

FOLDER = "figures"
"""Below the report."""
SUFFIXES = (".png", ".svg")
COMPARED = ("single-level", "hierarchical")
"""The paper's two controllers, in its order."""
CURVES = (*COMPARED, "planned", "h-dqn")
"""Arms of the training figure; step 1 is drawn too (row 26 of the reading)."""
SCHEDULES = ("single-level", "single-level-from-1", "single-level-over-5000")
"""Arms of the exploration figure."""
PROFILE_SECONDS = 40
"""Length of the drives behind the profiles, s; a test lasts 25 s."""
PROFILED = 5
"""Drives of each seed behind the profiles."""


@dataclass(frozen=True)
class Drawn:
    """A figure of the report."""

    name: str
    """Of its files, without ending."""
    caption: str
    """What it shows, and what the paper calls it."""


Draw = Callable[[Path], None]


def write(out: Path, results: Sequence[ArmResult]) -> list[Drawn]:
    """Draw every figure that the results allow, as PNG and SVG below ``out``.

    Returns:
        What was drawn, in the order of the report.
    """
    drawn = []
    for figure, draw in _figures({result.arm.name: result for result in results}):
        for suffix in SUFFIXES:
            draw(out / FOLDER / f"{figure.name}{suffix}")
        drawn.append(figure)
    return drawn


def of_seeds(arms: Sequence[ArmFigures], out: Path) -> Drawn:
    """Draw the tests of every arm in our world, as PNG and SVG below ``out``."""
    drawn = Drawn(
        "seeds",
        "Tests of every arm: a dot a seed, a line at their mean, published values dashed",
    )
    for suffix in SUFFIXES:
        seeds.write(arms, WORLDS[0], out / FOLDER / f"{drawn.name}{suffix}")
    return drawn


def _figures(arms: Mapping[str, ArmResult]) -> Iterator[tuple[Drawn, Draw]]:
    yield from _schematics(next(iter(arms.values())).seeds[0])
    yield from _curves(arms)
    if all(name in arms for name in COMPARED):
        pair = {name: arms[name] for name in COMPARED}
        yield from _drives(pair)
    if "hierarchical" in arms:
        first = arms["hierarchical"].seeds[0].record()
        yield (
            Drawn(
                "goals",
                "Goals the high level chose along one test episode, and what became of "
                "each (not in the paper)",
            ),
            lambda path: goal_track.write(first, path),
        )


def _schematics(seed: SeedResult) -> Iterator[tuple[Drawn, Draw]]:
    settings = seed.job.settings
    yield (
        Drawn("trap", "The trap at its test start"),
        lambda path: trap_schematic.write(settings.scenario, path),
    )
    yield (
        Drawn("start-ranges", "D1 and D2: training ranges and test start"),
        lambda path: start_ranges.write(settings.scenario, path),
    )
    yield Drawn("framework", "The framework"), lambda path: framework.write(settings, path)
    yield Drawn("two-steps", "Two-step training"), lambda path: two_steps.write(settings, path)


def _curves(arms: Mapping[str, ArmResult]) -> Iterator[tuple[Drawn, Draw]]:
    """Both successes, reward and speed over training episodes; an arm's last stage."""
    both = {name: arms[name] for name in CURVES if name in arms}
    if both:
        rows, settled = _training(both, lambda result: result.arm.name)
        yield (
            Drawn(
                "training",
                "Training, exploration included: the paper's success and ours, reward and speed "
                "over episodes, mean and spread over seeds (the paper's training figure). Arms "
                "whose episodes last differently long (`duration` in their settings) differ in "
                "reward an episode for that alone",
            ),
            lambda path: training_curves.write(rows, path, settled=settled),
        )
    schedules = {name: arms[name] for name in SCHEDULES if name in arms}
    if len(schedules) > 1:
        own, marks = _training(schedules, lambda result: result.arm.title)
        yield (
            Drawn(
                "exploration",
                f"The single-level controller under {len(schedules)} exploration schedules "
                "(the paper's comparison)",
            ),
            lambda path: training_curves.write(own, path, settled=marks),
        )


def _training(
    arms: Mapping[str, ArmResult], title: Callable[[ArmResult], str]
) -> tuple[dict[str, list[list[dict[str, Any]]]], dict[str, float]]:
    """(episodes by title and seed, episode at which epsilon settled in the first seed)."""
    rows, settled = {}, {}
    for result in arms.values():
        rows[title(result)] = [seed.episodes for seed in result.seeds]
        mark = metrics.settled_episode(result.seeds[0].chunks)
        if mark is not None:
            settled[title(result)] = mark
    return rows, settled


def _drives(pair: Mapping[str, ArmResult]) -> Iterator[tuple[Drawn, Draw]]:
    """What both controllers do: profiles over seeds, and a film strip of the first seed."""
    longer = {
        name: [seed.record(i, PROFILE_SECONDS) for seed in result.seeds for i in range(PROFILED)]
        for name, result in pair.items()
    }
    yield (
        Drawn(
            "profiles",
            f"Speed and reward over the first {PROFILE_SECONDS} timesteps, "
            f"{PROFILED} drives of every seed (the paper's profiles)",
        ),
        lambda path: profiles.write(longer, path),
    )
    firsts = {name: result.seeds[0].record() for name, result in pair.items()}
    yield (
        Drawn("film-strip", "Both controllers from above, same start (the paper's film strip)"),
        lambda path: film_strip.write(firsts, path),
    )
