"""Graph functions evaluated over any algebra: symbols of SymPy or CasADi, traced arrays of JAX, intervals."""

from __future__ import annotations

import operator
from collections.abc import Callable, Mapping, Sequence
from typing import Any

from steelyard.errors import InputError
from steelyard.graph import Function
from steelyard.graph.expression import reachable

__all__ = ["evaluate_over"]

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
        What ``"sin"``, ``"cos"``, ``"sign"`` and ``"sqrt"`` are.
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
    operations = {**_ARITHMETIC, **unary}
    values: dict[int, Any] = {}
    for node in reachable(function.nodes):
        if node.operation == "constant":
            values[node.index] = constant(float(node.value))
        elif node.operation == "input":
            key = str(node.value)
            if key not in inputs:
                raise InputError(f"function {function.name!r} reads {key}, which is no argument of it; add one.")
            values[node.index] = inputs[key]
        else:
            values[node.index] = operations[node.operation](*(values[a.index] for a in node.arguments))
    return tuple([values[node.index] for node in output.nodes] for output in function.outputs)
