"""What is minimised: parts that each bring a quadratic, rows of cones and unknowns of their own, and their sum."""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt
import scipy.sparse as sparse

from .cone_program import Rows

__all__ = ["Part", "total"]

Vector = npt.NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Part:
    """½ zᵀP z + q · z over z = (x̂, own), where x̂ are the unknowns of the program.

    Attributes
    ----------
    P : (m + own, m + own) sparse, upper triangle
    q : (m + own,)
    rows : tuple of Rows, over z
    own : int
        Number of unknowns that belong to this part alone.
    """

    P: sparse.csc_array = field(repr=False)
    q: Vector = field(repr=False)
    rows: tuple[Rows, ...] = ()
    own: int = 0

    def times(self, factor: float) -> "Part":
        """The same, its value multiplied by a positive factor."""
        return Part(self.P * factor, self.q * factor, self.rows, self.own)

    def over(self, shared: int, start: int, size: int) -> "Part":
        """The same over `size` unknowns, of which its own begin at `start`."""
        if self.own == 0 and size == shared:
            return self
        places = np.concatenate([np.arange(shared), start + np.arange(self.own)])

        def spread(matrix: sparse.csc_array, square: bool) -> sparse.csc_array:
            entries = sparse.coo_array(matrix)
            row = places[entries.coords[0]] if square else entries.coords[0]
            shape = (size if square else matrix.shape[0], size)
            return sparse.csc_array(sparse.coo_array((entries.data, (row, places[entries.coords[1]])), shape=shape))

        q = np.zeros(size)
        q[places] = self.q
        rows = tuple(Rows(spread(r.matrix, False), r.right, r.cone) for r in self.rows)
        return Part(spread(self.P, True), q, rows, size - shared)


def total(parts: Sequence[Part], shared: int) -> Part:
    """The sum of parts over the same `shared` unknowns."""
    if len(parts) == 1:
        return parts[0]
    size = shared + sum(part.own for part in parts)
    start, spread = shared, []
    for part in parts:
        spread.append(part.over(shared, start, size))
        start += part.own
    P, q = spread[0].P, spread[0].q.copy()
    for part in spread[1:]:
        P, q = P + part.P, q + part.q
    return Part(sparse.csc_array(P), q, tuple(row for part in spread for row in part.rows), size - shared)
