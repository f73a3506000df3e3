"""Trained controllers as files that run without Lanewise: ONNX, and NumPy alone."""

from types import ModuleType

from lanewise.system.extras import install, needed_for


def onnx_models() -> ModuleType:
    """The module that writes ONNX models, imported only where it is wanted.

    Raises:
        LanewiseError: onnx is not installed.
    """
    with needed_for("exporting to ONNX", install("onnx")):
        from lanewise.export import onnx_model
    return onnx_model


def onnx_runtime() -> ModuleType:
    """The package onnxruntime, with which a written model is checked.

    Raises:
        LanewiseError: it is not installed.
    """
    with needed_for("checking an ONNX model", "pip install onnxruntime"):
        import onnxruntime
    return onnxruntime  # type: ignore[no-any-return]
