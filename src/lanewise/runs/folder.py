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
    DIR/diverged/         what there is of a training whose numbers went wrong
    DIR/controller.*      the trained controller

The process that writes holds a lock on the folder itself.
Imports no JAX.
"""

import hashlib
import json
import os
from collections.abc import Mapping
from dataclasses import dataclass, field
from datetime import UTC, datetime
from pathlib import Path
from types import TracebackType
from typing import Any

from lanewise import config, cores, reading, version
from lanewise.config import validation
from lanewise.config.settings import Settings
from lanewise.controllers.registry import TRAINABLE
from lanewise.errors import RunError, SettingsError, brief
from lanewise.fields.ranges import SEEDS
from lanewise.runs import lock
from lanewise.runs.compiler import switches
from lanewise.runs.files import PARTIAL, OpenFolder, write_atomically

FORMAT = "lanewise-run"
VERSION = 2
LARGEST_SEED = int(SEEDS.high)
_LARGEST_MANIFEST = 100_000
LARGEST_SETTINGS = 100_000
"""Bytes of a file with every setting."""
_FILES = (
    *("run.json", "settings.toml", "metrics.jsonl", "timings.jsonl"),
    *("episodes.csv", "chunks.csv"),
)
CHECKPOINTS, STAGES = "checkpoints", "stages"
_FOLDERS = (CHECKPOINTS, STAGES, "tensorboard", "diverged")
_FIELDS = {
    *("format", "version", "controller", "seed", "settings_digest", "lanewise", "parts"),
    *("compiler", "created", "digest", *version.SOURCE),
}
"""Of run.json. Older folders lack its own digest, or which code made them."""


@dataclass
class RunFolder:
    """A run on disk. ``create`` and ``resume`` hold its lock until ``close``; ``open`` reads."""

    path: Path
    """The folder."""
    settings: Settings
    """Every setting the run was made with."""
    controller: str
    """What is trained: a name in `lanewise.controllers.registry.TRAINABLE`."""
    seed: int
    """Seed of everything random."""
    digest: str
    """Of the settings file; every file of the run carries it. The file's and not the settings', so
    that a later version with one setting more still reads the run."""
    parts: tuple[str, ...] = ()
    """Names of the user's own functions it is trained with (`driving.parts.Parts.names`)."""
    compiler: tuple[str, ...] = ()
    """Switches of the compiler it was made with (`compiler.switches`)."""
    source: Mapping[str, Any] = field(default_factory=dict)
    """The code it was made with (`version.source`); empty in older runs."""
    _held: OpenFolder | None = field(default=None, repr=False)

    @classmethod
    def create(
        cls,
        path: Path | OpenFolder,
        settings: Settings,
        controller: str,
        seed: int,
        parts: tuple[str, ...] = (),
        observed: int = validation.FEATURES,
    ) -> "RunFolder":
        """Makes a run in a new or empty folder and locks it.

        Args:
            path: the folder, made with its parents if it is missing; or an open one.
            settings: all of them.
            controller: what is trained.
            seed: of everything random.
            parts: names of the user's own functions.
            observed: how many numbers a controller observes.

        Raises:
            RunError: The folder holds something already, or another process is making a run in it,
                or the seed is none.
            SettingsError: The machine has not the memory for what they ask.
        """
        validation.check_memory(settings, controller, cores.memory(), observed)
        name = _name_of(path)
        require_empty(name)
        if type(seed) is not int or not 0 <= seed <= LARGEST_SEED:
            raise RunError(f"seed must be a whole number from 0 to {LARGEST_SEED}")
        if isinstance(path, Path):
            path.mkdir(parents=True, exist_ok=True)
        held = lock.acquire(path, "training")
        digest = config.digest(settings)
        folder = cls(name, settings, controller, seed, digest, parts, switches(), _held=held)
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
        """Reads a run, without locking it.

        Raises:
            RunError: There is no run, or its files are damaged, or something in it leads elsewhere.
        """
        _check_names(path)
        manifest = _read_manifest(path)
        settings = _read_settings(path, manifest)
        digest = manifest["settings_digest"]
        parts, compiler = (tuple(manifest.get(name, ())) for name in ("parts", "compiler"))
        source = version.remembered(manifest)
        controller, seed = manifest["controller"], manifest["seed"]
        return cls(path, settings, controller, seed, digest, parts, compiler, source)

    @classmethod
    def resume(
        cls,
        path: Path | OpenFolder,
        settings: Settings | None = None,
        controller: str | None = None,
        seed: int | None = None,
    ) -> "RunFolder":
        """Opens a run to continue it, and locks it. What is None is taken from the run.

        Raises:
            RunError: There is no run, another process holds it, or it was made with another
                controller, seed, settings or switches of the compiler.
        """
        folder = cls.open(_name_of(path))
        if controller is not None and controller != folder.controller:
            raise RunError(f"{folder.path} trains {folder.controller}, not {controller}")
        if seed is not None and seed != folder.seed:
            raise RunError(f"{folder.path} was made with seed {folder.seed}, not {seed}")
        difference = config.first_difference(folder.settings, settings or folder.settings)
        if difference:
            raise RunError(
                f"{folder.path} was made with other settings: there {difference}\n"
                "  --resume without any settings takes those of the run"
            )
        if folder.compiler != switches():
            made, now = (", ".join(given) or "none" for given in (folder.compiler, switches()))
            raise RunError(
                f"{folder.path} was made with other switches of the compiler: there {made}, "
                f"here {now}\n  it would go on to other bits; set them as they were"
            )
        folder._held = lock.acquire(path, "training")
        return folder

    @property
    def held(self) -> OpenFolder:
        """The folder itself, to be written into; only of a run that was created or resumed."""
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
        return stages_of(self.path)

    @property
    def timings(self) -> Path:
        """The file of wall-clock times."""
        return self.path / "timings.jsonl"

    def check_parts(self, parts: tuple[str, ...]) -> None:
        """Refuses to go on with other functions than the run was made with, as names can tell.

        Raises:
            RunError: Says which it was made with.
        """
        if self.parts == parts:
            return
        made = "; ".join(self.parts) or "no parts of the user's own"
        remedy = (
            "give the same functions: lanewise.evaluate(run, parts=...), "
            "lanewise.train(..., parts=...)"
        )
        if not self.parts:
            remedy = f"leave out {'; '.join(parts)}"
        raise RunError(f"{self.path} was made with {made}\n  {remedy}")

    def other_code(self) -> str:
        """A warning if this code trains otherwise than that which made the run; else empty."""
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
        """Gives the lock back."""
        if self._held is not None:
            self._held.close()
            self._held = None

    def __enter__(self) -> "RunFolder":
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()

    def _write_identity(self) -> None:
        manifest = {
            "format": FORMAT,
            "version": VERSION,
            "controller": self.controller,
            "seed": self.seed,
            "settings_digest": self.digest,
            "lanewise": version.__version__,
            **self.source,
            **({"parts": list(self.parts)} if self.parts else {}),
            **({"compiler": list(self.compiler)} if self.compiler else {}),
            "created": datetime.now(UTC).isoformat(timespec="seconds"),
        }
        manifest["digest"] = reading.digest(manifest)
        contents = {
            "settings.toml": config.dump_toml(self.settings).encode(),
            "run.json": (json.dumps(manifest, indent=2) + "\n").encode(),
        }
        write_atomically(self.held, contents)


