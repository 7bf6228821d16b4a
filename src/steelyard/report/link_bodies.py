"""Links as bodies that can be drawn: centre of mass, and the ellipsoid and the box of the same mass and inertia."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from steelyard.robot.inertia import pseudo_inertia

__all__ = ["LinkBody", "link_body"]

Array = NDArray[np.float64]

# Second moments that are this much smaller than the largest are zero but for rounding, and their sign says nothing.
ROUNDING = 1e-9


@dataclass(frozen=True, eq=False)
class LinkBody:
    """The drawn body of a link, in the frame of the link.

    The solid ellipsoid and the solid box of uniform density have the mass, the centre of mass and the inertia of the
    link. They exist exactly where some body of positive density has them.

    Attributes
    ----------
    mass : float
        kg.
    center : ndarray
        (3,) centre of mass, m.
    axes : ndarray
        (3, 3) rotation whose columns are the principal axes of the second moments, those of the longest axis first.
    spread : ndarray
        (3,) root mean square distances of the mass from the centre along these axes, m, descending; NaN where the mean
        square is negative, which no body of positive density has.
    """

    mass: float
    center: Array
    axes: Array
    spread: Array

    @property
    def possible(self) -> bool:
        """Whether a body of positive density has this mass and inertia."""
        return bool(np.isfinite(self.spread).all())

    @property
    def semi_axes(self) -> Array:
        """Semi-axes (3,) of the solid ellipsoid, m; NaN where there is none."""
        return np.asarray(np.sqrt(5.0) * self.spread)

    @property
    def sides(self) -> Array:
        """Sides (3,) of the solid box, m; NaN where there is none."""
        return np.asarray(np.sqrt(12.0) * self.spread)


def link_body(parameters: ArrayLike) -> LinkBody | None:
    """Return what can be drawn of a link.

    Parameters
    ----------
    parameters : (10,)
        Lxx Lxy Lxz Lyy Lyz Lzz lx ly lz m in the frame of the link.

    Returns
    -------
    LinkBody or None
        None where the mass is not positive, or a number is not known: there is no centre of mass then.

    Examples
    --------
    A ball of 2 kg with the radius 0.1 m, at x = 0.3 m:

    >>> import steelyard as sy
    >>> ball = sy.Inertia.from_com(2.0, (0.3, 0, 0), 0.4 * 2.0 * 0.1**2 * np.eye(3))
    >>> body = link_body(ball.parameters)
    >>> body.center.tolist(), body.semi_axes.round(6).tolist(), body.possible
    ([0.3, 0.0, 0.0], [0.1, 0.1, 0.1], True)
    """
    values = np.asarray(parameters, dtype=np.float64)
    mass = float(values[9])
    if not np.isfinite(values).all() or mass <= 0.0:
        return None
    pseudo = pseudo_inertia(values)
    center = pseudo[:3, 3] / mass
    squares, axes = np.linalg.eigh(pseudo[:3, :3] / mass - np.outer(center, center))
    squares, axes = squares[::-1], axes[:, ::-1]
    if np.linalg.det(axes) < 0.0:
        axes = axes * [1.0, 1.0, -1.0]
    smallest = ROUNDING * max(float(np.abs(squares).max()), float(center @ center))
    squares = np.where(np.abs(squares) <= smallest, 0.0, squares)
    with np.errstate(invalid="ignore"):
        spread = np.sqrt(squares)
    return LinkBody(mass, center, axes, spread)
