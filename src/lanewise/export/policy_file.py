"""Exported policies where a run is expected: what a file says of itself. Imports no JAX."""

from dataclasses import dataclass
from pathlib import Path

from lanewise import config
from lanewise.config.settings import Settings
from lanewise.controllers.registry import TRAINABLE
from lanewise.errors import RunError
from lanewise.export import formats
from lanewise.export.numpy_policy import Policy
from lanewise.runs import pretrained
from lanewise.runs.run_folder import RunFolder

TOLD = {"controller": str, "seed": int, "settings": str, "settings_digest": str, "task": list}
"""What a file says of its controller's training."""


@dataclass(frozen=True)
class PolicyFile:
    """A controller in a file that ``lanewise export`` wrote."""

    path: Path
    settings: Settings
    """Of its run, except that goals are renewed as it was exported."""
    controller: str
    """Which controller."""
    seed: int
    """Of its run."""
    digest: str
    """Of its run's settings."""
    task: tuple[str, ...]
    """Names of the user's own functions it was trained with (`TaskFunctions.names`)."""
    policy: Policy
    """Who decides."""

    @classmethod
    def open(cls, path: Path) -> "PolicyFile":
        """Read a file.

        Raises:
            LanewiseError: it cannot be read, or is no policy of Lanewise.
        """
        policy = formats.read(path)
        about = policy.about
        told = all(isinstance(about.get(name), kind) for name, kind in TOLD.items())
        if not told or about["controller"] not in TRAINABLE:
            raise RunError(f"{path} does not say how its controller was trained; export it anew")
        return cls(
            path,
            config.compose(file=path, data=about["settings"].encode()),
            about["controller"],
            about["seed"],
            about["settings_digest"],
            tuple(map(str, about["task"])),
            policy,
        )


def is_policy_file(path: Path) -> bool:
    """Whether a path is to be read as an exported policy."""
    return path.suffix in (formats.NUMPY, formats.ONNX) and not path.is_dir()


def open_controller(path: Path) -> RunFolder | PolicyFile:
    """The exported policy or the run that a path names; see `pretrained.locate`."""
    if is_policy_file(path):
        return PolicyFile.open(path)
    place = pretrained.locate(path)
    if place.is_file():
        endings = " or ".join((formats.NUMPY, formats.ONNX))
        raise RunError(f"{path} is no run, no checkpoint of one, and no exported {endings}")
    return RunFolder.open(place)


def controller_name(path: Path) -> str:
    """Name of the controller that a path leads to, a reference driver too."""
    return pretrained.reference_name(path) or open_controller(path).controller
