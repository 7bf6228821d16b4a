"""Functions: expression graphs with named arguments and outputs, and what each element is."""

from __future__ import annotations

import math
import operator
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from steelyard.errors import InputError
from steelyard.once import cached_property

from .expression import Node, evaluate, interpret, operation_count

__all__ = ["Argument", "Function", "Output", "evaluate_over"]


_IDENTIFIER = re.compile(r"[A-Za-z][A-Za-z0-9_]*")


@dataclass(frozen=True)
class Argument:
    """A row of inputs that a function reads.

    Attributes
    ----------
    name : str
        An identifier; the input nodes are called ``name[0]`` to ``name[width - 1]``.
    width : int
    uniform : bool
        True where all the samples of a batch share one row (parameters), False where each has its own (positions).
    description : str
        What it is, any text.
    elements : tuple of str
        What each element is, with its unit, any text; empty or one for each element.

    Examples
    --------
    >>> Argument("q", 2, elements=("position of shoulder, rad", "position of elbow, rad")).width
    2
    """

    name: str
    width: int
    uniform: bool = False
    description: str = ""
    elements: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        _check(self.name, self.elements, self.width)


@dataclass(frozen=True, eq=False)
class Output:
    """An array that a function computes.

    Attributes
    ----------
    name : str
        An identifier.
    shape : tuple of int
        () for a number, (n,) for a vector, (rows, columns) for a matrix, and so on.
    nodes : tuple of Node
        The elements in row-major order.
    description : str
        What it is, with its unit and frame, any text.
    """

    name: str
    shape: tuple[int, ...]
    nodes: tuple[Node, ...]
    description: str = ""

    def __post_init__(self) -> None:
        _check(self.name, (), len(self.nodes))
        if math.prod(self.shape) != len(self.nodes):
            raise InputError(f"output {self.name!r} of shape {self.shape} has {len(self.nodes)} elements.")

    @property
    def size(self) -> int:
        """Number of elements."""
        return len(self.nodes)


@dataclass(frozen=True, eq=False)
class Function:
    """An expression graph with named arguments and outputs: what is compiled, printed and differentiated.

    Attributes
    ----------
    name : str
        An identifier.
    arguments : tuple of Argument
    outputs : tuple of Output
        At least one.
    description : str
        What it computes, any text.

    Examples
    --------
    >>> from steelyard.graph import Graph, sin
    >>> x = Graph().inputs("x", 2)
    >>> function = Function("f", (Argument("x", 2),), (Output("y", (), (sin(x[0]) * x[1],)),))
    >>> function.operation_count["mul"], float(function.evaluate({"x": [0.0, 1.0]})["y"])
    (1, 0.0)
    """

    name: str
    arguments: tuple[Argument, ...]
    outputs: tuple[Output, ...]
    description: str = ""

    def __post_init__(self) -> None:
        names = [a.name for a in self.arguments] + [o.name for o in self.outputs]
        if len(set(names)) < len(names):
            raise InputError(f"function {self.name!r} uses a name twice: {', '.join(names)}.")
        if not self.outputs:
            raise InputError(f"function {self.name!r} has no outputs.")

    def __repr__(self) -> str:
        inputs = ", ".join(f"{a.name}[{a.width}]" for a in self.arguments)
        outputs = ", ".join(f"{o.name}{list(o.shape)}" for o in self.outputs)
        return f"Function({self.name}: {inputs} -> {outputs})"

    @property
    def nodes(self) -> tuple[Node, ...]:
        """The elements of all the outputs, one output after the other."""
        return tuple(node for output in self.outputs for node in output.nodes)

    @cached_property
    def operation_count(self) -> dict[str, int]:
        """Operations of one sample, see :func:`steelyard.graph.operation_count`."""
        return operation_count(self.nodes)

    def evaluate(self, values: Mapping[str, ArrayLike]) -> dict[str, NDArray[np.float64]]:
        """Interpret the graph with NumPy, without a compiler.

        Parameters
        ----------
        values : mapping
            For each argument an array (..., width); complex numbers are allowed.

        Returns
        -------
        dict
            For each output an array (..., *shape).
        """
        scalars: dict[str, ArrayLike] = {}
        shape: tuple[int, ...] = ()
        for argument in self.arguments:
            array = np.asarray(values[argument.name])
            if array.ndim == 0 or array.shape[-1] != argument.width:
                raise InputError(f"{argument.name} must have shape (..., {argument.width}), got {array.shape}.")
            shape = np.broadcast_shapes(shape, array.shape[:-1])
            scalars |= {f"{argument.name}[{k}]": array[..., k] for k in range(argument.width)}
        flat = iter(evaluate(self.nodes, scalars))
        result = {}
        for output in self.outputs:
            columns = [np.broadcast_to(next(flat), shape) for _ in output.nodes]
            result[output.name] = np.stack(columns, axis=-1).reshape(shape + output.shape)
        return result


def _check(name: str, elements: tuple[str, ...], count: int) -> None:
    if not _IDENTIFIER.fullmatch(name):
        raise InputError(f"a name of letters, digits and _ was expected, got {name!r}.")
    if elements and len(elements) != count:
        raise InputError(f"{name!r} has {count} elements, but {len(elements)} descriptions.")


_ARITHMETIC: Mapping[str, Callable[..., Any]] = {
    "add": operator.add,
    "sub": operator.sub,
    "mul": operator.mul,
    "div": operator.truediv,
    "neg": operator.neg,
}


def evaluate_over(
    function: Function,
    elements: Mapping[str, Sequence[Any]],
    unary: Mapping[str, Callable[[Any], Any]],
    constant: Callable[[float], Any] = float,
) -> tuple[list[Any], ...]:
    """Evaluate a function with elements of any type that has ``+ - * /``.

    Each node is evaluated once, in the order of the graph, without recursion.

    Parameters
    ----------
    function : Function
    elements : mapping
        For each argument its `width` elements.
    unary : mapping
        What ``"sin"``, ``"cos"``, ``"sign"``, ``"sqrt"``, ``"exp"`` and ``"log"`` are.
    constant : callable
        From a float to the algebra's own number.

    Returns
    -------
    tuple of list
        For each output its elements in row-major order.

    Raises
    ------
    InputError
        Where an argument is missing or has another number of elements, or where the function reads what is no
        argument of it.

    Examples
    --------
    >>> from fractions import Fraction
    >>> from steelyard.graph import Argument, Graph, Output
    >>> a, b = Graph().inputs("x", 2)
    >>> f = Function("f", (Argument("x", 2),), (Output("y", (), (a / b + 1.0,)),))
    >>> evaluate_over(f, {"x": (Fraction(1), Fraction(3))}, {}, Fraction)
    ([Fraction(4, 3)],)
    """
    inputs: dict[str, Any] = {}
    for argument in function.arguments:
        given = elements.get(argument.name, ())
        if len(given) != argument.width:
            raise InputError(
                f"the argument {argument.name!r} of {function.name!r} has {argument.width} elements, got {len(given)}."
            )
        inputs |= {f"{argument.name}[{k}]": value for k, value in enumerate(given)}

    def value_of(name: str) -> Any:
        if name not in inputs:
            raise InputError(f"function {function.name!r} reads {name}, which is no argument of it; add one.")
        return inputs[name]

    values = interpret(function.nodes, value_of, {**_ARITHMETIC, **unary}, constant)
    return tuple([values[node.index] for node in output.nodes] for output in function.outputs)
