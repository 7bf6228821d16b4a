"""Constraints that keep a body within a box or an ellipsoid: the moments that a density there can have."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np
import numpy.typing as npt

from steelyard.errors import InputError
from steelyard.lmi import AffineBlock
from steelyard.robot.inertia import PSEUDO_INERTIA, moment_row

from .constraint import Equality, LinkParameters, ModelLike
from .toml_section import read_rotation, read_vector

__all__ = ["DensityInBox", "DensityInEllipsoid"]

Vector = npt.NDArray[np.float64]
Matrix = npt.NDArray[np.float64]


@dataclass(frozen=True)
class DensityInEllipsoid:
    """A link whose whole mass lies within an ellipsoid (Wensing, Kim and Slotine 2018).

    Parameters
    ----------
    link : str
    center : (3,)
        In metres, in the link frame.
    semi_axes : float or (3,)
        Half the lengths of the axes, in metres; one number for a sphere.
    rotation : (3, 3) or (3,), optional
        Directions of the axes in the link frame as columns, or their roll, pitch and yaw in radians. By default the
        axes are those of the link frame.

    Raises
    ------
    InputError
        If a value is not a number, a semi-axis is not positive, or the rotation is not a rotation matrix.

    Notes
    -----
    With 1 - (r - c)ᵀ A (r - c) = (r, 1)ᵀ Q (r, 1) ≥ 0 inside, the condition is tr(P Q) ≥ 0, 1 x 1, together with the
    pseudo-inertia P ⪰ 0, which is part of ``"full"`` consistency and is added for the link under ``"inertia"``. Both
    are necessary and sufficient: where they hold, points within the ellipsoid with these moments exist (the quadratic
    functions that are not negative on an ellipsoid are those that the S-lemma gives).

    The value of the block is the mean of 1 - (r - c)ᵀ A (r - c) over the mass, times the mass, in kg.

    References
    ----------
    P. M. Wensing, S. Kim, J.-J. E. Slotine, Linear matrix inequalities for physically consistent inertial parameter
    identification, IEEE Robotics and Automation Letters 3 (2018). J. F. Sturm, S. Zhang, On cones of nonnegative
    quadratic functions, Mathematics of Operations Research 28 (2003).

    Examples
    --------
    >>> DensityInEllipsoid("forearm", center=(0, 0, 0.2), semi_axes=(0.06, 0.06, 0.25))
    DensityInEllipsoid(link='forearm', center=(0.0, 0.0, 0.2), semi_axes=(0.06, 0.06, 0.25), rotation=None)
    """

    link: str
    center: Sequence[float]
    semi_axes: float | Sequence[float]
    rotation: Sequence[Sequence[float]] | Sequence[float] | None = None

    def __post_init__(self) -> None:
        where = f"of DensityInEllipsoid of link {self.link!r}"
        object.__setattr__(self, "center", read_vector(self.center, f"center {where}", "m"))
        axes = self.semi_axes if np.ndim(self.semi_axes) else (self.semi_axes,) * 3
        object.__setattr__(self, "semi_axes", read_vector(axes, f"semi_axes {where}", "m"))
        if min(self._semi_axes) <= 0:
            raise InputError(f"semi_axes {where} must be positive, got {self.semi_axes}; a real body is not flat.")
        if self.rotation is not None:
            object.__setattr__(self, "rotation", read_rotation(self.rotation, f"rotation {where}"))

    @property
    def _semi_axes(self) -> Vector:
        return np.asarray(self.semi_axes, dtype=float)

    @property
    def quadratic(self) -> Matrix:
        """Q, (4, 4): (r, 1)ᵀ Q (r, 1) is at least 0 within the ellipsoid, and 1 at its centre."""
        rotation = np.eye(3) if self.rotation is None else np.asarray(self.rotation)
        shape = (rotation / self._semi_axes**2) @ rotation.T
        shape = 0.5 * (shape + shape.T)
        center = np.asarray(self.center)
        found = np.zeros((4, 4))
        found[:3, :3] = -shape
        found[:3, 3] = found[3, :3] = shape @ center
        found[3, 3] = 1.0 - center @ shape @ center
        return found

    def blocks(self, model: ModelLike) -> tuple[AffineBlock, ...]:
        """The pseudo-inertia, and the trace condition in kg."""
        link = LinkParameters.of(model, self.link, "DensityInEllipsoid")
        name = f"{link.title}: body within ellipsoid"
        return (_pseudo_inertia(link), link.row_block(name, "kg", moment_row(self.quadratic)))

    def equalities(self, model: ModelLike) -> tuple[Equality, ...]:
        """Return no equation: the condition is an inequality."""
        return ()


@dataclass(frozen=True)
class DensityInBox:
    """A link whose whole mass lies within a box along the axes of the link frame.

    Parameters
    ----------
    link : str
    lower, upper : (3,)
        Corners, in metres, in the link frame; finite.

    Raises
    ------
    InputError
        If a corner is not three numbers, or the box has no thickness along an axis.

    Notes
    -----
    If f and g are not negative within the box, ∫ f g dm ≥ 0, which is linear in the ten parameters if f and g are
    affine. The blocks are

    - the pseudo-inertia P ⪰ 0, part of ``"full"`` consistency, which is added for the link under ``"inertia"``;
    - all 15 products of the distances from two different faces (Sherali and Adams), such as ∫ (x - a)(b - x) dm and
      ∫ (x - a)(y - c) dm;
    - four conditions on products of the three coordinates together, the triangle inequalities of Padberg (1989).

    All are necessary. They are sufficient for moments that involve two of the axes only (Anstreicher and Burer 2010),
    and for the products of different coordinates alone. They are not known to be sufficient in general: an exact form
    needs more unknowns, and sharper conditions without these involve moments of third order, on which no torque
    depends. For 1900 random quadratic functions the least value of their mean that the conditions allow was the least
    value within the box, to 1e-8 of the range. The centre of mass is within the box as a consequence: no
    `CenterOfMassBox` is needed.

    Blocks are in kg m².

    References
    ----------
    H. D. Sherali, W. P. Adams, A reformulation-linearization technique for solving discrete and continuous nonconvex
    problems, Kluwer, 1999. M. Padberg, The Boolean quadric polytope, Mathematical Programming 45 (1989).
    K. M. Anstreicher, S. Burer, Computable representations for convex hulls of low-dimensional quadratic forms,
    Mathematical Programming 124 (2010).

    Examples
    --------
    >>> DensityInBox("forearm", lower=(-0.1, -0.1, 0.0), upper=(0.1, 0.1, 0.5))
    DensityInBox(link='forearm', lower=(-0.1, -0.1, 0.0), upper=(0.1, 0.1, 0.5))
    """

    link: str
    lower: Sequence[float]
    upper: Sequence[float]

    def __post_init__(self) -> None:
        where = f"of DensityInBox of link {self.link!r}"
        for key in ("lower", "upper"):
            object.__setattr__(self, key, read_vector(getattr(self, key), f"{key} {where}", "m"))
        for axis, low, high in zip("xyz", self.lower, self.upper, strict=True):
            if not low < high:
                raise InputError(
                    f"lower {axis} {where} must be below upper {axis}, got {low:g} and {high:g} m; a real body is "
                    "not flat."
                )

    def blocks(self, model: ModelLike) -> tuple[AffineBlock, ...]:
        """The pseudo-inertia, 15 products of distances from faces, and 4 triangle inequalities."""
        link = LinkParameters.of(model, self.link, "DensityInBox")
        faces = [
            (f"{axis} {sign} {value:g} m", function)
            for k, axis in enumerate("xyz")
            for sign, value, function in (
                (">=", self.lower[k], _affine(k, 1.0, -self.lower[k])),
                ("<=", self.upper[k], _affine(k, -1.0, self.upper[k])),
            )
        ]
        found = [_pseudo_inertia(link)]
        for (one, f), (two, g) in combinations(faces, 2):
            name = f"{link.title}: body within {one} and {two}"
            found.append(link.row_block(name, "kg m²", moment_row(_product(f, g))))
        for name, quadratic in self._triangles():
            found.append(link.row_block(f"{link.title}: body within box, {name}", "kg m²", moment_row(quadratic)))
        return tuple(found)

    def _triangles(self) -> list[tuple[str, Matrix]]:
        """For coordinates s, t, u from 0 to 1, 1 - s - t - u + st + su + tu ≥ 0, s - st - su + tu ≥ 0, and so on."""
        width = np.subtract(self.upper, self.lower)
        s, t, u = (_affine(k, 1.0 / width[k], -self.lower[k] / width[k]) for k in range(3))
        one = _affine(0, 0.0, 1.0)
        st, su, tu = _product(s, t), _product(s, u), _product(t, u)
        # Scaled to kg m², to be of the size of the other blocks.
        scale = float(np.prod(width) ** (2.0 / 3.0))
        found = [("x, y and z together", _product(one, one - s - t - u) + st + su + tu)]
        found += [
            ("x against y and z", _product(s, one) - st - su + tu),
            ("y against x and z", _product(t, one) - st - tu + su),
            ("z against x and y", _product(u, one) - su - tu + st),
        ]
        return [(name, scale * quadratic) for name, quadratic in found]

    def equalities(self, model: ModelLike) -> tuple[Equality, ...]:
        """Return no equation: the condition is an inequality."""
        return ()


def _affine(axis: int, slope: float, constant: float) -> Vector:
    """The function slope · r[axis] + constant, as a row over (r, 1)."""
    row = np.zeros(4)
    row[axis] = slope
    row[3] = constant
    return row


def _product(f: Vector, g: Vector) -> Matrix:
    """The product of two affine functions as a symmetric matrix."""
    both = np.outer(f, g)
    return 0.5 * (both + both.T)


def _pseudo_inertia(link: LinkParameters) -> AffineBlock:
    name = f"{link.title}: a positive density exists"
    return AffineBlock(name, np.zeros((4, 4)), link.indices, PSEUDO_INERTIA.copy(), "constraint")
