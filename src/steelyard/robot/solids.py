"""Moments of simple solids at a density of 1 kg/m³, about their centres and along their axes."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

__all__ = ["box_moments", "capsule_moments", "cylinder_moments", "ellipsoid_moments"]

Matrix = NDArray[np.float64]


def _centred(volume: float, *mean_squares: float) -> Matrix:
    """Return ∫ (r, 1)(r, 1)ᵀ dV (4, 4) from the means of x², y² and z²; the volume stands last."""
    return volume * np.diag([*mean_squares, 1.0])


def ellipsoid_moments(x: float, y: float, z: float) -> Matrix:
    """Return the moments (4, 4) of an ellipsoid with these half axes, m.

    Examples
    --------
    >>> float(ellipsoid_moments(1.0, 1.0, 1.0)[3, 3]) == 4 / 3 * np.pi
    True
    """
    return _centred(4.0 / 3.0 * np.pi * x * y * z, x * x / 5.0, y * y / 5.0, z * z / 5.0)


def box_moments(edges: Sequence[float]) -> Matrix:
    """Return the moments (4, 4) of a box with these edges, m."""
    return _centred(float(np.prod(edges)), *(np.array(edges) ** 2 / 12.0))


def cylinder_moments(radius: float, length: float) -> Matrix:
    """Return the moments (4, 4) of a cylinder along z, m."""
    return _centred(np.pi * radius**2 * length, radius**2 / 4.0, radius**2 / 4.0, length**2 / 12.0)


def capsule_moments(radius: float, length: float) -> Matrix:
    """Return the moments (4, 4) of a cylinder along z, of this length, with half balls on both ends, m."""
    r = radius
    # The centroid of a half ball lies 3 r / 8 from its flat side.
    along = r * r / 5.0 + 3.0 * length * r / 8.0 + length**2 / 4.0
    return _centred(4.0 / 3.0 * np.pi * r**3, r * r / 5.0, r * r / 5.0, along) + cylinder_moments(r, length)