def _name_of(path: Path | OpenFolder) -> Path:
    return path.path if isinstance(path, OpenFolder) else path


def stages_of(path: Path) -> Path:
    """Where the finished stages of the run in a folder lie, once there are any."""
    return path / STAGES


def require_outside(path: Path) -> None:
    """Refuses a place inside a run, whose files nobody else writes.

    Raises:
        RunError: Names the run.
    """
    for folder in path.absolute().parent.resolve().joinpath(path.name).parents:
        try:
            manifest = reading.contents(folder / "run.json", _LARGEST_MANIFEST)
        except reading.UnreadableError:
            continue
        # Of a damaged run too.
        if f'"{FORMAT}"'.encode() in manifest:
            raise RunError(f"{path} belongs to the run in {folder}; choose another place")


def require_empty(path: Path) -> None:
    """Refuses a folder that holds anything, or lies inside a run.

    Raises:
        RunError: Says what it holds and what to do.
    """
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
    if any(not name.endswith(PARTIAL) for name in names - half_made - {lock.OLD}):
        raise RunError(f"{path} is not empty and holds no run; choose another folder")


def _check_names(path: Path) -> None:
    """Refuses a run whose files are links and such: whoever continues it writes to them.

    Raises:
        RunError: Names the first.
    """
    for name in (*_FILES, *_FOLDERS):
        try:
            reading.require_plain(path / name, folder=name in _FOLDERS)
        except reading.UnreadableError as error:
            raise RunError(f"{path / name}: {error}") from error


def _read_manifest(path: Path) -> dict[str, Any]:
    file = path / "run.json"
    if not file.is_file():
        raise RunError(f"no run in {path}: looked for {file}")
    try:
        manifest = reading.json_value(reading.contents(file, _LARGEST_MANIFEST, links=False))
    except reading.UnreadableError as error:
        raise RunError(f"{file} is damaged: {error}") from error
    except ValueError as error:
        raise RunError(f"{file} is damaged: not valid JSON") from error
    if not isinstance(manifest, dict) or "format" not in manifest:
        raise RunError(f"{file} does not describe a run")
    if other := reading.other_format(manifest, FORMAT, VERSION):
        raise RunError(f"{file} {other}")
    _check_identity(file, manifest)
    return manifest


def _check_identity(file: Path, manifest: dict[str, Any]) -> None:
    seed = manifest.get("seed")
    if manifest.get("controller") not in TRAINABLE or type(seed) is not int:
        raise RunError(f"{file} is damaged: no controller or seed")
    if not 0 <= seed <= LARGEST_SEED:
        raise RunError(f"{file} is damaged: seed must be from 0 to {LARGEST_SEED}")
    for name in ("parts", "compiler"):
        given = manifest.get(name, [])
        if not isinstance(given, list) or not all(isinstance(each, str) for each in given):
            raise RunError(f"{file} is damaged: {name} holds no names")
    try:
        version.remembered(manifest)
    except ValueError as error:
        raise RunError(f"{file} is damaged: {error}") from error
    if unknown := manifest.keys() - _FIELDS:
        raise RunError(f'{file} is damaged: it has no field "{brief(min(unknown))}"')
    if "digest" in manifest and manifest["digest"] != reading.digest(manifest):
        raise RunError(f"{file} was altered: its digest is not its own")


def _read_settings(path: Path, manifest: dict[str, Any]) -> Settings:
    file = path / "settings.toml"
    try:
        data = reading.contents(file, LARGEST_SETTINGS, links=False)
        settings = config.compose(file=file, data=data)
    except reading.UnreadableError as error:
        raise RunError(f"cannot read settings file {file}: {error}") from error
    except SettingsError as error:
        raise RunError(str(error)) from error
    if hashlib.sha256(data).hexdigest() != manifest.get("settings_digest"):
        raise RunError(f"{file} was altered after the run was made")
    return settings
