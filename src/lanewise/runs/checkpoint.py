"""Arrays on disk: NAME.safetensors with the numbers, NAME.json with what belongs to them.

Used for checkpoints and for trained controllers. Neither format can carry code. A file is loaded
only if its digest is the manifest's, its arrays have the names, types and shapes that the run's
settings demand, and its floats are finite. The digests find damage; they do not tell who wrote a
file.
"""

import hashlib
import math
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

from lanewise.errors import CheckpointError, LanewiseError, brief
from lanewise.runs import pytree_io
from lanewise.system import safe_io
from lanewise.system.folder_io import PARTIAL, OpenFolder, write_atomically

FORMAT = "lanewise-arrays"
VERSION = 1
_DIGEST = "manifest_sha256"
"""Field of a manifest with its own digest."""
_LARGEST_MANIFEST = 300_000
_LARGEST_FILE = 16 * 1024**3
_LARGEST_HEADER = 1_000_000
"""Bytes of a safetensors file beside its arrays."""
_FILE = re.compile(rf"stage-[0-9]{{2}}-chunk-[0-9]{{8}}\.(json|safetensors)({re.escape(PARTIAL)})?")
"""Files of a checkpoint, named as by `checkpoint_name`."""


@dataclass(frozen=True)
class Checkpoint:
    """What was stored under a name."""

    name: str
    """Its name."""
    tree: Any
    """The arrays, in the structure of the template; by name where there was none."""
    meta: dict[str, Any]
    """What the writer added: stage, counters, length of the metrics."""


def checkpoint_name(stage: int, chunk: int) -> str:
    """A name that sorts by time: stages follow one another, chunks count up within a stage."""
    return f"{stage_prefix(stage)}chunk-{chunk:08d}"


def stage_prefix(stage: int) -> str:
    """How the names of a stage's checkpoints begin."""
    return f"stage-{stage:02d}-"


def pack(tree: Any) -> bytes:
    """A pytree of arrays and random keys as a safetensors file."""
    # safetensors stores memory as it lies: it must be row by row, in this machine's byte order.
    arrays = {key: np.array(value, order="C") for key, value in pytree_io.flatten(tree).items()}
    return bytes(save_safetensors(arrays))


def stage_index(name: str) -> int:
    """The number of the stage that a checkpoint's name begins with."""
    return int(name.split("-")[1])


def save(
    folder: OpenFolder,
    name: str,
    tree: Any,
    meta: Mapping[str, Any],
    settings_digest: str,
    keep: int | None = None,
    unusable: Collection[str] = (),
) -> None:
    """Store a pytree of arrays and random keys, and anything JSON can hold as ``meta``.

    Both files are complete on disk before either gets its name. Afterwards follows a `prune`,
    unless ``keep`` is None.
    """
    data = pack(tree)
    manifest = {
        "name": name,
        "sha256": hashlib.sha256(data).hexdigest(),
        "settings_digest": settings_digest,
        "meta": dict(meta),
    }
    text = safe_io.document(FORMAT, VERSION, manifest, _DIGEST)
    write_atomically(folder, {f"{name}.safetensors": data, f"{name}.json": text})
    if keep is not None:
        prune(folder, keep, set(unusable) - {name})


def load(
    directory: Path, name: str, template: Any = None, settings_digest: str | None = None
) -> Checkpoint:
    """Load what `save` stored.

    The stored tree must equal a ``template`` of arrays or shapes in structure, types and shapes,
    and belong to the settings with the digest; None takes any.

    Raises:
        UnreadableError: a file is missing, a link, too large, or the manifest is damaged.
        CheckpointError: the arrays are damaged, of other settings, or differ from the template.
    """
    manifest = read_manifest(directory, name, settings_digest)
    path = directory / f"{name}.safetensors"
    largest = _LARGEST_FILE if template is None else _size(template) + _LARGEST_HEADER
    data = safe_io.read_bytes(path, largest, links=False)
    if hashlib.sha256(data).hexdigest() != manifest["sha256"]:
        raise CheckpointError(f"{path} was truncated or altered: its digest is not the manifest's")
    try:
        arrays = load_safetensors(data)
    except (SafetensorError, ValueError, KeyError) as error:
        raise CheckpointError(f"{path} is not a safetensors file") from error
    for key, array in arrays.items():
        if not _is_finite(array):
            raise CheckpointError(f"{path}: {brief(key)} holds numbers that are not finite")
    if template is None:
        return Checkpoint(name, arrays, manifest["meta"])
    try:
        return Checkpoint(name, pytree_io.unflatten(template, arrays), manifest["meta"])
    except CheckpointError as error:
        raise CheckpointError(f"{path}: {error}") from error


