"""Cuts very long listings into parts, because the time of compilers grows with the square of a function's length."""

from __future__ import annotations

import re
from dataclasses import dataclass

from .assignments import Assignment, Listing

__all__ = ["Part", "Partition", "Store", "partition"]

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
    statements : tuple of Assignment or Store
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
    listing : Listing
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
