"""Records NumPy arithmetic as an ONNX graph: calls on a `Value` become nodes.

NumPy hands every function and operator over to its arguments' own class where they have one
(``__array_ufunc__``, NEP 13; ``__array_function__``, NEP 18). So code that was written for arrays
draws its own graph, and what it computes from arrays alone becomes a constant.
"""

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.lib.mixins import NDArrayOperatorsMixin
from numpy.typing import NDArray
from onnx import NodeProto, TensorProto, helper, numpy_helper

SAME: dict[Any, str] = {
    np.add: "Add",
    np.subtract: "Sub",
    np.multiply: "Mul",
    np.divide: "Div",
    np.matmul: "MatMul",
    np.cos: "Cos",
    np.sin: "Sin",
    np.sqrt: "Sqrt",
    np.rint: "Round",
    np.absolute: "Abs",
    np.negative: "Neg",
    np.maximum: "Max",
    np.minimum: "Min",
}
"""Functions whose result has the type of their operands."""
BOOLEAN: dict[Any, str] = {
    np.less: "Less",
    np.less_equal: "LessOrEqual",
    np.equal: "Equal",
    np.isinf: "IsInf",
    np.greater: "Greater",
    np.greater_equal: "GreaterOrEqual",
    np.bitwise_and: "And",
    np.bitwise_or: "Or",
    np.invert: "Not",
}
"""Functions whose result is a truth value."""


class Graph:
    """Nodes and constants as they come up."""

    def __init__(self) -> None:
        self.nodes: list[NodeProto] = []
        """In an order in which they can be computed."""
        self.constants: list[TensorProto] = []
        """Arrays that do not depend on inputs."""
        self._known: dict[tuple[Any, ...], str] = {}

    def add(
        self, operator: str, inputs: Sequence[str], dtype: Any, output: str = "", **attributes: Any
    ) -> "Value":
        """A node with one output of type ``dtype``, by default with a name of its own."""
        output = output or f"{operator.lower()}_{len(self.nodes)}"
        self.nodes.append(helper.make_node(operator, list(inputs), [output], **attributes))
        return Value(self, output, np.dtype(dtype))

    def named(self, operand: Any, dtype: Any) -> str:
        """The name under which an operand is found in the graph, as type ``dtype``."""
        if not isinstance(operand, Value):
            return self._constant(np.asarray(operand, dtype))
        if operand.dtype == dtype:
            return operand.name
        kind = helper.np_dtype_to_tensor_dtype(np.dtype(dtype))
        return self.add("Cast", [operand.name], dtype, to=kind).name

    def _constant(self, array: NDArray[Any]) -> str:
        key = (array.dtype.str, array.shape, array.tobytes())
        if key not in self._known:
            self._known[key] = f"constant_{len(self.constants)}"
            self.constants.append(numpy_helper.from_array(array, self._known[key]))
        return self._known[key]


class Value(NDArrayOperatorsMixin):
    """The result of a node, or an input; stands where an array would."""

    def __init__(self, graph: Graph, name: str, dtype: Any) -> None:
        self.graph = graph
        self.name = name
        self.dtype = np.dtype(dtype)

    def __array_ufunc__(self, ufunc: Any, method: str, *operands: Any, **options: Any) -> Any:
        """A node for a function of elements, or for an operator."""
        if method != "__call__" or options:
            return NotImplemented
        if ufunc is np.square:
            return self * self
        if ufunc is np.not_equal:
            return ~(operands[0] == operands[1])
        operator = SAME.get(ufunc) or BOOLEAN.get(ufunc)
        if operator is None:
            return NotImplemented
        dtype = _common(operands)
        names = [self.graph.named(operand, dtype) for operand in operands]
        return self.graph.add(operator, names, np.bool_ if ufunc in BOOLEAN else dtype)

    def __array_function__(self, function: Any, types: Any, args: Any, kwargs: Any) -> Any:
        """Nodes for the functions of `FUNCTIONS`."""
        if function not in FUNCTIONS:
            return NotImplemented
        return FUNCTIONS[function](self.graph, *args, **kwargs)

    def astype(self, dtype: Any) -> "Value":
        """As another type."""
        return Value(self.graph, self.graph.named(self, dtype), dtype)


def _common(operands: Sequence[Any]) -> Any:
    """The type that NumPy would compute in; plain numbers adapt to arrays."""
    return np.result_type(*(getattr(operand, "dtype", operand) for operand in operands))


def _where(graph: Graph, condition: Any, yes: Any, no: Any) -> Value:
    dtype = _common([yes, no])
    names = [graph.named(condition, np.bool_), graph.named(yes, dtype), graph.named(no, dtype)]
    return graph.add("Where", names, dtype)


def _with_axes(operator: str, **attributes: Any) -> Callable[..., Value]:
    """A function whose axis is its second input."""

    def record(graph: Graph, array: Value, axis: int) -> Value:
        names = [array.name, graph.named([axis], np.int64)]
        return graph.add(operator, names, array.dtype, **attributes)

    return record


def _position(operator: str) -> Callable[..., Value]:
    """The place of an extreme, the first of equals."""

    def record(graph: Graph, array: Value, axis: int) -> Value:
        return graph.add(operator, [array.name], np.int64, axis=axis, keepdims=0)

    return record


def _concatenate(graph: Graph, arrays: Sequence[Any], axis: int) -> Value:
    dtype = _common(arrays)
    names = [graph.named(array, dtype) for array in arrays]
    return graph.add("Concat", names, dtype, axis=axis)


def _stack(graph: Graph, arrays: Sequence[Any], axis: int) -> Value:
    return _concatenate(graph, [np.expand_dims(array, axis) for array in arrays], axis)


def _take_along_axis(graph: Graph, array: Any, indices: Value, axis: int) -> Value:
    names = [graph.named(array, array.dtype), indices.name]
    return graph.add("GatherElements", names, array.dtype, axis=axis)


FUNCTIONS: dict[Any, Callable[..., Value]] = {
    np.where: _where,
    np.expand_dims: _with_axes("Unsqueeze"),
    np.squeeze: _with_axes("Squeeze"),
    np.sum: _with_axes("ReduceSum", keepdims=0),
    np.argmax: _position("ArgMax"),
    np.argmin: _position("ArgMin"),
    np.concatenate: _concatenate,
    np.stack: _stack,
    np.take_along_axis: _take_along_axis,
    np.zeros_like: lambda graph, array: array & ~array,
}
"""Functions of whole arrays; zeros only of truth values."""