def read_manifest(directory: Path, name: str, settings_digest: str | None = None) -> dict[str, Any]:
    """What `save` wrote beside the arrays; reads none of them, and raises as `load`."""
    path = directory / f"{name}.json"
    manifest = safe_io.read_document(path, FORMAT, VERSION, _LARGEST_MANIFEST, _DIGEST)
    if manifest["name"] != name:
        raise CheckpointError(f"{path} belongs to {brief(manifest['name'])}")
    if settings_digest is not None and manifest["settings_digest"] != settings_digest:
        raise CheckpointError(f"{directory / name}.safetensors was made with other settings")
    return manifest


def names(directory: Path) -> list[str]:
    """Names of the checkpoints in a directory, oldest first; other files do not count."""
    found = os.listdir(directory) if directory.is_dir() else ()
    return [path.stem for path in _files(found) if path.suffix == ".json"]


def newest_valid(
    directory: Path,
    template: Any = None,
    settings_digest: str | None = None,
    prefix: str = "",
    accept: Callable[[dict[str, Any]], object] = lambda meta: None,
) -> tuple[Checkpoint | None, dict[str, str]]:
    """The newest checkpoint that can be used, if there is one, and why newer ones cannot, by name.

    Only names with the prefix count. ``accept`` raises an error for the ``meta`` of a checkpoint
    that cannot be used; the rest is as for `load`.

    Raises:
        CheckpointError: there are checkpoints, but none can be used.
    """
    problems: dict[str, str] = {}
    for name in reversed([name for name in names(directory) if name.startswith(prefix)]):
        try:
            accept(read_manifest(directory, name, settings_digest)["meta"])
            return load(directory, name, template, settings_digest), problems
        except LanewiseError as error:
            problems[name] = str(error)
    if problems:
        newest = next(iter(problems.values()))
        raise CheckpointError(f"no checkpoint can be used; the newest: {newest}")
    return None, {}


def prune(folder: OpenFolder, keep: int, unusable: Collection[str] = ()) -> None:
    """Delete all but the ``keep`` newest checkpoints, and no other file."""
    folder.require_same()
    with os.scandir(folder.descriptor) as entries:
        files = _files(e.name for e in entries if not e.is_dir(follow_symlinks=False))
    manifests = [path for path in files if path.suffix == ".json"]
    every = [path.stem for path in manifests if path.stem not in unusable]
    kept = every[max(0, len(every) - keep) :]
    # Of each the manifest goes first, so that no half is ever offered. With them goes what a kill
    # has left half written or half deleted; the lock on the run keeps other writers out.
    for path in files:
        if path.suffix == PARTIAL or path.stem not in kept:
            folder.unlink(path.name)


def _files(found: Iterable[str]) -> list[Path]:
    """Names of checkpoint files, oldest first and each manifest before its data."""
    return sorted(Path(name) for name in found if _FILE.fullmatch(name))


def _size(template: Any) -> int:
    """Bytes of the arrays of a template."""
    every = pytree_io.shapes(template).values()
    return sum(math.prod(each.shape) * np.dtype(each.dtype).itemsize for each in every)


def _is_finite(array: np.ndarray) -> bool:
    if not np.issubdtype(array.dtype, np.inexact):
        return True
    # One pass without a temporary array: sums of finite numbers can overflow, extremes cannot.
    return array.size == 0 or bool(np.isfinite(array.min()) and np.isfinite(array.max()))
