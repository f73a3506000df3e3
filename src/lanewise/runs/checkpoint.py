"""Arrays on disk: NAME.safetensors with the numbers, NAME.json with what they must be.

Used for checkpoints and for trained controllers. Neither format can carry code. A file is loaded
only when its length, SHA-256 digest, names, types and shapes are what the manifest and the
caller's template say, and its floats are finite. The digests tell damage, not who wrote a file:
whoever alters one can make them right again, so nothing is believed for having the right digest.
"""

import hashlib
import json
import os
import re
from collections.abc import Callable, Collection, Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from safetensors import SafetensorError
from safetensors.numpy import load as load_safetensors
from safetensors.numpy import save as save_safetensors

from lanewise.errors import CheckpointError, brief
from lanewise.runs import templates
from lanewise.runs.files import PARTIAL, OpenFolder, opened, write_atomically
from lanewise.runs.templates import Template
from lanewise.system import safe_io

FORMAT = "lanewise-arrays"
VERSION = 1
_LARGEST_MANIFEST = 300_000
_LARGEST_FILE = 16 * 1024**3
_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9._-]{0,120}")


@dataclass(frozen=True)
class Checkpoint:
    """What was stored under a name."""

    name: str
    """Its name."""
    arrays: dict[str, np.ndarray]
    """The arrays by name."""
    meta: dict[str, Any]
    """What the writer wanted remembered: stage, chunk, counters, length of the metrics."""


def checkpoint_name(stage: int, chunk: int) -> str:
    """A name that sorts by time: stages follow one another, chunks count up within a stage."""
    return f"{stage_prefix(stage)}chunk-{chunk:08d}"


def stage_prefix(stage: int) -> str:
    """How the names of a stage's checkpoints begin."""
    return f"stage-{stage:02d}-"


_FILE = re.compile(rf"stage-[0-9]{{2}}-chunk-[0-9]{{8}}\.(json|safetensors)({re.escape(PARTIAL)})?")
"""Files of a checkpoint, under a name as `checkpoint_name` makes them."""


def save(
    directory: Path | OpenFolder,
    name: str,
    arrays: Mapping[str, np.ndarray],
    meta: Mapping[str, Any],
    settings_digest: str,
    keep: int | None = None,
    unusable: Collection[str] = (),
) -> None:
    """Stores arrays under a name; both files are complete on disk before either gets its name.

    Args:
        directory: Where. One that is only named is made if it is missing.
        name: File name without ending. For checkpoints, names must sort by time.
        arrays: Arrays by name.
        meta: Anything JSON can hold.
        settings_digest: Digest of the settings they belong to.
        keep: Afterwards, `prune` all but this many checkpoints; None keeps all.
        unusable: Names of checkpoints that are known not to be.

    Raises:
        RunError: An open directory is no longer where it was; nothing is written.
        OSError: The disk is full or not writable; what was stored before is unchanged.
    """
    _check_name(name)
    if isinstance(directory, Path):
        directory.mkdir(parents=True, exist_ok=True)
    # safetensors stores memory as it lies: it must be row by row, in this machine's byte order.
    packed = {key: np.array(value, order="C") for key, value in arrays.items()}
    data = save_safetensors(packed)
    manifest = {
        "format": FORMAT,
        "version": VERSION,
        "name": name,
        "sha256": hashlib.sha256(data).hexdigest(),
        "bytes": len(data),
        "settings_digest": settings_digest,
        "meta": dict(meta),
        "arrays": {key: [value.dtype.name, *value.shape] for key, value in packed.items()},
    }
    manifest["manifest_sha256"] = _digest_of(manifest)
    text = json.dumps(manifest, indent=1, allow_nan=False) + "\n"
    write_atomically(directory, {f"{name}.safetensors": data, f"{name}.json": text.encode()})
    if keep is not None:
        prune(directory, keep, set(unusable) - {name})


def load(
    directory: Path,
    name: str,
    template: Template | Callable[[dict[str, Any]], Template] | None = None,
    settings_digest: str | None = None,
    nonfinite: Collection[str] = (),
) -> Checkpoint:
    """Loads what ``save`` stored, or says what is wrong with it.

    Args:
        directory: Where.
        name: File name without ending.
        template: What the arrays must be by name, or a function that tells it from the meta. An
            array that is not finite in the template may be so in the file.
        settings_digest: Digest of the settings they must belong to; None for any.
        nonfinite: Names of further arrays that may hold nan or infinities.

    Raises:
        CheckpointError: A file is missing, a link, too large, truncated, altered, of other
            settings, or not what the template wants.
    """
    manifest = _manifest_of(directory, name, settings_digest)
    label = str(directory / f"{name}.safetensors")
    wanted = _template_of(label, manifest["meta"], template)
    if wanted is not None:
        templates.check_declared(label, manifest["arrays"], wanted)
        templates.check_size(label, manifest["bytes"], wanted)
    arrays = _read_arrays(directory / f"{name}.safetensors", manifest)
    templates.check_values(label, arrays, wanted, nonfinite)
    return Checkpoint(name, arrays, manifest["meta"])


def _template_of(
    label: str,
    meta: dict[str, Any],
    template: Template | Callable[[dict[str, Any]], Template] | None,
) -> Template | None:
    if not callable(template):
        return template
    try:
        return template(meta)
    except CheckpointError as error:
        raise CheckpointError(f"{label}: {error}") from error


def read_meta(directory: Path, name: str, settings_digest: str | None = None) -> dict[str, Any]:
    """What was to be remembered with the arrays stored under a name; reads none of them.

    Raises:
        CheckpointError: The manifest is missing, damaged, altered, or of other settings.
    """
    meta: dict[str, Any] = _manifest_of(directory, name, settings_digest)["meta"]
    return meta


