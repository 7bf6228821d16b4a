"""Arranges an expression graph for compilation: what is computed once a call, what a sample, and in which parts."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

from .expression import Node, reachable
from .function import Argument

__all__ = ["Fused", "Program"]

# Compilers take more than linear time over long stretches of code without branches. A stretch of this many operations
# is still cheap, and longer programs are cut into parts of about the second number.
_UNDIVIDED = 1200
_PART = 600


@dataclass(frozen=True)
class Fused:
    """A product and a sum as one operation with one rounding: ``(-)a b + (-)c``."""

    a: Node
    b: Node
    c: Node
    negative_product: bool
    negative_addend: bool


class Program:
    """The order in which the nodes of a function are computed.

    Sines and cosines of what the arguments give directly are computed together, after the first part.

    Parameters
    ----------
    arguments : sequence of Argument
    outputs : sequence of Node

    Attributes
    ----------
    uniform : set of int
        Indices of the nodes that are the same for all the samples.
    once : list of Node
        Operations that are the same for all the samples.
    angles : list of Node
        Nodes whose sine and cosine are computed after the first part.
    circular : dict
        For a sine or cosine of an angle, by index: the number of the angle and ``"sin"`` or ``"cos"``.
    fused : dict of int to Fused
    parts : list of list of Node
        Operations of a sample. Where there are angles the first part computes those that are not inputs.
    """

    def __init__(self, arguments: Sequence[Argument], outputs: Sequence[Node]) -> None:
        self.outputs = outputs
        self.inputs = {f"{a.name}[{k}]": (number, k) for number, a in enumerate(arguments) for k in range(a.width)}
        nodes = reachable(outputs)
        self.used_arguments = {self.inputs[str(n.value)][0] for n in nodes if n.operation == "input"}
        self.uniform: set[int] = set()
        for node in nodes:
            if node.operation == "input":
                same = arguments[self.inputs[str(node.value)][0]].uniform
            else:
                same = all(a.index in self.uniform for a in node.arguments)
            if same:
                self.uniform.add(node.index)
        operations = [n for n in nodes if n.operation not in ("input", "constant")]
        self.once = [n for n in operations if n.index in self.uniform]
        work = [n for n in operations if n.index not in self.uniform]
        self.angles, self.circular = self._find_angles(work)
        self.fused: dict[int, Fused] = {}
        work = self._fuse(work)
        self.parts = self._divide(work)

    def operands(self, node: Node) -> tuple[Node, ...]:
        """Return the nodes that an operation reads."""
        fused = self.fused.get(node.index)
        return node.arguments if fused is None else (fused.a, fused.b, fused.c)

    def _find_angles(self, work: list[Node]) -> tuple[list[Node], dict[int, tuple[int, str]]]:
        numbers: dict[int, int] = {}
        angles: list[Node] = []
        circular: dict[int, tuple[int, str]] = {}
        behind: set[int] = set()  # nodes that need a sine or cosine themselves
        for node in work:
            late = any(a.index in behind for a in node.arguments)
            if node.operation in ("sin", "cos"):
                behind.add(node.index)
                if not late:
                    angle = node.arguments[0]
                    if angle.index not in numbers:
                        numbers[angle.index] = len(angles)
                        angles.append(angle)
                    circular[node.index] = (numbers[angle.index], node.operation)
            elif late:
                behind.add(node.index)
        return angles, circular

    def _fuse(self, work: list[Node]) -> list[Node]:
        """Join sums with products that nothing else reads, so that every lane count rounds alike."""
        uses: dict[int, int] = {}
        for node in [argument for n in work for argument in n.arguments] + [*self.outputs, *self.angles]:
            uses[node.index] = uses.get(node.index, 0) + 1
        inside = {node.index for node in work}

        def alone(node: Node) -> bool:
            return node.operation == "mul" and node.index in inside and uses[node.index] == 1

        absorbed: set[int] = set()
        for node in work:
            if node.operation not in ("add", "sub"):
                continue
            x, y = node.arguments
            minus = node.operation == "sub"
            if alone(x):
                self.fused[node.index] = Fused(x.arguments[0], x.arguments[1], y, False, minus)
                absorbed.add(x.index)
            elif alone(y):
                self.fused[node.index] = Fused(y.arguments[0], y.arguments[1], x, minus, False)
                absorbed.add(y.index)
        return [node for node in work if node.index not in absorbed]

    def _divide(self, work: list[Node]) -> list[list[Node]]:
        first: set[int] = set()
        inside = {node.index for node in work}
        stack = list(self.angles)
        while stack:
            node = stack.pop()
            if node.index in inside and node.index not in first:
                first.add(node.index)
                stack.extend(self.operands(node))
        rest = [n for n in work if n.index not in first and n.index not in self.circular]
        if len(rest) > _UNDIVIDED:
            rest = self._depth_first(rest)
        count = 1 if len(rest) <= _UNDIVIDED else -(-len(rest) // _PART)
        bounds = [len(rest) * k // count for k in range(count + 1)]
        parts = [rest[start:end] for start, end in pairwise(bounds)]
        if self.angles:
            parts.insert(0, [n for n in work if n.index in first])
        return parts

    def _depth_first(self, work: list[Node]) -> list[Node]:
        """Order by need, output after output, so that few values are kept from one part to another."""
        inside = {node.index for node in work}
        order: list[Node] = []
        done: set[int] = set()
        for output in self.outputs:
            stack: list[tuple[Node, int]] = [(output, 0)]
            while stack:
                node, position = stack.pop()
                if node.index in done or node.index not in inside:
                    continue
                operands = self.operands(node)
                if position < len(operands):
                    stack.append((node, position + 1))
                    stack.append((operands[position], 0))
                else:
                    done.add(node.index)
                    order.append(node)
        return order
