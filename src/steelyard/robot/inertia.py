"""The inertia of one body, in the barycentric form that enters the dynamics linearly."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .placement import frozen

__all__ = ["INERTIA_SYMBOLS", "Inertia"]

Matrix = NDArray[np.float64]

INERTIA_SYMBOLS = ("Lxx", "Lxy", "Lxz", "Lyy", "Lyz", "Lzz", "lx", "ly", "lz", "m")


def _cross(vector: Matrix) -> Matrix:
    x, y, z = vector
    return np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])


@dataclass(frozen=True, eq=False)
class Inertia:
    """Mass, first moment and second moments of one body in one frame (thesis eq. 2.14 to 2.16).

    Parameters
    ----------
    mass : float
        Mass in kg.
    first_moment : (3,) array
        Mass times centre of mass, kg m, in the frame.
    about_origin : (3, 3) array
        Inertia about the frame's *origin*, kg m². It is the tensor itself: the element Lxy is minus the integral of
        x y dm, as `ixy` in URDF.

    See Also
    --------
    Inertia.from_com : from the centre of mass and the inertia about it, as CAD programs and URDF give it.

    Examples
    --------
    >>> rod = Inertia.from_com(mass=2.0, com=(0, 0, 0.5), about_com=np.diag([0.1, 0.1, 0.0]))
    >>> rod.parameters.tolist()
    [0.6, 0.0, 0.0, 0.6, 0.0, 0.0, 0.0, 0.0, 1.0, 2.0]
    """

    mass: float
    first_moment: Matrix
    about_origin: Matrix

    def __post_init__(self) -> None:
        object.__setattr__(self, "mass", float(self.mass))
        object.__setattr__(self, "first_moment", frozen(self.first_moment, (3,)))
        object.__setattr__(self, "about_origin", frozen(self.about_origin, (3, 3)))

    @classmethod
    def zero(cls) -> Inertia:
        """The inertia of nothing: mass, first moment and second moments 0."""
        return cls(0.0, np.zeros(3), np.zeros((3, 3)))

    @classmethod
    def from_com(cls, mass: float, com: ArrayLike, about_com: ArrayLike) -> Inertia:
        """From mass (kg), centre of mass (3,) in m and inertia (3, 3) about the *centre of mass*, kg m²."""
        centre = np.asarray(com, dtype=float)
        cross = _cross(centre)
        return cls(mass, mass * centre, np.asarray(about_com, dtype=float) - mass * cross @ cross)

    @classmethod
    def from_parameters(cls, parameters: ArrayLike) -> Inertia:
        """From the ten parameters (10,) in the order Lxx Lxy Lxz Lyy Lyz Lzz lx ly lz m."""
        xx, xy, xz, yy, yz, zz, lx, ly, lz, mass = (float(value) for value in np.asarray(parameters, dtype=float))
        return cls(mass, np.array([lx, ly, lz]), np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]))

    @property
    def parameters(self) -> Matrix:
        """The ten parameters (10,): Lxx Lxy Lxz Lyy Lyz Lzz (kg m²), lx ly lz (kg m), m (kg)."""
        second = self.about_origin
        return np.array(
            [
                second[0, 0],
                second[0, 1],
                second[0, 2],
                second[1, 1],
                second[1, 2],
                second[2, 2],
                *self.first_moment,
                self.mass,
            ]
        )

    @property
    def com(self) -> Matrix:
        """Centre of mass (3,) in m; NaN for a body without mass."""
        if self.mass == 0.0:
            return np.full(3, np.nan)
        return np.asarray(self.first_moment / self.mass)

    @property
    def about_com(self) -> Matrix:
        """Inertia (3, 3) about the centre of mass in the frame's axes, kg m²; NaN for a body without mass."""
        cross = _cross(self.com)
        return np.asarray(self.about_origin + self.mass * cross @ cross)

    @property
    def pseudo_inertia(self) -> Matrix:
        """Pseudo-inertia (4, 4), [[tr(L)/2 I - L, l], [l', m]]: positive definite for a body of positive density."""
        matrix = np.empty((4, 4))
        matrix[:3, :3] = np.trace(self.about_origin) / 2 * np.eye(3) - self.about_origin
        matrix[:3, 3] = matrix[3, :3] = self.first_moment
        matrix[3, 3] = self.mass
        return matrix

    def moved(self, placement: ArrayLike) -> Inertia:
        """The same body seen from another frame.

        Parameters
        ----------
        placement : (4, 4) array
            Placement of the present frame in the new one.

        Examples
        --------
        >>> shift = np.eye(4)
        >>> shift[0, 3] = 3.0
        >>> Inertia.from_com(2.0, (0, 0, 0), np.eye(3)).moved(shift).parameters.tolist()
        [1.0, 0.0, 0.0, 19.0, 0.0, 19.0, 6.0, 0.0, 0.0, 2.0]
        """
        matrix = np.asarray(placement, dtype=float)
        rotation, shift = matrix[:3, :3], matrix[:3, 3]
        turned = rotation @ self.first_moment
        arm, moment = _cross(shift), _cross(turned)
        second = rotation @ self.about_origin @ rotation.T - arm @ moment - moment @ arm - self.mass * arm @ arm
        return Inertia(self.mass, turned + self.mass * shift, (second + second.T) / 2)

    def __add__(self, other: Inertia) -> Inertia:
        return Inertia(
            self.mass + other.mass, self.first_moment + other.first_moment, self.about_origin + other.about_origin
        )

    def __sub__(self, other: Inertia) -> Inertia:
        return Inertia(
            self.mass - other.mass, self.first_moment - other.first_moment, self.about_origin - other.about_origin
        )

    def __repr__(self) -> str:
        second = ", ".join(f"{value:.6g}" for value in self.parameters[:6])
        first = ", ".join(f"{value:.6g}" for value in self.first_moment)
        return f"Inertia(mass={self.mass:.6g}, first_moment=({first}), about_origin xx xy xz yy yz zz=({second}))"
