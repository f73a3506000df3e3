"""Trained controllers on disk: what a stage hands on, and the finished controller of a run."""

import os
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import jax

from lanewise import pinned
from lanewise.config.settings import Settings
from lanewise.controllers.controller import Parameters
from lanewise.controllers.registry import STEP_1, Stage
from lanewise.driving.parts import OURS, Parts
from lanewise.errors import CheckpointError, RunError, shell_line
from lanewise.learning import network
from lanewise.runs import checkpoint, records, shelf, tree
from lanewise.runs.folder import STAGES, RunFolder
from lanewise.runs.lender import check_lender
from lanewise.runs.metrics import MetricsWriter
from lanewise.training import recipe
from lanewise.version import __version__

CONTROLLER = "controller"
"""File name of a finished run's controller."""


@dataclass(frozen=True)
class Mark:
    """A place in the metrics file, up to which its bytes are known."""

    bytes: int = 0
    """Length."""
    sha256: str | None = None
    """Digest of what lies before it; None in runs made before it was remembered."""

    @classmethod
    def of(cls, meta: dict[str, Any], file: Path) -> "Mark":
        """Read it from what a manifest remembers.

        Raises:
            CheckpointError: it is none.
        """
        length, digest = meta.get("metrics_bytes"), meta.get("metrics_sha256")
        if type(length) is not int or length < 0:
            raise CheckpointError(f"{file} is damaged: metrics_bytes is no length")
        if not (digest is None or isinstance(digest, str)):
            raise CheckpointError(f"{file} is damaged: metrics_sha256 is no digest")
        # Runs from before remember neither of the two.
        if length and ("seed" in meta) != (digest is not None):
            raise CheckpointError(f"{file} is damaged: it lacks metrics_sha256 or seed")
        return cls(length, digest)

    @classmethod
    def after(cls, metrics: MetricsWriter) -> dict[str, Any]:
        """What to remember of a file now, once it is safely on disk."""
        return {"metrics_bytes": metrics.sync(), "metrics_sha256": metrics.sha256()}


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
    # A link that leads nowhere is there too, and is refused when it is read.
    return os.path.lexists(folder.path / f"{CONTROLLER}.json")


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
    folder.check_parts(parts.names())
    if not is_finished(folder):
        raise RunError(
            f"{path} is not finished; "
            f"{shell_line('lanewise', 'train', folder.controller, '--out', path, '--resume')} "
            "continues it"
        )
    blank: Parameters = {}
    for stage in _stages(folder):
        blank = blank | blank_networks(folder, stage, parts)
    stored = checkpoint.load(folder.path, CONTROLLER, tree.shapes(blank), folder.digest)
    check_seed(folder, stored.meta, folder.path / CONTROLLER)
    if stored.meta.get("controller") != folder.controller:
        raise CheckpointError(f"{folder.path / CONTROLLER} is not {folder.controller}")
    parameters: Parameters = tree.unflatten(blank, stored.arrays)
    return Trained(folder.controller, folder.settings, folder.seed, parameters, parts)


def fingerprint(folder: RunFolder) -> str:
    """Digest of a finished run's weights: it stands for all of the training behind them."""
    return checkpoint.read_digest(folder.path, CONTROLLER)


def save_controller(folder: RunFolder, parameters: Parameters) -> None:
    """Store the finished controller."""
    meta = {"controller": folder.controller, "seed": folder.seed, "lanewise": __version__}
    checkpoint.save(folder.held, CONTROLLER, tree.flatten(parameters), meta, folder.digest)


def has_stage(folder: RunFolder, name: str) -> bool:
    """Whether a stage is complete."""
    return os.path.lexists(folder.stages / f"{name}.json")


def finished_stages(folder: RunFolder) -> list[Stage]:
    """The stages that are complete, in order."""
    return [stage for stage in _stages(folder) if has_stage(folder, stage.name)]


def metrics_of(folder: RunFolder, stage: Stage) -> Mark:
    """How far the metrics file had come when a complete stage ended.

    Raises:
        CheckpointError: what the stage left is damaged.
    """
    meta = checkpoint.read_meta(folder.stages, stage.name, folder.digest)
    return Mark.of(meta, folder.stages / f"{stage.name}.json")


def lines(folder: RunFolder) -> list[dict[str, Any]]:
    """The metrics of a run, in full; as far as they belong to its finished stages, as written.

    Raises:
        RunError: the file is damaged or was altered.
    """
    done = finished_stages(folder)
    mark = metrics_of(folder, done[-1]) if done else Mark()
    if mark.sha256 is None:
        return records.read(folder.metrics)
    found = records.read(folder.metrics, mark.bytes, mark.sha256)
    if folder.metrics.stat().st_size == mark.bytes:
        return found
    if len(done) == len(_stages(folder)):
        raise RunError(f"{folder.metrics} was altered: it goes on after the end of the run")
    return records.read(folder.metrics)


def save_stage(
    folder: RunFolder, stage: Stage, parameters: Parameters, meta: dict[str, Any]
) -> None:
    """Store what a stage hands on: the parameters of the levels that learnt in it."""
    told = meta | {"seed": folder.seed}
    with folder.held.inside(STAGES) as place:
        checkpoint.save(place, stage.name, tree.flatten(parameters), told, folder.digest)


def load_stage(folder: RunFolder, stage: Stage, parts: Parts = OURS) -> Parameters:
    """What a stage handed on."""
    blank = blank_networks(folder, stage, parts)
    stored = checkpoint.load(folder.stages, stage.name, tree.shapes(blank), folder.digest)
    check_seed(folder, stored.meta, folder.stages / stage.name)
    parameters: Parameters = tree.unflatten(blank, stored.arrays)
    return parameters


def check_seed(folder: RunFolder, meta: dict[str, Any], file: Path) -> None:
    """Refuses what belongs to a run with another seed; files from before say nothing of theirs.

    Raises:
        CheckpointError: names the file.
    """
    if meta.get("seed", folder.seed) != folder.seed:
        raise CheckpointError(f"{file} is of another run: its seed is not {folder.seed}")


def take_over_high_level(folder: RunFolder, source: Path, parts: Parts = OURS) -> None:
    """Copy the step-1 result of another run into this one, so that only step 2 is trained.

    Raises:
        RunError: the source has no finished step 1, or the two high levels differ in shape or in
            what they see.
    """
    first = STEP_1
    if has_stage(folder, first.name):
        raise RunError(f"{folder.path} has its own step 1 already; resume it without --high-level")
    other = check_lender(source, folder.settings, parts.names())
    parameters = load_stage(other, first, parts)
    meta = {
        "taken_from_seed": other.seed,
        "taken_from_settings": other.digest,
        "metrics_bytes": 0,
    }
    save_stage(folder, first, parameters, meta)


@pinned.switches()
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

    shapes: Parameters = jax.eval_shape(networks, pinned.key(0))
    return shapes


def _stages(folder: RunFolder) -> tuple[Stage, ...]:
    return recipe.RECIPES[folder.controller]
