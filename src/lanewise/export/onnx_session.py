"""A written ONNX model, run by onnxruntime."""

from pathlib import Path
from typing import Any

from lanewise.errors import LanewiseError, brief
from lanewise.export import numpy_policy
from lanewise.export.numpy_policy import FORMAT, LARGEST, VERSION, Ego, Memory, Policy
from lanewise.system import safe_io
from lanewise.system.extras import needed_for

FEATURES, NEXT, VALUES = "features", "next_", "_values"
"""Input; prefix of the outputs that the next decision takes as its memory; ending of Q-values."""
QUIET = 4
"""Level of onnxruntime's log: what is fatal. Its errors are raised as well."""


class Session(Policy):
    """A policy whose decision an ONNX model computes; its arrays are in the model."""

    def __init__(self, path: Path) -> None:
        """Read a model.

        Raises:
            LanewiseError: it cannot be read, is no policy of Lanewise, or onnxruntime is missing.
        """
        with needed_for("an ONNX model", "pip install onnxruntime"):
            import onnxruntime

        data = safe_io.read_bytes(path, LARGEST)
        options = onnxruntime.SessionOptions()
        options.log_severity_level = QUIET
        try:
            self._session = onnxruntime.InferenceSession(
                data, options, providers=["CPUExecutionProvider"]
            )
            told = self._session.get_modelmeta().custom_metadata_map["about"]
            super().__init__(safe_io.parse_json(told.encode()), {})
            self._outputs = [output.name for output in self._session.get_outputs()]
            if not (other := safe_io.format_mismatch(self.about, FORMAT, VERSION)):
                numpy_policy.decide_once(self)
        except Exception as error:  # a damaged file can raise nearly anything
            reason = f"it lacks {error}" if isinstance(error, KeyError) else str(error)
            if "protobuf" in reason:
                reason = "no ONNX model"
            raise LanewiseError(
                f"{path} is no policy of Lanewise, or a damaged one: {brief(reason)}"
            ) from error
        if other:
            raise LanewiseError(f"{path} {other}")

    @property
    def feature_count(self) -> int:
        """Number of features that it observes."""
        return int(self._session.get_inputs()[0].shape[1])

    def step(
        self, features: Any, ego: Ego | None, memory: Memory
    ) -> tuple[Any, Memory, dict[str, Any]]:
        """As `Policy.step`."""
        inputs = {FEATURES: features} | (ego._asdict() if ego else {}) | memory
        found = dict(zip(self._outputs, self._session.run(None, inputs), strict=True))
        levels = [name.removesuffix(VALUES) for name in found if name.endswith(VALUES)]
        after = {name: found[NEXT + name] for name in memory}
        return found["action"], after, {level: found[level + VALUES] for level in levels}
