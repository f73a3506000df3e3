"""What the arrays of a file must be: names, types and shapes, and finite where they should be."""

import math
from collections.abc import Collection, Mapping
from typing import Any, Protocol

import numpy as np

from lanewise.errors import CheckpointError, brief

_LARGEST_HEADER = 1_000_000
"""What a safetensors file holds beside its arrays."""


class ArrayLike(Protocol):
    """What a template says about an array."""

    @property
    def shape(self) -> tuple[int, ...]:
        """Its shape."""

    @property
    def dtype(self) -> Any:
        """Its type."""


Template = Mapping[str, ArrayLike]


def check_declared(label: str, declared: Mapping[str, Any], wanted: Template) -> None:
    """Compares what the manifest declares with what the caller needs, before reading any data.

    Raises:
        CheckpointError: an array is missing, too many, or of another type or shape.
    """
    for name in (*wanted, *declared):
        if name not in declared:
            raise CheckpointError(f"{label} lacks {brief(name)}")
        if name not in wanted:
            raise CheckpointError(f"{label} holds {brief(name)}, which does not belong there")
        array = wanted[name]
        want = [np.dtype(array.dtype).name, *array.shape]
        if declared[name] != want:
            raise CheckpointError(
                f"{label}: {name} is {brief(str(declared[name]))}, expected {want}"
            )


def check_size(label: str, declared: int, wanted: Template) -> None:
    """Refuses a length in bytes that these arrays cannot have, before anything of it is read.

    Raises:
        CheckpointError: says so.
    """
    size = sum(math.prod(a.shape) * np.dtype(a.dtype).itemsize for a in wanted.values())
    if not size <= declared <= size + _LARGEST_HEADER:
        raise CheckpointError(f"{label}: {declared} bytes cannot be arrays of {size}")


def check_values(
    label: str,
    arrays: Mapping[str, np.ndarray],
    wanted: Template | None,
    nonfinite: Collection[str],
) -> None:
    """Refuses values that an array of its type should not have.

    Raises:
        CheckpointError: names the first array that holds some.
    """
    for name, array in arrays.items():
        if array.dtype == np.bool_ and array.size and array.view(np.uint8).max() > 1:
            raise CheckpointError(f"{label}: {brief(name)} holds truth values that are neither")
        if name in nonfinite or _is_finite(array):
            continue
        model = None if wanted is None else wanted[name]
        # A template of mere shapes says nothing about values; one of arrays does.
        if hasattr(model, "__array__") and not _is_finite(np.asarray(model)):
            continue
        raise CheckpointError(f"{label}: {brief(name)} holds numbers that are not finite")


def _is_finite(array: np.ndarray) -> bool:
    if not np.issubdtype(array.dtype, np.inexact):
        return True
    # One pass without a temporary array: sums of finite numbers can overflow, extremes cannot.
    return array.size == 0 or bool(np.isfinite(array.min()) and np.isfinite(array.max()))
