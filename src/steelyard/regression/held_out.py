"""Residuals of data that were left out of a fit, without what the rest of the data does not show."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .factor import Factor, eigenvectors
from .information import Information
from .parameter_covariance import inverse_root_of

__all__ = ["SHOWN", "HeldOutRows"]

Array = NDArray[np.float64]

SHOWN = 1e-3
"""Part of what all data show of a direction that some of it must show of it, to say anything. Where joints move one at
a time stretches of the log show nothing, or 1e-5, of what others show; where they move together, 1e-3 at least (a real
Gen3 for 15 s) and 0.009 or more as a rule."""


@dataclass(frozen=True, eq=False)
class HeldOutRows:
    """The weighted rows of a part of the data, of which the others are to predict what they can.

    Where joints move one at a time, a part may be the only one that shows a base parameter. How it is predicted tells
    nothing of the fit of the others, and drowns what tells. Such directions are free here: they take what they explain.

    Attributes
    ----------
    factors : tuple of Factor
    weights : (N,)
    free : (r, m)
        Orthonormal columns over the rows of all factors, one for each direction that the others do not show.
    """

    factors: tuple[Factor, ...]
    weights: Array
    free: Array

    @classmethod
    def of(cls, info: Information, parts: Sequence[Information], weights: Array) -> tuple[HeldOutRows, ...]:
        """Return the rows of each of the parts, which together are the whole.

        Parameters
        ----------
        info : Information
        parts : sequence of Information
        weights : (N,)
            Of the joints.
        """
        inverse, _, _ = inverse_root_of(info, weights)
        found = []
        for part in parts:
            # In coordinates in which all data show each direction alike, this is what the part shows of it.
            rows = np.concatenate(
                [w * f.triangle[:, :-1] @ inverse[f.columns] for f, w in zip(part.factors, weights, strict=True)]
            )
            values, vectors = eigenvectors(rows.T @ rows)
            own = values > 1.0 - SHOWN
            found.append(cls(part.factors, weights, rows @ vectors[:, own] / np.sqrt(values[own])))
        return tuple(found)

    def squares(self, bases: Array) -> Array:
        """Return the squared residuals of each joint (k, N), without weights, of base parameters (k, n_b)."""
        left = [
            w * (f.triangle[:, -1] - bases[:, f.columns] @ f.triangle[:, :-1].T)
            for f, w in zip(self.factors, self.weights, strict=True)
        ]
        if self.free.shape[1]:
            every = np.concatenate(left, axis=1)
            every -= (every @ self.free) @ self.free.T
            left = np.split(every, np.cumsum([one.shape[1] for one in left])[:-1], axis=1)
        return np.column_stack([np.sum(own**2, axis=1) for own in left]) / self.weights**2
