"""The figures of an experiment's report, each drawn if the experiment has what it shows."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from lanewise.evaluation.settings import WORLDS
from lanewise.experiments.results import ArmResult
from lanewise.report import film_strip, goal_figure, profiles, seed_figure, training_curves
from lanewise.report.figure_style import Figure, save

FOLDER = "figures"
"""Below the report."""
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


def write(out: Path, results: Sequence[ArmResult]) -> dict[str, str]:
    """Draw every figure that the results allow below ``out``.

    Returns:
        The caption of each by the name of its files, without ending, in the order of the report.
    """
    captions = {}
    for name, caption, figure in _figures({result.arm.name: result for result in results}):
        save(figure, out / FOLDER / name)
        captions[name] = caption
    return captions


def _figures(arms: Mapping[str, ArmResult]) -> Iterator[tuple[str, str, Figure]]:
    if any(len(arm.seeds) > 1 for arm in arms.values()):
        caption = "Tests of every arm: a dot a seed, a line at their mean, published values dashed"
        found = seed_figure.draw([arm.figures for arm in arms.values()], WORLDS[0])
        yield "seeds", caption, found
    yield from _curves(arms)
    if all(name in arms for name in COMPARED):
        yield from _drives({name: arms[name] for name in COMPARED})
    if "hierarchical" in arms:
        caption = (
            "Goals the high level chose along one test episode, and what became of each (not in "
            "the paper)"
        )
        first = arms["hierarchical"].seeds[0].record()
        yield "goals", caption, goal_figure.draw(first)


def _curves(arms: Mapping[str, ArmResult]) -> Iterator[tuple[str, str, Figure]]:
    """Both successes, reward and speed over training episodes; an arm's last stage."""
    both = {name: arms[name] for name in CURVES if name in arms}
    if both:
        caption = (
            "Training, exploration included: the paper's success and ours, reward and speed over "
            "episodes, mean and spread over seeds (the paper's training figure). If arms "
            "differ in the length of their episodes (`duration` in their settings), their rewards "
            "an episode differ for that alone"
        )
        rows, settled = _training(both, lambda result: result.arm.name)
        yield "training", caption, training_curves.draw(rows, settled=settled)
    schedules = {name: arms[name] for name in SCHEDULES if name in arms}
    if len(schedules) > 1:
        caption = (
            f"The single-level controller under {len(schedules)} exploration schedules (the "
            "paper's comparison)"
        )
        rows, settled = _training(schedules, lambda result: result.arm.title)
        yield "exploration", caption, training_curves.draw(rows, settled=settled)


def _training(
    arms: Mapping[str, ArmResult], title: Callable[[ArmResult], str]
) -> tuple[dict[str, list[list[dict[str, Any]]]], dict[str, float]]:
    """(episodes by title and seed, episode at which epsilon settled in the first seed)."""
    rows = {title(arm): [seed.episodes for seed in arm.seeds] for arm in arms.values()}
    marks = {title(arm): arm.seeds[0].settled for arm in arms.values()}
    return rows, {name: mark for name, mark in marks.items() if mark is not None}


def _drives(pair: Mapping[str, ArmResult]) -> Iterator[tuple[str, str, Figure]]:
    """What both controllers do: profiles over seeds, and a film strip of the first seed."""
    longer = {
        name: [seed.record(i, PROFILE_SECONDS) for seed in result.seeds for i in range(PROFILED)]
        for name, result in pair.items()
    }
    caption = (
        f"Speed and reward over the first {PROFILE_SECONDS} timesteps, {PROFILED} drives of every "
        "seed (the paper's profiles)"
    )
    yield "profiles", caption, profiles.draw(longer)
    caption = "Both controllers from above, same start (the paper's film strip)"
    firsts = {name: result.seeds[0].record() for name, result in pair.items()}
    yield "film-strip", caption, film_strip.draw(firsts)
