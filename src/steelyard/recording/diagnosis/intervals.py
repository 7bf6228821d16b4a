"""Rows of single joints that something is wrong with, as intervals."""

from __future__ import annotations

import html
from collections.abc import Iterator
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

__all__ = ["Interval", "Intervals", "runs"]


class Interval(NamedTuple):
    """Rows start:stop of a joint (from 0), and their times in s."""

    joint: int
    start: int
    stop: int
    begin: float
    end: float


@dataclass(frozen=True, eq=False)
class Intervals:
    """Rows that a detector found.

    Attributes
    ----------
    kind : str
        What was found, in words: "at rest while the torque changes".
    flags : ndarray of bool
        (S, N), true where it was found.
    t : ndarray
        (S,) s.
    level : ndarray or None
        (N,) what was compared with: the level of saturation, the tolerance of a rest.
    """

    kind: str
    flags: NDArray[np.bool_]
    t: NDArray[np.float64]
    level: NDArray[np.float64] | None = None

    @property
    def count(self) -> NDArray[np.intp]:
        """(N,) rows of each joint."""
        return np.asarray(self.flags.sum(axis=0))

    def __iter__(self) -> Iterator[Interval]:
        for joint in range(self.flags.shape[1]):
            for start, stop in runs(self.flags[:, joint]):
                yield Interval(joint, start, stop, float(self.t[start]), float(self.t[stop - 1]))

    def __len__(self) -> int:
        return sum(1 for _ in self)

    def __bool__(self) -> bool:
        return bool(self.flags.any())

    def sentences(self) -> tuple[str, ...]:
        """One sentence for each joint with such rows, or one for all where they are the same."""
        found = []
        alike = self.flags.shape[1] > 1 and bool(np.all(self.flags == self.flags[:, :1]))
        for joint, rows in enumerate(self.count[:1] if alike else self.count):
            if rows:
                pieces = runs(self.flags[:, joint])
                longest = max(stop - start for start, stop in pieces)
                found.append(
                    f"{'All joints' if alike else f'Joint {joint + 1}'}: {rows} rows in {len(pieces)} intervals are "
                    f"{self.kind}, the longest of {longest} "
                    f"rows, the first at t = {self.t[pieces[0][0]]:.6g} s."
                )
        return tuple(found)

    def __repr__(self) -> str:
        return f"Intervals({self.kind}: {int(self.flags.sum())} joint rows in {len(self)} intervals)"

    def _repr_html_(self) -> str:
        items = "".join(f"<li>{html.escape(sentence)}</li>" for sentence in self.sentences())
        return f"<p>{html.escape(repr(self))}</p>" + (f"<ul>{items}</ul>" if items else "")


def runs(flags: NDArray[np.bool_]) -> list[tuple[int, int]]:
    """Begin and end (excluded) of each run of true values in (S,)."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], flags, [False]]).astype(np.int8)))
    return [(int(a), int(b)) for a, b in zip(edges[::2], edges[1::2], strict=True)]
