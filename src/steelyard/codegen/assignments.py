"""A function as a list of assignments, in the order and with the parentheses that any language understands.

The operations and their order are exactly those of the graph: ``a + (b + c)`` keeps its parentheses, and nothing is
distributed or regrouped. A value that is used once is written where it is used, as long as the line stays short. A very
long listing is cut into parts, because the time of compilers grows with the square of a function's length.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

from steelyard.errors import InputError
from steelyard.files import tell
from steelyard.graph import Function, Node
from steelyard.graph.expression import reachable
from steelyard.once import cached_property

from .text import Names, number

__all__ = [
    "CALLS",
    "Assignment",
    "Listing",
    "OutputListing",
    "Part",
    "Partition",
    "Store",
    "Syntax",
    "listing",
    "partition",
]

# The operations that all languages write as calls.
CALLS = ("sin", "cos", "sign", "sqrt", "exp", "log")
_SUM, _PRODUCT, _ATOM = 1, 2, 3
_PRECEDENCE = {"add": _SUM, "sub": _SUM, "mul": _PRODUCT, "div": _PRODUCT, "neg": _SUM}
_SIGN = {"add": "+", "sub": "-", "mul": "*", "div": "/"}
_TOLD = 5000  # operations after which it is told how far the writing has come
_WIDTH = 44  # characters of an expression beyond which it gets a variable, so that lines stay within 100 columns


@dataclass(frozen=True)
class Syntax:
    """The syntax of a language for the elements of an expression; sums, products and parentheses are the same in all.

    Attributes
    ----------
    element : callable
        From the name of an argument (in the language) and an index from 0, such as ``("q", 0)``, the text ``q[0]``.
    calls : mapping
        Templates for ``"sin"``, ``"cos"``, ``"sign"``, ``"sqrt"``, ``"exp"`` and ``"log"``, such as ``"sin({})"``.
    number : callable
        The literal of a finite float; a negative one is put in parentheses where needed.
    pair : (str, str) or None
        Templates for sine and cosine at once, such as ``("({}, {})", "sincos({})")``: what is assigned to, and what is
        assigned. None writes two neighbouring assignments.
    """

    element: Callable[[str, int], str] = lambda name, index: f"{name}[{index}]"
    calls: Mapping[str, str] = field(default_factory=lambda: {name: f"{name}({{}})" for name in CALLS})
    number: Callable[[float], str] = number
    pair: tuple[str, str] | None = None


@dataclass(frozen=True)
class Assignment:
    """A local variable and the expression it is set to, once."""

    name: str
    expression: str


@dataclass(frozen=True)
class OutputListing:
    """The expressions of an output's elements, in row-major order.

    Attributes
    ----------
    elements : tuple of str
    zero : tuple of bool
        Which of them are the constant 0 whatever the arguments.
    """

    elements: tuple[str, ...]
    zero: tuple[bool, ...]

    @cached_property
    def mostly_zero(self) -> bool:
        """Whether at least a quarter of the elements is 0, so that filling with 0 first makes shorter code."""
        return sum(self.zero) >= 8 and 4 * sum(self.zero) >= len(self.zero)

    @cached_property
    def stored(self) -> tuple[tuple[int, str], ...]:
        """Index and expression of the elements to store; where the output is mostly 0 it is filled with 0 before."""
        skip = self.mostly_zero
        elements = zip(self.elements, self.zero, strict=True)
        return tuple((k, text) for k, (text, zero) in enumerate(elements) if not (zero and skip))


@dataclass(frozen=True)
class Listing:
    """A function as assignments to local variables, and then expressions for its outputs.

    Attributes
    ----------
    assignments : tuple of Assignment
        In order; each uses arguments and earlier local variables.
    outputs : tuple of OutputListing
        One for each output of the function.
    used_arguments : frozenset of str
        Names (in the graph) of the arguments that the listing reads; the others must not cause warnings.
    operations : frozenset of str
        The operations that occur, such as ``"sin"`` and ``"sign"``.
    """

    assignments: tuple[Assignment, ...]
    outputs: tuple[OutputListing, ...]
    used_arguments: frozenset[str]
    operations: frozenset[str]


def listing(
    function: Function, syntax: Syntax, names: Mapping[str, str] | None = None, scope: Names | None = None
) -> Listing:
    """List a function's assignments.

    The work is linear in the number of operations, without recursion.

    Parameters
    ----------
    function : Function
    syntax : Syntax
    names : mapping, optional
        What the language calls each argument of the graph; what is missing keeps its name.
    scope : Names, optional
        Names that local variables must differ from; the arguments' are added.

    Raises
    ------
    InputError
        Where the function reads what is no argument of it.

    Examples
    --------
    >>> from steelyard.graph import Argument, Graph, Output, sin
    >>> a, b = Graph().inputs("x", 2)
    >>> y = sin(a) * (a + b)
    >>> f = Function("f", (Argument("x", 2),), (Output("y", (2,), (y, y - (b - a))),))
    >>> result = listing(f, Syntax())
    >>> for assignment in result.assignments:
    ...     print(assignment.name, "=", assignment.expression)
    s1 = sin(x[0])
    t1 = s1 * (x[0] + x[1])
    >>> result.outputs[0].elements
    ('t1', 't1 - (x[1] - x[0])')
    """
    return _Writer(function, syntax, names or {}, scope or Names()).listing()


class _Writer:
    def __init__(self, function: Function, syntax: Syntax, names: Mapping[str, str], scope: Names) -> None:
        self.function = function
        self.syntax = syntax
        scope = scope.inner()
        self.inputs: dict[str, str] = {}
        self.owner: dict[str, str] = {}
        for argument in function.arguments:
            name = names.get(argument.name, argument.name)
            scope.take(name)
            for k in range(argument.width):
                self.inputs[f"{argument.name}[{k}]"] = syntax.element(name, k)
                self.owner[f"{argument.name}[{k}]"] = argument.name
        self.prefixes = {"sin": scope.prefix("s"), "cos": scope.prefix("c"), "local": scope.prefix("t")}
        self.nodes = reachable(function.nodes)
        self.uses = self._count_uses()
        self.text: dict[int, tuple[str, int]] = {}  # expression and precedence, of the nodes written so far
        self.assignments: list[Assignment] = []
        self.used: set[str] = set()
        self.locals = 0
        self.angles: dict[int, int] = {}

    def listing(self) -> Listing:
        present = {(node.operation, node.arguments[0].index): node for node in self.nodes if len(node.arguments) == 1}
        for done, node in enumerate(self.nodes):
            if done % _TOLD == 0:
                tell(f"writing {self.function.name}", done, len(self.nodes), "operations")
            if node.index in self.text:
                continue
            if node.operation in ("sin", "cos"):
                self._write_angle(node, present)
            else:
                self._write(node)
        outputs = tuple(
            OutputListing(
                tuple(self.text[node.index][0] for node in output.nodes),
                tuple(node.operation == "constant" and node.value == 0.0 for node in output.nodes),
            )
            for output in self.function.outputs
        )
        operations = frozenset(node.operation for node in self.nodes)
        return Listing(tuple(self.assignments), outputs, frozenset(self.used), operations)

    def _count_uses(self) -> dict[int, int]:
        uses = dict.fromkeys((node.index for node in self.nodes), 0)
        for node in self.nodes:
            for argument in node.arguments:
                uses[argument.index] += 1
        for node in self.function.nodes:
            uses[node.index] += 1
        return uses

    def _write(self, node: Node) -> None:
        kind = node.operation
        if kind == "input":
            key = str(node.value)
            if key not in self.inputs:
                raise InputError(f"function {self.function.name!r} reads {key}, which is no argument of it; add one.")
            self.used.add(self.owner[key])
            self.text[node.index] = (self.inputs[key], _ATOM)
            return
        if kind == "constant":
            value = float(node.value)
            self.text[node.index] = (self.syntax.number(value), _SUM if value < 0.0 else _ATOM)
            return
        expression = self._expression(node)
        if self.uses[node.index] == 1 and len(expression) <= _WIDTH:
            self.text[node.index] = (expression, _PRECEDENCE.get(kind, _ATOM))
        else:
            self.locals += 1
            self._assign(node, f"{self.prefixes['local']}{self.locals}", expression)

    def _assign(self, node: Node, name: str, expression: str) -> None:
        self.assignments.append(Assignment(name, expression))
        self.text[node.index] = (name, _ATOM)

    def _expression(self, node: Node) -> str:
        kind = node.operation
        if kind == "neg":
            return f"-{self._operand(node.arguments[0], _ATOM)}"
        if kind in ("sign", "sqrt", "exp", "log"):
            return self.syntax.calls[kind].format(self.text[node.arguments[0].index][0])
        own = _PRECEDENCE[kind]
        a, b = node.arguments
        # The value written first is grouped by the language's left-to-right rule; the second needs parentheses.
        return f"{self._operand(a, own)} {_SIGN[kind]} {self._operand(b, own + 1)}"

    def _operand(self, node: Node, least: int) -> str:
        text, precedence = self.text[node.index]
        return text if precedence >= least else f"({text})"

    def _write_angle(self, node: Node, present: Mapping[tuple[str, int], Node]) -> None:
        """Assign the sine and the cosine of an angle side by side, as soon as one of them is needed."""
        angle = node.arguments[0]
        self.angles.setdefault(angle.index, len(self.angles) + 1)
        label = self.angles[angle.index]
        text = self.text[angle.index][0]
        names = {kind: f"{self.prefixes[kind]}{label}" for kind in ("sin", "cos")}
        nodes = {kind: present[kind, angle.index] for kind in ("sin", "cos") if (kind, angle.index) in present}
        if len(nodes) == 2 and self.syntax.pair is not None:
            target, call = self.syntax.pair
            self.assignments.append(Assignment(target.format(names["sin"], names["cos"]), call.format(text)))
            for kind, written in nodes.items():
                self.text[written.index] = (names[kind], _ATOM)
            return
        for kind, written in nodes.items():
            self._assign(written, names[kind], self.syntax.calls[kind].format(text))


# Assignments that stay together, and those of a part of a longer listing. Measured with gcc -O2 on the regressor of a
# humanoid of 36 joints (46000 operations): 125 s whole, 12 s in parts.
_LARGEST, _PART = 2000, 500
_WORD = re.compile(r"(?<![\w.])[A-Za-z_]\w*")


@dataclass(frozen=True)
class Store:
    """An output's element and its expression."""

    output: int
    element: int
    expression: str