def read_digest(directory: Path, name: str) -> str:
    """SHA-256 of the file with the arrays, as its manifest has it.

    Raises:
        CheckpointError: As `read_meta`.
    """
    return str(_manifest_of(directory, name, None)["sha256"])


def names(directory: Path) -> list[str]:
    """The names of the checkpoints in a directory, oldest first; other files there are none."""
    found = os.listdir(directory) if directory.is_dir() else ()
    return [path.stem for path in _files(found) if path.suffix == ".json"]


def newest_valid(
    directory: Path,
    template: Template | Callable[[dict[str, Any]], Template] | None = None,
    settings_digest: str | None = None,
    nonfinite: Collection[str] = (),
) -> tuple[Checkpoint | None, str]:
    """Loads the newest checkpoint that is whole, and a warning about newer ones that are not.

    Returns:
        The checkpoint, or None where none was ever stored; and a warning, often empty.

    Raises:
        CheckpointError: There are checkpoints, but none is whole.
    """
    problems: list[str] = []
    for name in reversed(names(directory)):
        try:
            found = load(directory, name, template, settings_digest, nonfinite)
        except CheckpointError as error:
            problems.append(str(error))
        else:
            warning = f"{problems[0]}; continuing from {name}" if problems else ""
            return found, warning
    if problems:
        raise CheckpointError(f"no checkpoint can be used; the newest: {problems[0]}")
    return None, ""


def _check_name(name: str) -> None:
    if not _NAME.fullmatch(name):
        raise CheckpointError(f'"{brief(name)}" is no name for a checkpoint')


def prune(directory: Path | OpenFolder, keep: int, unusable: Collection[str] = ()) -> None:
    """Deletes checkpoints, but the newest, and no file that is none of theirs.

    Args:
        directory: Where.
        keep: So many of the newest stay.
        unusable: Names of some that do not count and go too.

    Raises:
        RunError: An open directory is no longer where it was; nothing is deleted.
    """
    with opened(directory) as folder:
        with os.scandir(folder.descriptor) as entries:
            files = _files(e.name for e in entries if not e.is_dir(follow_symlinks=False))
        manifests = [path for path in files if path.suffix == ".json"]
        every = [path.stem for path in manifests if path.stem not in unusable]
        kept = every[max(0, len(every) - keep) :]
        # Of each the manifest goes first, so that no half is ever offered. With them goes what a
        # kill has left half written or half deleted; the lock on the run keeps other writers out.
        for path in files:
            if path.suffix == PARTIAL or path.stem not in kept:
                folder.unlink(path.name)


def _files(found: Iterable[str]) -> list[Path]:
    """What is named as a file of a checkpoint, oldest first and each manifest before its data."""
    return sorted(Path(name) for name in found if _FILE.fullmatch(name))


def _read_file(path: Path, largest: int) -> bytes:
    try:
        return safe_io.read_bytes(path, largest, links=False)
    except safe_io.UnreadableError as error:
        if not os.path.lexists(path):
            raise CheckpointError(f"{path} is missing") from None
        raise CheckpointError(f"cannot read {path}: {error}") from error


def _manifest_of(directory: Path, name: str, settings_digest: str | None) -> dict[str, Any]:
    _check_name(name)
    manifest = _read_manifest(directory / f"{name}.json")
    label = str(directory / f"{name}.safetensors")
    if manifest["name"] != name:
        raise CheckpointError(f"{label}: its manifest belongs to {brief(manifest['name'])}")
    if settings_digest is not None and manifest["settings_digest"] != settings_digest:
        raise CheckpointError(f"{label} was made with other settings")
    return manifest


def _read_manifest(path: Path) -> dict[str, Any]:
    try:
        manifest = safe_io.parse_json(_read_file(path, _LARGEST_MANIFEST))
    except ValueError as error:
        raise CheckpointError(f"{path} is damaged: not valid JSON") from error
    if not isinstance(manifest, dict) or "format" not in manifest:
        raise CheckpointError(f"{path} is not a manifest of lanewise")
    if other := safe_io.format_mismatch(manifest, FORMAT, VERSION):
        raise CheckpointError(f"{path} {other}")
    fields = {"name": str, "sha256": str, "bytes": int, "settings_digest": str, "meta": dict}
    for name, kind in (fields | {"arrays": dict}).items():
        if type(manifest.get(name)) is not kind:
            raise CheckpointError(f"{path} is damaged: {name} is missing")
    if manifest.get("manifest_sha256") != _digest_of(manifest):
        raise CheckpointError(f"{path} was altered: its digest is not its own")
    return manifest


def _digest_of(manifest: Mapping[str, Any]) -> str:
    return safe_io.digest(manifest, "manifest_sha256")


def _read_arrays(path: Path, manifest: Mapping[str, Any]) -> dict[str, np.ndarray]:
    expected = manifest["bytes"]
    # No more is read than there should be, whatever the file says of its length.
    data = _read_file(path, min(expected, _LARGEST_FILE))
    if len(data) != expected:
        raise CheckpointError(f"{path} is truncated or altered: {len(data)} of {expected} bytes")
    if hashlib.sha256(data).hexdigest() != manifest["sha256"]:
        raise CheckpointError(f"{path} was altered: its digest is not the manifest's")
    try:
        arrays: dict[str, np.ndarray] = load_safetensors(data)
    except (SafetensorError, ValueError, KeyError) as error:
        raise CheckpointError(f"{path} is not a safetensors file") from error
    listed = {name: [array.dtype.name, *array.shape] for name, array in arrays.items()}
    if listed != manifest["arrays"]:
        raise CheckpointError(f"{path} does not hold the arrays its manifest lists")
    return arrays
