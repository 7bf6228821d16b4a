"""Graph functions as a few operations on vectors, for compilers that are slow with very many scalars."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from steelyard.graph import Function, Node
from steelyard.graph.expression import reachable

__all__ = ["Schedule", "Step", "prefers_vectors", "repeated_operations", "schedule"]

# XLA repeats operations that several outputs share. From so many repeated operations on, operations on vectors compile
# and differentiate in less time.
_MOST_REPEATED = 5_000

Indices = NDArray[np.intp]


@dataclass(frozen=True, eq=False)
class Step:
    """One operation on elements of a vector of values, whose results are appended side by side.

    Attributes
    ----------
    operation : str
        ``"add"``, ``"mul"``, ``"div"``, ``"neg"``, ``"sin"``, ``"cos"``, ``"sign"`` or ``"sqrt"``.
    first : ndarray
        (k,) places of the first operands.
    second : ndarray or None
        (k,) places of the second operands, of additions, multiplications and divisions.
    signs : ndarray or None
        (k,) factors 1 and -1 of the second operands of additions, where some are subtractions.
    start : int
        Place of the first result.
    """

    operation: str
    first: Indices
    second: Indices | None
    signs: NDArray[np.float64] | None
    start: int


@dataclass(frozen=True, eq=False)
class Schedule:
    """A function as steps on one vector: first the arguments' elements, then the constants, then the results.

    Attributes
    ----------
    constants : ndarray
        (c,).
    steps : tuple of Step
    size : int
        Length of the vector.
    outputs : tuple of ndarray
        For each output the places of its elements.
    """

    constants: NDArray[np.float64]
    steps: tuple[Step, ...]
    size: int
    outputs: tuple[Indices, ...]


def schedule(function: Function) -> Schedule:
    """Group the operations of a function that do not need each other and are of one kind.

    Each step takes all the operations of one kind whose operands are known. The kind is that of the operation with the
    longest chain of operations that depend on it. The work is linear in the number of operations, except for the search
    of that operation among those that are ready.

    Parameters
    ----------
    function : Function

    Returns
    -------
    Schedule

    Examples
    --------
    >>> from steelyard.graph import Argument, Graph, Output, sin
    >>> a, b, c, d = Graph().inputs("x", 4)
    >>> f = Function("f", (Argument("x", 4),), (Output("y", (), ((a * b + c * d) * (a - d),)),))
    >>> for step in schedule(f).steps:
    ...     print(step.operation, step.first, step.second)
    mul [0 2] [1 3]
    add [0 4] [3 5]
    mul [7] [6]
    """
    inputs = [f"{a.name}[{k}]" for a in function.arguments for k in range(a.width)]
    places = {name: place for place, name in enumerate(inputs)}
    nodes = reachable(function.nodes)
    constants = [node for node in nodes if node.operation == "constant"]
    where = {node.index: len(places) + k for k, node in enumerate(constants)}
    where |= {node.index: places[str(node.value)] for node in nodes if node.operation == "input"}
    size = len(places) + len(constants)
    waiting = {node.index: len(node.arguments) for node in nodes}
    users: dict[int, list[Node]] = {node.index: [] for node in nodes}
    for node in nodes:
        for argument in node.arguments:
            users[argument.index].append(node)
    behind: dict[int, int] = {}
    for node in reversed(nodes):
        behind[node.index] = 1 + max((behind[user.index] for user in users[node.index]), default=0)
    ready: dict[str, list[Node]] = {}

    def finish(done: list[Node]) -> None:
        for node in done:
            for user in users[node.index]:
                waiting[user.index] -= 1
                if not waiting[user.index]:
                    ready.setdefault("add" if user.operation == "sub" else user.operation, []).append(user)

    finish([node for node in nodes if not node.arguments])
    steps = []
    while ready:
        kind = max(ready, key=lambda kind: (max(behind[node.index] for node in ready[kind]), kind))
        members = ready.pop(kind)
        steps.append(_step(kind, members, where, size))
        where |= {node.index: size + k for k, node in enumerate(members)}
        size += len(members)
        finish(members)
    outputs = tuple(np.array([where[n.index] for n in o.nodes], dtype=np.intp) for o in function.outputs)
    return Schedule(np.array([float(node.value) for node in constants]), tuple(steps), size, outputs)


def _step(kind: str, members: list[Node], where: Mapping[int, int], start: int) -> Step:
    first = np.array([where[node.arguments[0].index] for node in members], dtype=np.intp)
    second, signs = None, None
    if len(members[0].arguments) == 2:
        second = np.array([where[node.arguments[1].index] for node in members], dtype=np.intp)
    if any(node.operation == "sub" for node in members):
        signs = np.array([-1.0 if node.operation == "sub" else 1.0 for node in members])
    return Step(kind, first, second, signs, start)


def repeated_operations(function: Function) -> int:
    """Return how many operations there are where each element of the outputs is computed by itself.

    A compiler has this much to do when it fuses scalar operations into one loop for each element.

    Parameters
    ----------
    function : Function

    Examples
    --------
    >>> from steelyard.graph import Argument, Graph, Output, sin
    >>> x = Graph().inputs("x", 2)
    >>> y = sin(x[0])
    >>> repeated_operations(Function("f", (Argument("x", 2),), (Output("y", (2,), (y * x[1], y + x[1])),)))
    4
    """
    users: dict[int, int] = {}  # for each node a bit for every element that needs it
    for bit, node in enumerate({node.index: node for node in function.nodes}.values()):
        users[node.index] = 1 << bit
    count = 0
    for node in reversed(reachable(function.nodes)):
        mask = users.pop(node.index)
        if node.arguments:
            count += mask.bit_count()
        for argument in node.arguments:
            users[argument.index] = users.get(argument.index, 0) | mask
    return count


def prefers_vectors(function: Function) -> bool:
    """Tell whether XLA compiles a function sooner from a :func:`schedule` than from single numbers.

    Parameters
    ----------
    function : Function
    """
    if sum(function.operation_count.values()) > _MOST_REPEATED:
        return True
    return repeated_operations(function) > _MOST_REPEATED
