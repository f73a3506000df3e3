"""Trained controllers as files that run without Lanewise: ONNX, and NumPy alone."""

from collections.abc import Iterator
from contextlib import contextmanager
from types import ModuleType

from lanewise.errors import LanewiseError


def onnx_models() -> ModuleType:
    """The module that writes ONNX models, imported only where it is wanted.

    Raises:
        LanewiseError: onnx is not installed.
    """
    with _needed("exporting to ONNX needs its package", '"lanewise[onnx]"'):
        from lanewise.export import onnx_model
    return onnx_model


def onnx_runtime() -> ModuleType:
    """The package onnxruntime, with which a written model is checked.

    Raises:
        LanewiseError: it is not installed.
    """
    with _needed("checking an ONNX model needs onnxruntime", "onnxruntime"):
        import onnxruntime
    return onnxruntime  # type: ignore[no-any-return]


@contextmanager
def _needed(purpose: str, package: str) -> Iterator[None]:
    try:
        yield
    except ImportError as error:
        raise LanewiseError(f"{purpose}: pip install {package}") from error
