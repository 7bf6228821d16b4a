"""Distances of many pairs of segments at once."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

__all__ = ["segment_distance_bound"]

Array = NDArray[np.float64]

# Segments whose angle has a smaller squared sine are taken as parallel, which moves a point by at most `SLACK` of
# their length.
PARALLEL = 1e-9
SLACK = 1e-4


def segment_distance_bound(first: tuple[Array, Array], second: tuple[Array, Array]) -> Array:
    """Return lower bounds (...) of the distances of segments, equal to them but for 1e-4 of the segments' lengths.

    The closest points of two lines, clamped to the segments (Ericson, Real-Time Collision Detection, 2005, 5.1.9).

    Parameters
    ----------
    first, second : tuple of ndarray
        Both ends, (..., 3) each, m.

    Examples
    --------
    >>> x, y, z = np.eye(3)
    >>> float(segment_distance_bound((0 * x, x), (0.5 * x + z, y + z)).round(3))
    1.0
    """
    (p, p_end), (r, r_end) = first, second
    u, v, w = p_end - p, r_end - r, p - r
    uu, vv, uv = _dot(u, u), _dot(v, v), _dot(u, v)
    uw, vw = _dot(u, w), _dot(v, w)
    determinant = uu * vv - uv * uv
    s = np.clip(_ratio(uv * vw - uw * vv, determinant, determinant > PARALLEL * uu * vv), 0.0, 1.0)
    t = np.clip(_ratio(uv * s + vw, vv, vv > 0), 0.0, 1.0)
    s = np.clip(_ratio(uv * t - uw, uu, uu > 0), 0.0, 1.0)
    gap = w + s[..., None] * u - t[..., None] * v
    return np.asarray(np.sqrt(_dot(gap, gap)) - SLACK * (np.sqrt(uu) + np.sqrt(vv)))


def _dot(a: Array, b: Array) -> Array:
    return np.asarray(np.einsum("...i,...i->...", a, b))


def _ratio(numerator: Array, denominator: Array, valid: NDArray[np.bool_]) -> Array:
    return np.divide(numerator, denominator, out=np.zeros_like(numerator), where=valid)
