"""Data sets of different unknowns, pooled into one regression without reading them again."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from steelyard.errors import InputError
from steelyard.regression import Factor, Information, triangular

__all__ = ["Share", "pooled"]

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Share:
    """A data set, and how its base parameters depend on the unknowns x: at joint k they are ``A_k x + b_k``.

    Parameters
    ----------
    maps : sequence of ndarray
        A_k (n_b, m), one for each factor of the Information, or a single one for all of them.
    offsets : sequence of ndarray
        b_k (n_b,), likewise; none where they are zero.
    """

    information: Information
    maps: Sequence[Array] = field(repr=False)
    offsets: Sequence[Array] = field(default=(), repr=False)

    def rows(self, index: int, factor: Factor) -> Array:
        """The rows ``[W A_k | omega - W offset_k]`` of a factor, (rows, m + 1)."""
        matrix = self.maps[index if len(self.maps) > 1 else 0]
        target = factor.triangle[:, -1]
        if self.offsets:
            offset = self.offsets[index if len(self.offsets) > 1 else 0]
            target = target - factor.triangle[:, :-1] @ offset[factor.columns]
        return np.column_stack([factor.triangle[:, :-1] @ matrix[factor.columns], target])

    def reached(self, index: int, factor: Factor) -> NDArray[np.bool_]:
        """Return which unknowns the rows of a factor depend on, (m,)."""
        matrix = self.maps[index if len(self.maps) > 1 else 0]
        return np.asarray(np.any(matrix[factor.columns] != 0.0, axis=0))


def pooled(shares: Sequence[Share], names: Sequence[str], expressions: Sequence[str] | None = None) -> Information:
    """Return the Information of several data sets about the same unknowns.

    It is exact: the triangular factors of each data set are multiplied by its map and stacked, and so are those of its
    batch means, so that the correlation of the residuals in time is known of the pooled regression, too.

    Parameters
    ----------
    shares : sequence of Share
        Of the same robot, each joint's rows apart in all of them or in none.
    names, expressions : sequence of str
        Of the m unknowns.

    Raises
    ------
    InputError
        If the data sets have different base parameters, or only some were whitened.

    Examples
    --------
    A pendulum is recorded once as it is, and once with something that adds to its parameters:

    >>> alone = Information.from_factor(np.eye(2), [1.0, 2.0], 0.0, 9, ["Lzz", "lx"])
    >>> loaded = Information.from_factor(np.eye(2), [1.5, 4.0], 0.0, 9, ["Lzz", "lx"])
    >>> both = pooled(
    ...     [Share(alone, [np.eye(2, 4)]), Share(loaded, [np.hstack([np.eye(2), np.eye(2)])])],
    ...     ["Lzz", "lx", "added Lzz", "added lx"],
    ... )
    >>> from steelyard.regression import least_squares
    >>> least_squares(both).base.round(12).tolist()
    [1.0, 2.0, 0.5, 2.0]
    """
    first = shares[0].information
    for share in shares[1:]:
        other = share.information
        if other.base_expressions != first.base_expressions or len(other.factors) != len(first.factors):
            raise InputError(
                "The data sets are of different robots or models: their base parameters differ, or only one of them "
                "was whitened; reduce the logs with the same robot file."
            )

    def merged(kinds: Sequence[tuple[Factor, ...]]) -> tuple[Factor, ...]:
        found = []
        for index, factors in enumerate(zip(*kinds, strict=True)):
            pairs = list(zip(shares, factors, strict=True))
            reached = np.any([share.reached(index, factor) for share, factor in pairs], axis=0)
            columns = np.flatnonzero(reached)
            rows = np.vstack([share.rows(index, factor) for share, factor in pairs])
            triangle = triangular(rows[:, [*columns, -1]])
            found.append(Factor(factors[0].joint, columns, triangle, sum(factor.count for factor in factors)))
        return tuple(found)

    data = [share.information for share in shares]
    measured: tuple[Factor, ...] = ()
    if any(one.torque_factors for one in data):
        measured = merged([one.torque_factors or one.factors for one in data])
    levels = []
    if all(one.batch_means for one in data):
        levels = [merged(level) for level in zip(*(one.batch_means for one in data), strict=True)]
    return Information(
        tuple(names),
        tuple(names if expressions is None else expressions),
        first.joint_names,
        merged([one.factors for one in data]),
        measured,
        None,
        tuple(dict.fromkeys(remark for one in data for remark in one.remarks)),
        batch_means=tuple(levels),
        filtered_torque=any(one.filtered_torque for one in data),
    )
