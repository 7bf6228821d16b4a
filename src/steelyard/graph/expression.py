"""The scalar expression graph: hash-consed nodes with exact folding while they are made.

Running an algorithm written over generic scalars with :class:`Node` arguments records it. Equal expressions become
one node, and multiplications by 0, 1 and -1 vanish, so that the recorded program holds only the work that a robot
needs. Folding never reorders sums or products, so a value changes by no more than rounding.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

__all__ = [
    "Graph",
    "Node",
    "cos",
    "evaluate",
    "exp",
    "interpret",
    "is_zero",
    "log",
    "operation_count",
    "reachable",
    "sign",
    "sin",
    "sqrt",
]


class Node:
    """One value of an expression graph: an input, a constant, or an operation on other nodes.

    Nodes are made by a :class:`Graph` and by arithmetic on nodes; two equal nodes of a graph are the same object.

    Attributes
    ----------
    graph : Graph
    index : int
        Order of creation; the arguments of a node have smaller indices.
    operation : str
        ``"input"``, ``"constant"``, ``"add"``, ``"sub"``, ``"mul"``, ``"div"``, ``"neg"``, ``"sin"``, ``"cos"``,
        ``"sign"``, ``"sqrt"``, ``"exp"`` or ``"log"``.
    arguments : tuple of Node
    value : float or str
        The number of a constant, the name of an input, otherwise ``""``.
    """

    __slots__ = ("arguments", "graph", "index", "operation", "value")

    def __init__(
        self, graph: Graph, index: int, operation: str, arguments: tuple[Node, ...], value: float | str
    ) -> None:
        self.graph = graph
        self.index = index
        self.operation = operation
        self.arguments = arguments
        self.value = value

    def __add__(self, other: Node | float) -> Node:
        return self.graph.add(self, self.graph.node(other))

    def __radd__(self, other: float) -> Node:
        return self.graph.add(self.graph.node(other), self)

    def __sub__(self, other: Node | float) -> Node:
        return self.graph.sub(self, self.graph.node(other))

    def __rsub__(self, other: float) -> Node:
        return self.graph.sub(self.graph.node(other), self)

    def __mul__(self, other: Node | float) -> Node:
        return self.graph.mul(self, self.graph.node(other))

    def __rmul__(self, other: float) -> Node:
        return self.graph.mul(self.graph.node(other), self)

    def __truediv__(self, other: Node | float) -> Node:
        return self.graph.div(self, self.graph.node(other))

    def __rtruediv__(self, other: float) -> Node:
        return self.graph.div(self.graph.node(other), self)

    def __neg__(self) -> Node:
        return self.graph.neg(self)

    def __repr__(self) -> str:
        if self.operation in ("input", "constant"):
            return f"Node({self.value})"
        return f"Node({self.operation} of {', '.join(str(a.index) for a in self.arguments)})"


class Graph:
    """Makes nodes and keeps them unique.

    Examples
    --------
    >>> graph = Graph()
    >>> x, y = graph.input("x"), graph.input("y")
    >>> x * y is y * x
    True
    >>> (x + 0.0 * y) is x
    True
    """

    def __init__(self) -> None:
        self.nodes: list[Node] = []
        self._known: dict[tuple[Any, ...], Node] = {}
        self.zero = self.constant(0.0)
        self.one = self.constant(1.0)

    def __len__(self) -> int:
        return len(self.nodes)

    def __repr__(self) -> str:
        return f"Graph({len(self.nodes)} nodes)"

    def input(self, name: str) -> Node:
        """Return the input with this name, made at the first call."""
        return self._make(("input", name), "input", (), name)

    def inputs(self, name: str, count: int) -> list[Node]:
        """Return the inputs ``name[0]`` to ``name[count - 1]``."""
        return [self.input(f"{name}[{i}]") for i in range(count)]

    def constant(self, value: float) -> Node:
        """Return the constant with this value; -0.0 is the same as 0.0."""
        number = float(value) + 0.0
        return self._make(("constant", number), "constant", (), number)

    def node(self, value: Node | float) -> Node:
        """Return `value` itself where it is a node, otherwise the constant that it is."""
        return value if isinstance(value, Node) else self.constant(value)

    def add(self, a: Node, b: Node) -> Node:
        """Return ``a + b``."""
        if a is self.zero:
            return b
        if b is self.zero:
            return a
        if a.operation == "constant" and b.operation == "constant":
            return self.constant(_number(a) + _number(b))
        if a.operation == "neg":
            if b.operation == "neg":
                return self.neg(self.add(a.arguments[0], b.arguments[0]))
            return self.sub(b, a.arguments[0])
        if b.operation == "neg":
            return self.sub(a, b.arguments[0])
        if a is b:
            return self.mul(self.constant(2.0), a)
        for x, y in ((a, b), (b, a)):  # x + (z - x)
            if y.operation == "sub" and y.arguments[1] is x:
                return y.arguments[0]
        if a.index > b.index:
            a, b = b, a
        return self._make(("add", a.index, b.index), "add", (a, b))

    def sub(self, a: Node, b: Node) -> Node:
        """Return ``a - b``."""
        if b is self.zero:
            return a
        if a is self.zero:
            return self.neg(b)
        if a is b:
            return self.zero
        if a.operation == "constant" and b.operation == "constant":
            return self.constant(_number(a) - _number(b))
        if b.operation == "neg":
            return self.add(a, b.arguments[0])
        if a.operation == "neg":
            return self.neg(self.add(a.arguments[0], b))
        if a.operation == "add" and b in a.arguments:  # (b + z) - b
            return a.arguments[a.arguments[0] is b]
        if a.operation == "sub" and a.arguments[0] is b:  # (b - z) - b
            return self.neg(a.arguments[1])
        if b.operation == "add" and a in b.arguments:  # a - (a + z)
            return self.neg(b.arguments[b.arguments[0] is a])
        if b.operation == "sub" and b.arguments[0] is a:  # a - (a - z)
            return b.arguments[1]
        reverse = self._known.get(("sub", b.index, a.index))
        if reverse is not None:
            return self.neg(reverse)
        return self._make(("sub", a.index, b.index), "sub", (a, b))

    def mul(self, a: Node, b: Node) -> Node:
        """Return ``a * b``."""
        if a.index > b.index:
            a, b = b, a
        if b.operation == "constant":
            a, b = b, a
        if a.operation == "constant":
            factor = _number(a)
            if factor == 0.0:
                return self.zero
            if factor == 1.0:
                return b
            if factor == -1.0:
                return self.neg(b)
            if b.operation == "constant":
                return self.constant(factor * _number(b))
            if factor < 0.0:
                return self.neg(self.mul(self.constant(-factor), b))
        if a.operation == "neg":
            return self.neg(self.mul(a.arguments[0], b))
        if b.operation == "neg":
            return self.neg(self.mul(a, b.arguments[0]))
        return self._make(("mul", a.index, b.index), "mul", (a, b))

    def div(self, a: Node, b: Node) -> Node:
        """Return ``a / b``; b must not be the constant 0."""
        if b.operation == "constant":
            divisor = _number(b)
            if divisor == 0.0:
                raise ZeroDivisionError("an expression is divided by the constant 0")
            if a.operation == "constant":
                return self.constant(_number(a) / divisor)
            if math.frexp(divisor)[0] in (0.5, -0.5):  # a power of two, whose reciprocal is exact
                return self.mul(self.constant(1.0 / divisor), a)
            if divisor < 0.0:
                return self.neg(self.div(a, self.constant(-divisor)))
        if a is self.zero:
            return a
        if a is b:
            return self.one
        if a.operation == "neg":
            return self.neg(self.div(a.arguments[0], b))
        if b.operation == "neg":
            return self.neg(self.div(a, b.arguments[0]))
        return self._make(("div", a.index, b.index), "div", (a, b))

    def neg(self, a: Node) -> Node:
        """Return ``-a``."""
        if a.operation == "neg":
            return a.arguments[0]
        if a.operation == "constant":
            return self.constant(-_number(a))
        return self._make(("neg", a.index), "neg", (a,))

    def function(self, name: str, a: Node) -> Node:
        """Return a function of a node by its name; a root or logarithm of a negative constant is an error."""
        if a.operation == "constant":
            number = _number(a)
            value = float(np.sign(number)) if name == "sign" else getattr(math, name)(number)
            return self.constant(value)
        if a.operation == "neg" and name in ("sin", "cos", "sign"):
            inner = self.function(name, a.arguments[0])
            return inner if name == "cos" else self.neg(inner)
        return self._make((name, a.index), name, (a,))

    def _make(self, key: tuple[Any, ...], operation: str, arguments: tuple[Node, ...], value: float | str = "") -> Node:
        found = self._known.get(key)
        if found is None:
            found = Node(self, len(self.nodes), operation, arguments, value)
            self.nodes.append(found)
            self._known[key] = found
        return found


def _number(node: Node) -> float:
    return node.value  # type: ignore[return-value]


def is_zero(value: Any) -> bool:
    """Tell whether a scalar is the constant 0."""
    if isinstance(value, Node):
        return value is value.graph.zero
    return isinstance(value, float) and value == 0.0


def sin(a: Node) -> Node:
    """Return the sine of a node."""
    return a.graph.function("sin", a)


def cos(a: Node) -> Node:
    """Return the cosine of a node."""
    return a.graph.function("cos", a)


def sign(a: Node) -> Node:
    """Return the sign of a node: -1, 0 or 1."""
    return a.graph.function("sign", a)


def sqrt(a: Node) -> Node:
    """Return the square root of a node."""
    return a.graph.function("sqrt", a)


def exp(a: Node) -> Node:
    """Return the exponential of a node."""
    return a.graph.function("exp", a)


def log(a: Node) -> Node:
    """Return the natural logarithm of a node."""
    return a.graph.function("log", a)


def reachable(outputs: Iterable[Node]) -> list[Node]:
    """Return the nodes that the outputs need, arguments before their users."""
    seen: dict[int, Node] = {}
    stack = list(outputs)
    while stack:
        node = stack.pop()
        if node.index not in seen:
            seen[node.index] = node
            stack.extend(node.arguments)
    return [seen[index] for index in sorted(seen)]


def operation_count(outputs: Iterable[Node]) -> dict[str, int]:
    """Count the operations that computing all the outputs takes.

    Returns
    -------
    dict
        ``"mul"``, ``"add"`` (with subtractions), ``"div"``, ``"neg"``, ``"sin"``, ``"cos"``, ``"sign"``, ``"sqrt"``,
        ``"exp"`` and ``"log"``.

    Examples
    --------
    >>> graph = Graph()
    >>> x, y = graph.input("x"), graph.input("y")
    >>> operation_count([x * y + x, x * y])["mul"]
    1
    """
    count = dict.fromkeys(("mul", "add", "div", "neg", "sin", "cos", "sign", "sqrt", "exp", "log"), 0)
    for node in reachable(outputs):
        if node.operation in ("add", "sub"):
            count["add"] += 1
        elif node.operation in count:
            count[node.operation] += 1
    return count


def evaluate(outputs: Sequence[Node], values: Mapping[str, Any]) -> list[NDArray[Any]]:
    """Interpret the graph with NumPy, without a compiler.

    Parameters
    ----------
    outputs : sequence of Node
    values : mapping
        Number or array (of one common shape) for every input name; complex numbers are allowed, and the sign is that
        of the real part, so that derivatives can be taken by complex steps.
    """
    operations: dict[str, Callable[..., Any]] = {
        "add": np.add,
        "sub": np.subtract,
        "mul": np.multiply,
        "div": np.divide,
        "neg": np.negative,
        "sin": np.sin,
        "cos": np.cos,
        "sign": _real_sign,
        "sqrt": np.sqrt,
        "exp": np.exp,
        "log": np.log,
    }
    results = interpret(outputs, values.__getitem__, operations, float)
    return [_array(results[node.index]) for node in outputs]


def interpret(
    outputs: Sequence[Node],
    value_of: Callable[[str], Any],
    operations: Mapping[str, Callable[..., Any]],
    constant: Callable[[float], Any],
) -> dict[int, Any]:
    """Return the value of every node that the outputs need, by its index, over any algebra.

    Each node is evaluated once, in the order of the graph, without recursion.

    Parameters
    ----------
    value_of : callable
        From the name of an input to its value.
    operations : mapping
        What ``"add"``, ``"sub"``, ``"mul"``, ``"div"``, ``"neg"``, ``"sin"``, ``"cos"``, ``"sign"``, ``"sqrt"``,
        ``"exp"`` and ``"log"`` are.
    constant : callable
        From a float to the algebra's own number.
    """
    results: dict[int, Any] = {}
    for node in reachable(outputs):
        name, arguments = node.operation, node.arguments
        if len(arguments) == 2:  # most of them
            first, second = arguments
            results[node.index] = operations[name](results[first.index], results[second.index])
        elif arguments:
            results[node.index] = operations[name](results[arguments[0].index])
        elif name == "constant":
            results[node.index] = constant(float(node.value))
        else:
            results[node.index] = value_of(str(node.value))
    return results


def _real_sign(value: Any) -> Any:
    return np.sign(np.real(value))


def _array(value: Any) -> NDArray[Any]:
    array = np.asarray(value)
    return array if np.iscomplexobj(array) else np.asarray(array, dtype=np.float64)
