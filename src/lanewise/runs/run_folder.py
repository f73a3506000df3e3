"""Run folders: the settings a run was made with, who may write to it, and where things lie.

::

    DIR/run.json          format, controller, seed, settings digest, code; written last
    DIR/settings.toml     every setting
    DIR/metrics.jsonl     one JSON object a line, the same bytes however often it was resumed
    DIR/metrics-before-*  metrics of a stage that began anew without a checkpoint
    DIR/*.csv             the same as tables
    DIR/tensorboard/      the same as TensorBoard's events, if wanted
    DIR/timings.jsonl     wall-clock times, which do differ
    DIR/checkpoints/      what resuming needs
    DIR/stages/           what each finished stage hands on
    DIR/diverged/         what is kept of a training whose numbers stopped being finite
    DIR/controller.*      the trained controller

The process that writes holds a lock on the folder itself.
Imports no JAX.
"""

import hashlib
import os
from collections.abc import Mapping
from dataclasses import dataclass, field
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from lanewise import config
from lanewise.config import validation
from lanewise.config.settings import Settings
from lanewise.controllers.registry import STEP_1, TRAINABLE, WITH_STEP_1
from lanewise.errors import RunError, SettingsError, brief
from lanewise.system import process, safe_io, version
from lanewise.system.folder_io import PARTIAL, OpenFolder, lock, write_atomically

FORMAT = "lanewise-run"
VERSION = 2
_LARGEST_MANIFEST = 100_000
LARGEST_SETTINGS = 100_000
"""Bytes of a file with every setting."""
CHECKPOINTS, STAGES = "checkpoints", "stages"
CONTROLLER = "controller"
"""File name of a finished run's controller."""
_ROUNDING = ("fast_math", "optimization_level")
"""Parts of names in ``XLA_FLAGS`` that change how the compiler rounds."""
_UNOPTIMISED = "JAX_DISABLE_MOST_OPTIMIZATIONS"


