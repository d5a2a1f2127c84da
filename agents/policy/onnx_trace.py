"""An array namespace that records instead of computing, so that one definition also becomes an ONNX graph.

The core is written over an array namespace ``xp`` (:mod:`envs.backend`). Called with a :class:`Graph` as ``xp`` and
:class:`Traced` values as arguments, its functions leave behind the list of operations that they would have done.
Nothing here needs the onnx package: a recorded :class:`Node` is plain data.
"""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

__all__ = ["Graph", "Node", "Traced"]


class Node(NamedTuple):
    """One operation of ONNX."""

    op: str
    """Name of the operator, such as ``Add``."""
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    attributes: tuple[tuple[str, Any], ...] = ()
    """Names and values."""


class Traced:
    """A value of a graph, known by its name; arithmetic and comparisons add operations to the graph.

    It has no truth value: a function that branches on its arguments cannot be traced and raises ``TypeError``.
    """

    __slots__ = ("graph", "name")

    def __init__(self, graph: "Graph", name: str) -> None:
        self.graph = graph
        self.name = name

    def __bool__(self) -> bool:
        """Refuse."""
        raise TypeError("a traced value has no truth value; write the choice with xp.where")

    def __neg__(self) -> "Traced":
        """Return -a."""
        return self.graph.apply("Neg", self)

    def __add__(self, other: "Operand") -> "Traced":
        """Return a + b."""
        return self.graph.apply("Add", self, other)

    def __radd__(self, other: float) -> "Traced":
        """Return b + a."""
        return self.graph.apply("Add", other, self)

    def __sub__(self, other: "Operand") -> "Traced":
        """Return a - b."""
        return self.graph.apply("Sub", self, other)

    def __rsub__(self, other: float) -> "Traced":
        """Return b - a."""
        return self.graph.apply("Sub", other, self)

    def __mul__(self, other: "Operand") -> "Traced":
        """Return a b."""
        return self.graph.apply("Mul", self, other)

    def __rmul__(self, other: float) -> "Traced":
        """Return b a."""
        return self.graph.apply("Mul", other, self)

    def __truediv__(self, other: "Operand") -> "Traced":
        """Return a / b."""
        return self.graph.apply("Div", self, other)

    def __rtruediv__(self, other: float) -> "Traced":
        """Return b / a."""
        return self.graph.apply("Div", other, self)

    def __lt__(self, other: "Operand") -> "Traced":
        """Return whether a < b."""
        return self.graph.apply("Less", self, other)

    def __gt__(self, other: "Operand") -> "Traced":
        """Return whether a > b."""
        return self.graph.apply("Greater", self, other)


Operand = Traced | float


class Graph:
    """A graph in the making, and the namespace ``xp`` of the functions that it records.

    Equal operations on equal values are recorded once. Constants are float32 scalars, as numpy makes Python's floats
    when they meet a float32 array.

    Attributes:
        nodes: in the order in which they were recorded, every one after those that it needs.
        tensors: constants by name, float32 arrays.
    """

    def __init__(self) -> None:
        self.nodes: list[Node] = []
        self.tensors: dict[str, np.ndarray] = {}
        self._known: dict[Any, tuple[Traced, ...]] = {}

    def value(self, name: str) -> Traced:
        """Return the value of a name, such as an input of the graph."""
        return Traced(self, name)

    def tensor(self, name: str, array: np.ndarray) -> Traced:
        """Add a constant under a name of its own."""
        self.tensors[name] = np.array(array, np.float32, order="C")
        return Traced(self, name)

    def apply(self, op: str, *operands: Operand, **attributes: Any) -> Traced:
        """Record an operation with one result."""
        return self.apply_many(op, operands, 1, **attributes)[0]

    def apply_many(self, op: str, operands: Sequence[Operand], count: int, **attributes: Any) -> tuple[Traced, ...]:
        """Record an operation with ``count`` results."""
        inputs = tuple(self._lifted(operand).name for operand in operands)
        named = tuple(sorted(attributes.items()))
        key = (op, inputs, count, named)
        if key not in self._known:
            first = len(self._known)
            outputs = tuple(f"{op.lower()}_{first}" + (f"_{i}" if count > 1 else "") for i in range(count))
            self.nodes.append(Node(op, inputs, outputs, named))
            self._known[key] = tuple(Traced(self, name) for name in outputs)
        return self._known[key]

    def rename(self, value: Traced, name: str) -> Traced:
        """Copy a value under a name of its own, such as an output of the graph."""
        self.nodes.append(Node("Identity", (value.name,), (name,)))
        return Traced(self, name)

    def sqrt(self, value: Operand) -> Traced:
        """Return the square root."""
        return self.apply("Sqrt", value)

    def abs(self, value: Operand) -> Traced:
        """Return the absolute value."""
        return self.apply("Abs", value)

    def minimum(self, a: Operand, b: Operand) -> Traced:
        """Return the smaller one."""
        return self.apply("Min", a, b)

    def maximum(self, a: Operand, b: Operand) -> Traced:
        """Return the larger one."""
        return self.apply("Max", a, b)

    def clip(self, value: Operand, low: float, high: float) -> Traced:
        """Return the value limited to ``[low, high]``; both limits are constants."""
        return self.apply("Clip", value, float(low), float(high))

    def row(self, values: np.ndarray) -> Traced:
        """Return constants ``[1, K]``, to meet a column ``[N, 1]``."""
        numbers = np.array(values, np.float32).reshape(1, -1)
        return self.tensor("row_" + "_".join(f"{number!s}" for number in numbers[0]), numbers)

    def columns(self, value: Traced, count: int) -> tuple[Traced, ...]:
        """Return the columns ``[N, 1]`` of a value ``[N, count]``."""
        return self.apply_many("Split", [value], count, axis=1)

    def where(self, condition: Traced, yes: Operand, no: Operand) -> Traced:
        """Return ``yes`` where the condition holds, else ``no``."""
        return self.apply("Where", condition, yes, no)

    def copysign(self, size: float, sign: Traced) -> Traced:
        """Return a constant with the sign of a value; a zero counts as positive, since ONNX cannot see its sign."""
        return self.where(sign < 0.0, -abs(size), abs(size))

    def _lifted(self, operand: Operand) -> Traced:
        """Return the operand as a value of the graph."""
        if isinstance(operand, Traced):
            return operand
        number = np.float32(operand)
        # The shortest text that reads back as the same float32.
        return self.tensor(f"constant_{number!s}", np.array(number))
