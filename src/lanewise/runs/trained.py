"""Trained controllers on disk: what a stage hands on, and the finished controller of a run."""

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import jax

from lanewise import crosschecks
from lanewise.controllers.controller import Parameters
from lanewise.driving.parts import OURS, Parts
from lanewise.errors import RunError, SettingsError
from lanewise.learning import network
from lanewise.runs import checkpoint, shelf, tree
from lanewise.runs.folder import RunFolder
from lanewise.settings import Settings
from lanewise.training import recipe
from lanewise.training.recipe import Stage
from lanewise.version import __version__

CONTROLLER = "controller"
"""File name of a finished run's controller."""


@dataclass(frozen=True)
class Trained:
    """A controller ready to drive."""

    name: str
    """Which controller."""
    settings: Settings
    """Of the run it comes from."""
    seed: int
    """Of the run it comes from."""
    parameters: Parameters
    """Of all its levels."""
    parts: Parts = OURS
    """The user's own functions it was trained with."""


def is_finished(folder: RunFolder) -> bool:
    """Whether the run has its controller."""
    return (folder.path / f"{CONTROLLER}.json").exists()


def load(path: Path, parts: Parts = OURS) -> Trained:
    """The finished controller of a run, or one that comes with the package (`shelf`).

    Args:
        path: a run folder, ``pretrained/NAME`` or ``reference/NAME``.
        parts: the user's own functions it was trained with.

    Raises:
        RunError: there is no run, or it is not finished, or was trained with other parts.
        CheckpointError: its files are damaged.
    """
    if name := shelf.reference(path):
        return Trained(name, Settings(), 0, {})
    folder = RunFolder.open(shelf.locate(path))
    check_parts(folder, parts)
    if not is_finished(folder):
        raise RunError(
            f"{path} is not finished; lanewise train {folder.controller} --out {path} --resume "
            "continues it"
        )
    blank: Parameters = {}
    for stage in _stages(folder):
        blank = blank | blank_networks(folder, stage, parts)
    stored = checkpoint.load(folder.path, CONTROLLER, tree.shapes(blank), folder.digest)
    parameters: Parameters = tree.unflatten(blank, stored.arrays)
    return Trained(folder.controller, folder.settings, folder.seed, parameters, parts)


def fingerprint(folder: RunFolder) -> str:
    """Digest of a finished run's weights: it stands for all of the training behind them."""
    manifest = json.loads((folder.path / f"{CONTROLLER}.json").read_text("utf-8"))
    return str(manifest["sha256"])


def save_controller(folder: RunFolder, parameters: Parameters) -> None:
    """Store the finished controller."""
    meta = {"controller": folder.controller, "seed": folder.seed, "lanewise": __version__}
    checkpoint.save(folder.path, CONTROLLER, tree.flatten(parameters), meta, folder.digest)


def has_stage(folder: RunFolder, name: str) -> bool:
    """Whether a stage is complete."""
    return (folder.stages / f"{name}.json").exists()


def finished_stages(folder: RunFolder) -> list[Stage]:
    """The stages that are complete, in order."""
    return [stage for stage in _stages(folder) if has_stage(folder, stage.name)]


def metrics_bytes(folder: RunFolder, stage: Stage) -> int:
    """Length of the metrics file when a complete stage ended."""
    stored = checkpoint.load(folder.stages, stage.name, None, folder.digest)
    return int(stored.meta["metrics_bytes"])


def save_stage(
    folder: RunFolder, stage: Stage, parameters: Parameters, meta: dict[str, Any]
) -> None:
    """Store what a stage hands on: the parameters of the levels that learnt in it."""
    checkpoint.save(folder.stages, stage.name, tree.flatten(parameters), meta, folder.digest)


def load_stage(folder: RunFolder, stage: Stage, parts: Parts = OURS) -> Parameters:
    """What a stage handed on."""
    blank = blank_networks(folder, stage, parts)
    stored = checkpoint.load(folder.stages, stage.name, tree.shapes(blank), folder.digest)
    parameters: Parameters = tree.unflatten(blank, stored.arrays)
    return parameters


def take_over_high_level(folder: RunFolder, source: Path, parts: Parts = OURS) -> None:
    """Copy the step-1 result of another run into this one, so that only step 2 is trained.

    Raises:
        RunError: the source has no finished step 1, or the two high levels differ in shape or in
            what they see.
    """
    first = recipe.STEP_1
    if has_stage(folder, first.name):
        raise RunError(f"{folder.path} has its own step 1 already; resume it without --high-level")
    other = check_lender(source, folder.settings)
    check_parts(other, parts)
    parameters = load_stage(other, first, parts)
    meta = {
        "taken_from_seed": other.seed,
        "taken_from_settings": other.digest,
        "metrics_bytes": 0,
    }
    save_stage(folder, first, parameters, meta)


def check_lender(source: Path, settings: Settings) -> RunFolder:
    """The run at ``source``, once it is sure that its high level fits these settings.

    Raises:
        RunError: it has no finished step 1, or the two high levels differ in shape or in what
            they see.
    """
    lender = RunFolder.open(source)
    first = recipe.STEP_1
    if not has_stage(lender, first.name):
        raise RunError(f"{source} has no finished {first.name}: it cannot lend its high level")
    try:
        crosschecks.check_high_level(lender.settings, settings)
    except SettingsError as error:
        raise RunError(f"{source} {error}") from error
    return lender


def check_parts(folder: RunFolder, parts: Parts) -> None:
    """Refuses to go on with other functions than a run was made with, as far as names can tell.

    Raises:
        RunError: says which it was made with.
    """
    if folder.parts != parts.names():
        made = "; ".join(folder.parts) or "no parts of the user's own"
        remedy = (
            "give the same functions: lanewise.evaluate(run, parts=...), "
            "lanewise.train(..., parts=...)"
        )
        if not folder.parts:
            remedy = f"leave out {'; '.join(parts.names())}"
        raise RunError(f"{folder.path} was made with {made}\n  {remedy}")


def blank_networks(folder: RunFolder, stage: Stage, parts: Parts = OURS) -> Parameters:
    """Shapes of the networks that learn in a stage."""
    course = recipe.course(folder.settings, stage, parts)

    def networks(key: jax.Array) -> Parameters:
        found: Parameters = {}
        for name, how in course.learning:
            level = course.level(name)
            found[name] = network.init(
                key, level.feature_count, how.learner.hidden, level.choice_count
            )
        return found

    shapes: Parameters = jax.eval_shape(networks, jax.random.key(0))
    return shapes


def _stages(folder: RunFolder) -> tuple[Stage, ...]:
    return recipe.RECIPES[folder.controller]
