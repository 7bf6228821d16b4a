"""Derivatives of expression graphs: graphs again, by forward or reverse accumulation."""

from __future__ import annotations

from collections.abc import Sequence

from .expression import Graph, Node, cos, reachable, sin

__all__ = ["gradient", "jacobian"]


def _local(node: Node) -> list[tuple[Node, Node | float]]:
    """Return the arguments of an operation, each with the derivative by it."""
    kind, arguments = node.operation, node.arguments
    a = arguments[0]
    if kind == "add":
        return [(a, 1.0), (arguments[1], 1.0)]
    if kind == "sub":
        return [(a, 1.0), (arguments[1], -1.0)]
    if kind == "mul":
        return [(a, arguments[1]), (arguments[1], a)]
    if kind == "div":
        inverse = 1.0 / arguments[1]
        return [(a, inverse), (arguments[1], -(node * inverse))]
    if kind == "neg":
        return [(a, -1.0)]
    if kind == "sin":
        return [(a, cos(a))]
    if kind == "cos":
        return [(a, -sin(a))]
    if kind == "sqrt":
        return [(a, 0.5 / node)]
    if kind == "exp":
        return [(a, node)]
    if kind == "log":
        return [(a, 1.0 / a)]
    return []  # the sign is taken as constant


def _graph(outputs: Sequence[Node], inputs: Sequence[Node]) -> Graph:
    nodes = [*outputs, *inputs]
    if not nodes:
        raise ValueError("at least one output or input is needed")
    return nodes[0].graph


def jacobian(outputs: Sequence[Node], inputs: Sequence[Node]) -> list[list[Node]]:
    """Differentiate outputs by inputs, forward: the choice for few inputs or sparse dependence.

    The derivative of the sign is 0 everywhere.

    Parameters
    ----------
    outputs : sequence of Node
    inputs : sequence of Node
        Input nodes of the same graph.

    Returns
    -------
    list of list of Node
        (outputs, inputs).

    Examples
    --------
    >>> from steelyard.graph import Graph, evaluate
    >>> x, y = Graph().inputs("x", 2)
    >>> rows = jacobian([x * y, x / y], [x, y])
    >>> [[float(v) for v in evaluate(row, {"x[0]": 3.0, "x[1]": 2.0})] for row in rows]
    [[2.0, 3.0], [0.5, -0.75]]
    """
    graph = _graph(outputs, inputs)
    tangents: dict[int, dict[int, Node]] = {node.index: {k: graph.one} for k, node in enumerate(inputs)}
    for node in reachable(outputs):
        if node.operation in ("input", "constant"):
            continue
        total: dict[int, Node] = {}
        for argument, slope in _local(node) if any(a.index in tangents for a in node.arguments) else []:
            for k, tangent in tangents.get(argument.index, {}).items():
                part = tangent * slope
                total[k] = total[k] + part if k in total else part
        if total:
            tangents[node.index] = total
    return [[tangents.get(node.index, {}).get(k, graph.zero) for k in range(len(inputs))] for node in outputs]


def gradient(output: Node, inputs: Sequence[Node]) -> list[Node]:
    """Differentiate one output by many inputs, in reverse: at a price of a few times that of the output.

    The derivative of the sign is 0 everywhere.

    Parameters
    ----------
    output : Node
    inputs : sequence of Node
        Nodes of the same graph.

    Examples
    --------
    >>> from steelyard.graph import Graph, evaluate, sin
    >>> x, y = Graph().inputs("x", 2)
    >>> [float(v) for v in evaluate(gradient(sin(x) * y, [x, y]), {"x[0]": 0.0, "x[1]": 2.0})]
    [2.0, 0.0]
    """
    graph = _graph([output], inputs)
    adjoints: dict[int, Node] = {output.index: graph.one}
    for node in reversed(reachable([output])):
        adjoint = adjoints.get(node.index)
        if adjoint is None or node.operation in ("input", "constant"):
            continue
        for argument, slope in _local(node):
            part = adjoint * slope
            known = adjoints.get(argument.index)
            adjoints[argument.index] = part if known is None else known + part
    return [adjoints.get(node.index, graph.zero) for node in inputs]
