"""Spans of sparse rows in rational numbers, in reduced echelon form."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from fractions import Fraction

__all__ = ["Row", "RowSpace"]

Row = dict[int, Fraction]


class RowSpace:
    """The span of rows, each from column to value; the first column of a row, by number, is its pivot.

    Examples
    --------
    >>> space = RowSpace()
    >>> space.add({0: Fraction(2), 1: Fraction(4)}), space.add({0: Fraction(1), 1: Fraction(2)})
    (True, False)
    >>> space.rows
    {0: {0: Fraction(1, 1), 1: Fraction(2, 1)}}
    """

    def __init__(self) -> None:
        self.rows: dict[int, Row] = {}

    def __len__(self) -> int:
        return len(self.rows)

    def add(self, row: Row) -> bool:
        """Add a row; False where it lies in the span already."""
        rest = dict(row)
        for pivot in [column for column in rest if column in self.rows]:
            subtract(rest, rest[pivot], self.rows[pivot])
        rest = {column: value for column, value in rest.items() if value}
        if not rest:
            return False
        pivot = min(rest)
        factor = rest[pivot]
        rest = {column: value / factor for column, value in rest.items()}
        for other in self.rows.values():
            if pivot in other:
                subtract(other, other[pivot], rest)
        self.rows[pivot] = rest
        return True

    def close(self, generator: Callable[[Row], Row]) -> RowSpace:
        """Add all that a linear map makes of the rows, until nothing new comes; returns itself."""
        waiting = [dict(row) for row in self.rows.values()]
        while waiting:
            image = generator(waiting.pop())
            if self.add(image):
                waiting.append(image)
        return self

    def null_vectors(self, columns: Iterable[int]) -> list[Row]:
        """A basis of the vectors over these columns that are orthogonal to every row."""
        found = []
        for free in columns:
            if free not in self.rows:
                vector = {pivot: -row[free] for pivot, row in self.rows.items() if free in row}
                found.append({free: Fraction(1), **vector})
        return found


def subtract(row: Row, factor: Fraction, other: Row) -> None:
    """Take a multiple of another row away, in place."""
    for column, value in other.items():
        changed = row.get(column, Fraction(0)) - factor * value
        if changed:
            row[column] = changed
        else:
            row.pop(column, None)
