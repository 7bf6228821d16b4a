"""Graph functions as SymPy expressions."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Mapping, Sequence
from typing import Any

from steelyard.errors import InputError
from steelyard.graph import Argument, Function, Node
from steelyard.graph.expression import reachable

from .symbolic_function import SymbolicFunction
from .symbols import exact_number, import_sympy, intermediate_prefix, substitution

__all__ = ["sympy_function"]

_LARGEST_INLINE = 24  # operations of an expression beyond which it gets a name, so that nothing is nested deeply
_NAMED = re.compile(r"([A-Za-z][A-Za-z0-9_]*)(?:: | = )")
_LENGTH = re.compile(r"length ([A-Za-z][A-Za-z0-9_]*), m$")
_AXES = {"gravity": ("gx", "gy", "gz"), "point": ("px", "py", "pz")}


def sympy_function(
    function: Function, *, closed: bool = True, substitute: Mapping[Any, Any] | None = None
) -> SymbolicFunction:
    """Return a graph function as SymPy expressions.

    Constants that are whole numbers become integers, those that are dyadic fractions with a denominator of at most
    1024 (0.5, 0.125) become rationals, and all others floats of the same 53 bits, so that 9.81 stays what the
    computer knows of it.

    Parameters
    ----------
    function : Function
    closed : bool
        Single expressions; False keeps intermediate variables, which is fast for any robot.
    substitute : mapping, optional
        Numbers, SymPy expressions or texts such as ``"m2*c"`` for symbols by name; zeros vanish before
        expressions grow.

    Returns
    -------
    SymbolicFunction

    Raises
    ------
    InputError
        If a name to substitute does not exist, or a closed expression would be too long to be of use.
    MissingExtraError
        If SymPy is not installed.

    Examples
    --------
    >>> from steelyard.graph import Argument, Graph, Output, sin
    >>> q = Graph().inputs("q", 2)
    >>> f = Function("f", (Argument("q", 2),), (Output("height", (), (0.5 * sin(q[0]) * q[1],)),))
    >>> sympy_function(f).outputs["height"]
    q2*sin(q1)/2
    >>> sympy_function(f, substitute={"q2": 4}).outputs["height"]
    2*sin(q1)
    """
    sympy = import_sympy()
    arguments = {
        a.name: tuple(sympy.Symbol(n, real=True) for n in names)
        for a, names in zip(function.arguments, _names(function.arguments), strict=True)
    }
    values, remaining = substitution(substitute or {}, arguments)
    inputs = {
        f"{name}[{k}]": values.get(symbol, symbol) for name, row in arguments.items() for k, symbol in enumerate(row)
    }
    taken = {symbol.name for value in inputs.values() for symbol in value.free_symbols}
    assignments, elements = _expressions(function, inputs, intermediate_prefix(taken), sympy)
    outputs: dict[str, Any] = {}
    for output in function.outputs:
        row = [elements[node.index] for node in output.nodes]
        if len(output.shape) == 0:
            outputs[output.name] = row[0]
        elif len(output.shape) <= 2:
            rows, columns = (*output.shape, 1)[:2]
            outputs[output.name] = sympy.ImmutableMatrix(rows, columns, row)
        else:
            outputs[output.name] = sympy.ImmutableDenseNDimArray(row, output.shape)
    result = SymbolicFunction(function.name, remaining, tuple(assignments), outputs)
    return result.closed() if closed else result.pruned()


def _names(arguments: Sequence[Argument]) -> list[tuple[str, ...]]:
    """Return the names of the elements of all the arguments, no two of them equal."""
    taken: set[str] = set()
    result = []
    for argument in arguments:
        names, stem = _own_names(argument), argument.name
        while taken & set(names) or len(set(names)) < len(names):
            names = tuple(f"{stem}{k + 1}" for k in range(argument.width))
            stem += "_"
        taken |= set(names)
        result.append(names)
    return result


def _own_names(argument: Argument) -> tuple[str, ...]:
    if argument.name in _AXES and argument.width == 3:
        return _AXES[argument.name]
    pattern = _LENGTH if argument.name == "lengths" else _NAMED
    if argument.name in ("parameters", "base_parameters", "lengths"):
        found = [match[1] for text in argument.elements if (match := pattern.match(text))]
        if len(found) == argument.width:
            return tuple(found)
    return tuple(f"{argument.name}{k + 1}" for k in range(argument.width))


def _expressions(
    function: Function, inputs: Mapping[str, Any], prefix: str, sympy: Any
) -> tuple[list[tuple[Any, Any]], dict[int, Any]]:
    """Walk the graph once; what is used more than once, or grows long, gets a name."""
    nodes = reachable(function.nodes)
    uses = Counter(argument.index for node in nodes for argument in node.arguments)
    results: dict[int, Any] = {}
    sizes: dict[int, int] = {}
    assignments: list[tuple[Any, Any]] = []
    for node in nodes:
        value = _value(node, results, inputs, function.name, sympy)
        size = 1 + sum(sizes[a.index] for a in node.arguments)
        if value.is_Atom or (-value).is_Atom:
            size = 0
        elif uses[node.index] and (uses[node.index] > 1 or size > _LARGEST_INLINE):
            symbol = sympy.Symbol(f"{prefix}{len(assignments) + 1}", real=True)
            assignments.append((symbol, value))
            value, size = symbol, 0
        results[node.index], sizes[node.index] = value, size
    return assignments, results


def _value(node: Node, results: Mapping[int, Any], inputs: Mapping[str, Any], name: str, sympy: Any) -> Any:
    if node.operation == "constant":
        return exact_number(float(node.value))
    if node.operation == "input":
        if node.value not in inputs:
            raise InputError(f"function {name!r} reads {node.value}, which is no argument of it; add one.")
        return inputs[str(node.value)]
    first, *rest = (results[a.index] for a in node.arguments)
    match node.operation:
        case "add":
            return first + rest[0]
        case "sub":
            return first - rest[0]
        case "mul":
            return first * rest[0]
        case "div":
            if rest[0].is_zero:
                raise InputError(f"function {name!r} divides by 0 with these numbers; substitute others.")
            return first / rest[0]
        case "neg":
            return -first
    return getattr(sympy, node.operation)(first)