@dataclass(frozen=True)
class Part:
    """Consecutive statements of a listing, which become a function of their own.

    Attributes
    ----------
    reads : tuple of (str, int)
        Local variables of earlier parts, and the places where they are kept.
    keeps : tuple of (str, int)
        Local variables that later parts read, and the places for them.
    """

    reads: tuple[tuple[str, int], ...]
    statements: tuple[Assignment | Store, ...]
    keeps: tuple[tuple[str, int], ...]

    @property
    def names(self) -> frozenset[str]:
        """All the names in the expressions."""
        return frozenset(word for statement in self.statements for word in _WORD.findall(statement.expression))

    @property
    def stored(self) -> frozenset[int]:
        """The outputs of which elements are stored."""
        return frozenset(statement.output for statement in self.statements if isinstance(statement, Store))


@dataclass(frozen=True)
class Partition:
    """All the parts of a listing, and the number of places for the values that one part hands to a later one."""

    parts: tuple[Part, ...]
    places: int


def partition(listing: Listing, largest: int = _LARGEST, size: int = _PART) -> Partition:
    """Cut a listing into parts.

    A listing of at most `largest` assignments is one part with its outputs at the end. In a longer one each output is
    stored in the part that computes it.

    Parameters
    ----------
    largest : int
        Assignments up to which a listing is left whole.
    size : int
        Assignments of a part.

    Examples
    --------
    >>> from steelyard.codegen import Syntax, listing
    >>> from steelyard.graph import Argument, Function, Graph, Output, sin
    >>> (x,) = Graph().inputs("x", 1)
    >>> y = sin(x) + 1.0
    >>> f = Function("f", (Argument("x", 1),), (Output("y", (2,), (y, sin(y * y))),))
    >>> found = partition(listing(f, Syntax()), largest=2, size=2)
    >>> for part in found.parts:
    ...     print(part.reads, [statement.expression for statement in part.statements], part.keeps)
    () ['sin(x[0])', '1.0 + s1', 't1'] (('t1', 0),)
    (('t1', 0),) ['sin(t1 * t1)', 's2'] ()
    """
    stores = [Store(k, j, text) for k, output in enumerate(listing.outputs) for j, text in output.stored]
    if len(listing.assignments) <= largest:
        return Partition((Part((), (*listing.assignments, *stores), ()),), 0)
    born: dict[str, int] = {}  # local variable: its part
    for position, assignment in enumerate(listing.assignments):
        born |= dict.fromkeys(_WORD.findall(assignment.name), position // size)
    count = -(-len(listing.assignments) // size)
    statements: list[list[Assignment | Store]] = [
        list(listing.assignments[k * size : (k + 1) * size]) for k in range(count)
    ]
    for store in stores:
        statements[max((born[word] for word in _WORD.findall(store.expression) if word in born), default=0)].append(
            store
        )
    read: list[list[str]] = []
    last: dict[str, int] = {}
    for k, part in enumerate(statements):
        words = [word for statement in part for word in _WORD.findall(statement.expression)]
        read.append([word for word in dict.fromkeys(words) if born.get(word, k) < k])
        last |= dict.fromkeys(read[k], k)
    return _with_places(statements, read, born, last)


def _with_places(
    statements: list[list[Assignment | Store]], read: list[list[str]], born: dict[str, int], last: dict[str, int]
) -> Partition:
    """Give a place to each value that is handed on; the place is used again after its last reader."""
    place: dict[str, int] = {}
    free: list[int] = []
    places = 0
    parts = []
    names: list[list[str]] = [[] for _ in statements]
    for name in born:
        if name in last:
            names[born[name]].append(name)
    for k, part in enumerate(statements):
        reads = tuple((name, place[name]) for name in read[k])
        free += sorted((place[name] for name in read[k] if last[name] == k), reverse=True)
        for name in names[k]:
            if free:
                place[name] = free.pop()
            else:
                place[name] = places
                places += 1
        parts.append(Part(reads, tuple(part), tuple((name, place[name]) for name in names[k])))
    return Partition(tuple(parts), places)
