"""Constraints that keep the centre of mass of a link within a box or a sphere."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from steelyard.errors import InputError
from steelyard.lmi import AffineBlock

from .constraint import Equality, LinkParameters, ModelLike, equation, scalar_block
from .toml_section import read_quantity, read_vector, table

__all__ = ["CenterOfMassBox", "CenterOfMassSphere"]


@dataclass(frozen=True)
class CenterOfMassBox:
    """Keeps the centre of mass of a link within a box along the axes of the link frame (thesis 4.38).

    Parameters
    ----------
    link : str
    lower, upper : (3,)
        Corners, in metres, in the link frame. An infinite bound leaves its side open; if both bounds of a coordinate
        are equal, it is known exactly.

    Raises
    ------
    InputError
        If a corner is not three numbers or a lower bound is above the upper one.

    See Also
    --------
    DensityInBox : The whole body within the box, which is a stronger condition.

    Examples
    --------
    >>> CenterOfMassBox("forearm", lower=(-0.1, -0.1, 0.0), upper=(0.1, 0.1, 0.5))
    CenterOfMassBox(link='forearm', lower=(-0.1, -0.1, 0.0), upper=(0.1, 0.1, 0.5))
    """

    link: str
    lower: Sequence[float]
    upper: Sequence[float]

    def __post_init__(self) -> None:
        for key in ("lower", "upper"):
            try:
                corner = tuple(float(value) for value in getattr(self, key))
            except (TypeError, ValueError):
                corner = ()
            if len(corner) != 3 or any(math.isnan(value) for value in corner):
                raise InputError(
                    f"CenterOfMassBox of link {self.link!r} must have three numbers (metres) as {key}, "
                    f"got {getattr(self, key)!r}."
                )
            object.__setattr__(self, key, corner)
        for axis, low, high in zip("xyz", self.lower, self.upper, strict=True):
            if low > high:
                raise InputError(
                    f"CenterOfMassBox of link {self.link!r} has lower {axis} {low:g} m above upper {axis} {high:g} m; "
                    "swap or correct them."
                )
            if low == math.inf or high == -math.inf:
                raise InputError(f"CenterOfMassBox of link {self.link!r} leaves no room along {axis}; correct it.")

    @classmethod
    def from_dict(cls, entry: Mapping[str, Any], folder: Path | None = None) -> CenterOfMassBox:
        """From ``{"link": "link1", "lower": [..], "upper": [..]}``, as in ``robot.toml``."""
        return cls(**table(entry, "center_of_mass_box", ("link", "lower", "upper")))

    def blocks(self, model: ModelLike) -> tuple[AffineBlock, ...]:
        """At most six 1 x 1 blocks in kg m, l - m lower and m upper - l, one for each finite bound."""
        link = LinkParameters.of(model, self.link, "CenterOfMassBox")
        name = f"{link.title}: centre of mass"
        found = []
        for k, (axis, low, high) in enumerate(zip("xyz", self.lower, self.upper, strict=True)):
            places = (int(link.indices[6 + k]), link.mass)
            if low == high:
                continue
            if math.isfinite(low):
                found.append(scalar_block(f"{name} {axis} >= {low:g} m", "kg m", places, (1.0, -low), 0.0))
            if math.isfinite(high):
                found.append(scalar_block(f"{name} {axis} <= {high:g} m", "kg m", places, (-1.0, high), 0.0))
        return tuple(found)

    def equalities(self, model: ModelLike) -> tuple[Equality, ...]:
        """One equation for each coordinate that is known exactly."""
        link = LinkParameters.of(model, self.link, "CenterOfMassBox")
        exact = [k for k in range(3) if self.lower[k] == self.upper[k]]
        return tuple(_coordinate(link, k, self.lower[k]) for k in exact)


@dataclass(frozen=True)
class CenterOfMassSphere:
    """Keeps the centre of mass of a link within a sphere.

    Parameters
    ----------
    link : str
    center : (3,)
        In metres, in the link frame.
    radius : float
        In metres; 0 if the centre of mass is known exactly.

    Raises
    ------
    InputError
        If a value is not a number, or the radius is negative.

    Notes
    -----
    |l - m c| ≤ m r is the 4 x 4 block [[m r 1, l - m c], [(l - m c)ᵀ, m r]] ⪰ 0, by its Schur complement.

    Examples
    --------
    >>> CenterOfMassSphere("forearm", center=(0, 0, 0.2), radius=0.05)
    CenterOfMassSphere(link='forearm', center=(0.0, 0.0, 0.2), radius=0.05)
    """

    link: str
    center: Sequence[float]
    radius: float

    def __post_init__(self) -> None:
        where = f"of CenterOfMassSphere of link {self.link!r}"
        object.__setattr__(self, "center", read_vector(self.center, f"center {where}", "m"))
        object.__setattr__(self, "radius", read_quantity(self.radius, f"radius {where}", "m", nonnegative=True))

    @classmethod
    def from_dict(cls, entry: Mapping[str, Any], folder: Path | None = None) -> CenterOfMassSphere:
        """From ``{"link": "link1", "center": [..], "radius": 0.1}``, as in ``robot.toml``."""
        return cls(**table(entry, "center_of_mass_sphere", ("link", "center", "radius")))

    def blocks(self, model: ModelLike) -> tuple[AffineBlock, ...]:
        """One block of order 4, in kg m."""
        link = LinkParameters.of(model, self.link, "CenterOfMassSphere")
        if self.radius == 0:
            return ()
        coefficients = np.zeros((4, 4, 4))
        for k in range(3):
            coefficients[k, k, 3] = coefficients[k, 3, k] = 1.0
        coefficients[3] = self.radius * np.eye(4)
        coefficients[3, :3, 3] = coefficients[3, 3, :3] = -np.asarray(self.center)
        name = f"{link.title}: centre of mass within sphere"
        return (AffineBlock(name, np.zeros((4, 4)), link.indices[6:], coefficients + 0.0, "constraint", "kg m"),)

    def equalities(self, model: ModelLike) -> tuple[Equality, ...]:
        """Three equations if the radius is 0."""
        link = LinkParameters.of(model, self.link, "CenterOfMassSphere")
        return tuple(_coordinate(link, k, self.center[k]) for k in range(3)) if self.radius == 0 else ()


def _coordinate(link: LinkParameters, axis: int, value: float) -> Equality:
    """The equation that sets a coordinate of the centre of mass: l - m value = 0."""
    places = (int(link.indices[6 + axis]), link.mass)
    return equation(f"{link.title}: centre of mass {'xyz'[axis]} = {value:g} m", link.model, places, (1.0, -value))