@dataclass
class RunFolder:
    """A run on disk. ``create`` and ``resume`` lock it until ``close``; ``open`` only reads."""

    path: Path
    settings: Settings
    """Every setting the run was made with."""
    controller: str
    """What is trained: a name in `lanewise.controllers.registry.TRAINABLE`."""
    seed: int
    """Seed of everything random."""
    digest: str
    """SHA-256 of the settings file, which every file of the run carries."""
    task: tuple[str, ...] = ()
    """Names of the user's own functions it is trained with (`TaskFunctions.names`)."""
    compiler: tuple[str, ...] = ()
    """Compiler switches it was made with (`compiler_switches`)."""
    source: Mapping[str, Any] = field(default_factory=dict)
    """The code it was made with (`version.source`)."""
    _held: OpenFolder | None = field(default=None, repr=False)

    @classmethod
    def create(
        cls,
        path: Path | OpenFolder,
        settings: Settings,
        controller: str,
        seed: int,
        task: tuple[str, ...] = (),
        observed: int | None = None,
    ) -> "RunFolder":
        """Make a run in a new or empty folder and lock it; the folder is made with its parents.

        ``observed`` is how many numbers a user's own function observes; the rest are fields of the
        run.

        Raises:
            RunError: the folder is not empty or in use.
            SettingsError: the machine has too little memory for these settings.
        """
        validation.check_memory(settings, controller, process.total_memory(), observed)
        name = _name_of(path)
        require_empty(name)
        held = lock(path, "training")
        digest = config.digest(settings)
        folder = cls(name, settings, controller, seed, digest, task, compiler_switches())
        folder._held = held
        try:
            # Whoever had the lock just before may have made a run meanwhile.
            require_empty(name)
            folder.source = version.source()
            folder._write_identity()
        except BaseException:
            folder.close()
            raise
        return folder

    @classmethod
    def open(cls, path: Path) -> "RunFolder":
        """Read a run, without locking it."""
        manifest = _read_manifest(path / "run.json")
        return cls(
            path,
            _read_settings(path / "settings.toml", manifest["settings_digest"]),
            manifest["controller"],
            manifest["seed"],
            manifest["settings_digest"],
            tuple(manifest.get("task_functions", ())),
            tuple(manifest.get("compiler", ())),
            version.recorded(manifest),
        )

    @classmethod
    def resume(
        cls,
        path: Path | OpenFolder,
        settings: Settings | None = None,
        controller: str | None = None,
        seed: int | None = None,
    ) -> "RunFolder":
        """Open a run to continue it, and lock it; what is None is taken from the run.

        Raises:
            RunError: there is no run, it is in use, or was made with something else.
        """
        name = _name_of(path)
        if not os.path.lexists(name / "run.json"):
            raise RunError(f"no run in {name} to continue; leave out --resume to begin one")
        folder = cls.open(name)
        if controller is not None and controller != folder.controller:
            raise RunError(f"{folder.path} trains {folder.controller}, not {controller}")
        if seed is not None and seed != folder.seed:
            raise RunError(f"{folder.path} was made with seed {folder.seed}, not {seed}")
        difference = config.first_difference(folder.settings, settings or folder.settings)
        if difference:
            raise RunError(
                f"{folder.path} was made with other settings: there {difference}\n"
                "  --resume without settings uses the run's own; if you give some, the others are "
                "defaults"
            )
        if folder.compiler != (switches := compiler_switches()):
            made, now = (", ".join(given) or "none" for given in (folder.compiler, switches))
            raise RunError(
                f"{folder.path} was made with other compiler switches: there {made}, here {now}\n"
                "  it would go on to other bits; set them as they were"
            )
        folder._held = lock(path, "training")
        return folder

    @property
    def held(self) -> OpenFolder:
        """The open folder to write into; only of a run that was created or resumed."""
        assert self._held is not None, "a run that is only read is not written to"
        return self._held

    @property
    def checkpoints(self) -> Path:
        """Where checkpoints lie."""
        return self.path / CHECKPOINTS

    @property
    def metrics(self) -> Path:
        """The metrics file."""
        return self.path / "metrics.jsonl"

    @property
    def stages(self) -> Path:
        """Where finished stages leave what they hand on; made by the first of them."""
        return self.path / STAGES

    def check_parts(self, task: tuple[str, ...]) -> None:
        """Raise a RunError for functions of other names than the run was made with."""
        if self.task == task:
            return
        made = "; ".join(self.task) or "no task functions of the user's own"
        given = "; ".join(task)
        calls = "lanewise.evaluate(run, task=...), lanewise.train(..., task=...)"
        instead = f", not {given}" if task else f": {calls}"
        remedy = f"give the same functions{instead}" if self.task else f"leave out {given}"
        raise RunError(f"{self.path} was made with {made}\n  {remedy}")

    def other_code(self) -> str:
        """A warning if this code trains differently from the code of the run; else empty."""
        made, here = self.source.get("training"), version.training()
        if made in (None, here):
            return ""
        return (
            f"{self.path} was made by code that trains otherwise (training {made}, "
            f"{version.commit_of(self.source)}; here training {here}): it may end in other bits "
            "than a run that never stopped; to avoid that, go on with that code, or train anew in "
            "another folder"
        )

    def close(self) -> None:
        """Release the lock."""
        if self._held is not None:
            self._held.close()
            self._held = None

    def __enter__(self) -> "RunFolder":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _write_identity(self) -> None:
        manifest = {
            "controller": self.controller,
            "seed": self.seed,
            "settings_digest": self.digest,
            "lanewise": version.__version__,
            **self.source,
            **({"task_functions": list(self.task)} if self.task else {}),
            **({"compiler": list(self.compiler)} if self.compiler else {}),
            "created": datetime.now(UTC).isoformat(timespec="seconds"),
        }
        contents = {
            "settings.toml": config.dump_toml(self.settings).encode(),
            "run.json": safe_io.document(FORMAT, VERSION, manifest),
        }
        write_atomically(self.held, contents)


def compiler_switches() -> tuple[str, ...]:
    """Compiler switches set now that change rounding, as they are written; mostly none.

    They hold for a whole process, so `system.pinned` cannot set them aside: a run remembers them.
    """
    given = os.environ.get("XLA_FLAGS", "").split()
    found = [f"XLA_FLAGS={flag}" for flag in given if any(name in flag for name in _ROUNDING)]
    if os.environ.get(_UNOPTIMISED, "0").lower() in ("1", "y", "yes", "t", "true", "on"):
        found.append(f"{_UNOPTIMISED}=1")
    return tuple(sorted(found))


