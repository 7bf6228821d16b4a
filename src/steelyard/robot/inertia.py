"""The inertia of one body, in the barycentric form that enters the dynamics linearly."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from steelyard.errors import InputError

from .placement import frozen

__all__ = [
    "INERTIA_SYMBOLS",
    "PSEUDO_INERTIA",
    "Inertia",
    "box_moments",
    "capsule_moments",
    "cylinder_moments",
    "ellipsoid_moments",
    "inertia_tensor",
    "moment_row",
    "parameters_of_pseudo_inertia",
    "pseudo_inertia",
    "transformation",
]

Matrix = NDArray[np.float64]

INERTIA_SYMBOLS = ("Lxx", "Lxy", "Lxz", "Lyy", "Lyz", "Lzz", "lx", "ly", "lz", "m")


_TENSOR = np.array([[0, 1, 2], [1, 3, 4], [2, 4, 5]])
"""Where the elements of the inertia about the origin stand among the ten parameters."""


def pseudo_inertia(parameters: ArrayLike) -> Matrix:
    """P = ∫ (r, 1)(r, 1)ᵀ dm = [[tr(L)/2 1 - L, l], [lᵀ, m]], (..., 4, 4): positive definite for a positive density.

    Parameters
    ----------
    parameters : (..., 10)
        Lxx Lxy Lxz Lyy Lyz Lzz lx ly lz m of each body.

    References
    ----------
    P. M. Wensing, S. Kim and J.-J. E. Slotine, Linear matrix inequalities for physically consistent inertial parameter
    identification, IEEE Robotics and Automation Letters 3, 2018, equation 5.

    Examples
    --------
    A point of 2 kg at x = 3:

    >>> pseudo_inertia([0, 0, 0, 18, 0, 18, 6, 0, 0, 2])[[0, 0, 3], [0, 3, 3]].tolist()
    [18.0, 6.0, 2.0]
    """
    values = np.asarray(parameters, dtype=float)
    half = 0.5 * (values[..., 0] + values[..., 3] + values[..., 5])
    found = np.empty((*values.shape[:-1], 4, 4))
    found[..., :3, :3] = half[..., None, None] * np.eye(3) - values[..., _TENSOR]
    found[..., :3, 3] = found[..., 3, :3] = values[..., 6:9]
    found[..., 3, 3] = values[..., 9]
    return found + 0.0


def parameters_of_pseudo_inertia(matrices: ArrayLike) -> Matrix:
    """Undo `pseudo_inertia`: (..., 10) from (..., 4, 4)."""
    given = np.asarray(matrices, dtype=float)
    second = given[..., :3, :3]
    tensor = np.trace(second, axis1=-2, axis2=-1)[..., None, None] * np.eye(3) - second
    row, column = np.triu_indices(3)
    return np.concatenate([tensor[..., row, column], given[..., :3, 3], given[..., 3, 3:]], axis=-1)


PSEUDO_INERTIA = pseudo_inertia(np.eye(10))
"""Coefficients of the pseudo-inertia in the ten parameters, (10, 4, 4)."""
PSEUDO_INERTIA.setflags(write=False)


def moment_row(quadratic: Matrix) -> Matrix:
    """The moment ∫ (r, 1)ᵀ Q (r, 1) dm = tr(P Q) as a row (10,) over the ten parameters.

    Q (4, 4), symmetric, is a quadratic function of the place r.

    Examples
    --------
    >>> moment_row(np.diag([0.0, 0.0, 0.0, 1.0])).tolist()[-1]
    1.0
    """
    return np.asarray(np.einsum("kij,ij->k", PSEUDO_INERTIA, quadratic)) + 0.0


def transformation(placement: Matrix) -> Matrix:
    """Return how the ten parameters change, (10, 10), where every point r goes to T (r, 1): P becomes T P Tᵀ.

    T (4, 4) is a rigid motion, or one with a reflection.

    Examples
    --------
    >>> reflection = np.diag([-1.0, 1.0, 1.0, 1.0])
    >>> np.diag(transformation(reflection)).astype(int).tolist()
    [1, -1, -1, 1, 1, 1, -1, 1, 1, 1]
    """
    return parameters_of_pseudo_inertia(placement @ PSEUDO_INERTIA @ placement.T).T + 0.0


def inertia_tensor(elements: ArrayLike) -> Matrix:
    """The symmetric tensor (3, 3) of the six elements xx xy xz yy yz zz.

    Examples
    --------
    >>> inertia_tensor([1, 2, 3, 4, 5, 6]).tolist()
    [[1.0, 2.0, 3.0], [2.0, 4.0, 5.0], [3.0, 5.0, 6.0]]
    """
    xx, xy, xz, yy, yz, zz = np.asarray(elements, dtype=float)
    return np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])


# Differences of opposite elements that are more than rounding, as a part of the largest element; and in kg·m², for what
# is left of a point mass where larger inertias were subtracted.
_ASYMMETRIC, _NOTHING = 1e-6, 1e-13


def _given(values: ArrayLike, shape: tuple[int, ...], what: str) -> Matrix:
    array = np.asarray(values, dtype=float)
    if array.shape != shape:
        raise InputError(f"The {what} of a body must have the shape {shape}, got {array.shape}.")
    if array.ndim == 2 and (np.abs(array - array.T) > _ASYMMETRIC * np.abs(array).max() + _NOTHING).any():
        raise InputError(
            f"The {what} of a body must be a symmetric matrix, got {array.tolist()}; write each product of inertia at "
            "both of its places."
        )
    return array


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

    Raises
    ------
    InputError
        If a shape is another one, or the inertia is not symmetric.

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
        first, second = _given(self.first_moment, (3,), "first moment"), _given(self.about_origin, (3, 3), "inertia")
        object.__setattr__(self, "mass", float(self.mass))
        object.__setattr__(self, "first_moment", frozen(first, (3,)))
        object.__setattr__(self, "about_origin", frozen(second, (3, 3)))

    @classmethod
    def zero(cls) -> Inertia:
        """The inertia of nothing: mass, first moment and second moments 0."""
        return cls(0.0, np.zeros(3), np.zeros((3, 3)))

    @classmethod
    def from_com(cls, mass: float, com: ArrayLike, about_com: ArrayLike) -> Inertia:
        """From mass (kg), centre of mass (3,) in m and inertia (3, 3) about the *centre of mass*, kg m²."""
        centre = _given(com, (3,), "centre of mass")
        cross = _cross(centre)
        return cls(mass, mass * centre, _given(about_com, (3, 3), "inertia") - mass * cross @ cross)

    @classmethod
    def from_inertial_frame(cls, mass: float, placement: Matrix, about_com: Matrix) -> Inertia:
        """From mass (kg), the placement (4, 4) of a frame in the centre of mass, and the inertia (3, 3) in its axes.

        Examples
        --------
        >>> quarter_turn = np.array([[0, -1, 0, 5], [1, 0, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]])
        >>> body = Inertia.from_inertial_frame(2.0, quarter_turn, np.diag([1.0, 2.0, 3.0]))
        >>> body.com.tolist(), np.diag(body.about_com).tolist()
        ([5.0, 0.0, 0.0], [2.0, 1.0, 3.0])
        """
        rotation = placement[:3, :3]
        turned = rotation @ about_com @ rotation.T
        return cls.from_com(mass, placement[:3, 3], (turned + turned.T) / 2)

    @classmethod
    def from_parameters(cls, parameters: ArrayLike) -> Inertia:
        """From the ten parameters (10,) in the order Lxx Lxy Lxz Lyy Lyz Lzz lx ly lz m."""
        values = _given(parameters, (10,), "parameters")
        return cls(values[9], values[6:9], inertia_tensor(values[:6]))

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
        return pseudo_inertia(self.parameters)

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


# Simple solids at 1 kg/m³, about their centres and along their axes


def _centred_moments(volume: float, *mean_squares: float) -> Matrix:
    """Return ∫ (r, 1)(r, 1)ᵀ dV (4, 4) from the means of x², y² and z²; the volume stands last."""
    return volume * np.diag([*mean_squares, 1.0])


def ellipsoid_moments(x: float, y: float, z: float) -> Matrix:
    """Return the moments (4, 4) of an ellipsoid with these half axes, m.

    Examples
    --------
    >>> float(ellipsoid_moments(1.0, 1.0, 1.0)[3, 3]) == 4 / 3 * np.pi
    True
    """
    return _centred_moments(4.0 / 3.0 * np.pi * x * y * z, x * x / 5.0, y * y / 5.0, z * z / 5.0)


def box_moments(edges: Sequence[float]) -> Matrix:
    """Return the moments (4, 4) of a box with these edges, m."""
    return _centred_moments(float(np.prod(edges)), *(np.array(edges) ** 2 / 12.0))


def cylinder_moments(radius: float, length: float) -> Matrix:
    """Return the moments (4, 4) of a cylinder along z, m."""
    return _centred_moments(np.pi * radius**2 * length, radius**2 / 4.0, radius**2 / 4.0, length**2 / 12.0)


def capsule_moments(radius: float, length: float) -> Matrix:
    """Return the moments (4, 4) of a cylinder along z, of this length, with half balls on both ends, m."""
    r = radius
    # The centroid of a half ball lies 3 r / 8 from its flat side.
    along = r * r / 5.0 + 3.0 * length * r / 8.0 + length**2 / 4.0
    return _centred_moments(4.0 / 3.0 * np.pi * r**3, r * r / 5.0, r * r / 5.0, along) + cylinder_moments(r, length)
