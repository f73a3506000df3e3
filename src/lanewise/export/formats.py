"""The files a policy can be exported to, by the ending of their name. Imports no JAX."""

import json
from pathlib import Path
from types import ModuleType

import numpy as np

from lanewise.errors import LanewiseError
from lanewise.export import numpy_policy
from lanewise.export.numpy_policy import Policy
from lanewise.system.extras import install, needed_for

NUMPY, ONNX = ".npz", ".onnx"


def check(path: Path, reading: bool) -> None:
    """Refuses a path to which no policy can be written, or ``reading`` it again is impossible."""
    if path.suffix not in (NUMPY, ONNX):
        raise LanewiseError(f"--out must end in {ONNX}, or in {NUMPY} for NumPy, got {path}")
    from lanewise.report import output_files

    output_files.check_writable(path, new=True)
    if path.suffix == ONNX:
        _onnx_models()
        if reading:
            with needed_for("checking an ONNX model", "pip install onnxruntime"):
                import onnxruntime  # noqa: F401


def save(policy: Policy, path: Path) -> None:
    """Write a policy."""
    if path.suffix == ONNX:
        _onnx_models().save(policy, path)
        return
    size = sum(array.nbytes for array in policy.arrays.values())
    if size > numpy_policy.LARGEST // 2:
        raise LanewiseError(f"{path}: its networks of {size} bytes are too large for the reader")
    from lanewise.report import output_files

    # NumPy stores a text as an array of characters, which is read without pickle.
    about = np.asarray(json.dumps(policy.about))
    with output_files.replacing(path) as beside:
        np.savez(beside, about=about, **policy.arrays)


def read(path: Path) -> Policy:
    """The policy in a file, whichever its format.

    Raises:
        LanewiseError: it cannot be read, or is no policy of Lanewise.
    """
    if path.suffix == ONNX:
        from lanewise.export.onnx_session import Session

        return Session(path)
    return load(path)


def load(path: Path) -> Policy:
    """The policy in a file for NumPy."""
    try:
        return numpy_policy.load(path)
    except numpy_policy.PolicyError as error:
        raise LanewiseError(str(error)) from error
    except OSError as error:
        raise LanewiseError(f"cannot read {path}: {error.strerror}") from error


def _onnx_models() -> ModuleType:
    with needed_for("exporting to ONNX", install("onnx")):
        from lanewise.export import onnx_model
    return onnx_model