def open_high_level(
    source: Path, controller: str, settings: Settings, task: tuple[str, ...] = ()
) -> RunFolder:
    """The run whose step 1 is to be taken over by one with such settings and task functions.

    Raises:
        RunError: the controller has no step 1, or the run none that is finished; or the two high
            levels differ in shape or in what they observe, or in task functions.
    """
    if controller not in WITH_STEP_1:
        names = " and ".join(WITH_STEP_1)
        raise RunError(f"{controller} has no step 1 that could be taken over; only {names} have")
    lender = RunFolder.open(source)
    if not os.path.lexists(lender.stages / f"{STEP_1.name}.json"):
        raise RunError(f"{source} has no finished {STEP_1.name}: it cannot lend its high level")
    lender.check_parts(task)
    try:
        validation.check_high_level(lender.settings, settings)
    except SettingsError as error:
        raise RunError(f"{source} {error}") from error
    return lender


def split(path: Path) -> tuple[Path, Path | None]:
    """(the run folder that ``path`` names, the checkpoint or stage within it that it names).

    Weights are named by either of their two files, or without an ending.
    """
    place = path.with_suffix("") if path.suffix in (".json", ".safetensors") else path
    run, stored = place.parent, None
    if run.name in (CHECKPOINTS, STAGES):
        run, stored = run.parent, Path(run.name, place.name)
    elif place.name != CONTROLLER:
        return path, None
    return (run, stored) if (run / "run.json").is_file() and not path.is_dir() else (path, None)


def require_outside(path: Path) -> None:
    """Raise a RunError for a place inside a run, whose files nobody else writes."""
    for folder in path.absolute().parent.resolve().joinpath(path.name).parents:
        try:
            manifest = safe_io.read_bytes(folder / "run.json", _LARGEST_MANIFEST)
        except safe_io.UnreadableError:
            continue
        # A damaged run counts too.
        if f'"{FORMAT}"'.encode() in manifest:
            raise RunError(f"{path} belongs to the run in {folder}; choose another place")


def require_empty(path: Path) -> None:
    """Raise a RunError for a folder that holds anything, or lies inside a run."""
    require_outside(path)
    if not path.exists() and not path.is_symlink():
        return
    if not path.is_dir():
        raise RunError(f"{path} is not a folder")
    if (path / "run.json").exists():
        raise RunError(
            f"{path} holds a run already; --resume continues it, or choose another folder"
        )
    names = set(os.listdir(path))
    # A kill while the run was being made leaves both; settings alone are the user's own.
    half_made = {"settings.toml"} if "run.json" + PARTIAL in names else set()
    if any(not name.endswith(PARTIAL) for name in names - half_made):
        raise RunError(f"{path} is not empty and holds no run; choose another folder")


def _name_of(path: Path | OpenFolder) -> Path:
    return path.path if isinstance(path, OpenFolder) else path


def _read_manifest(file: Path) -> dict[str, Any]:
    if file.parent.is_file():
        raise RunError(f"{file.parent} is a file; give a run folder, or a checkpoint in one")
    if not file.is_file():
        below = sorted(path.parent for path in file.parent.glob("runs/*/*/run.json"))
        hint = f"its runs are {', '.join(map(str, below[:3]))}{', …' * (len(below) > 3)}"
        raise RunError(f"no run in {file.parent}: {hint if below else f'looked for {file}'}")
    manifest = safe_io.read_document(file, FORMAT, VERSION, _LARGEST_MANIFEST)
    if manifest["controller"] not in TRAINABLE:
        raise RunError(f'{file} trains an unknown controller, "{brief(manifest["controller"])}"')
    return manifest


def _read_settings(file: Path, digest: str) -> Settings:
    data = safe_io.read_bytes(file, LARGEST_SETTINGS, links=False)
    if hashlib.sha256(data).hexdigest() != digest:
        raise RunError(f"{file} was altered after the run was made")
    try:
        return config.compose(file=file, data=data)
    except SettingsError as error:
        raise RunError(str(error)) from error
