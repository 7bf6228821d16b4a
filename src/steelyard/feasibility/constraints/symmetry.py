"""Constraints for symmetric links, and for pairs of equal or mirrored links."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from steelyard.errors import InputError
from steelyard.files import is_real, read_whole
from steelyard.lmi import AffineBlock
from steelyard.robot.inertia import transformation
from steelyard.robot.placement import axis_frame

from .constraint import Equality, LinkParameters, ModelLike, call_text, equation, independent_rows
from .toml_section import read_placement, read_vector

__all__ = ["EqualLinks", "SymmetricLink"]

Matrix = npt.NDArray[np.float64]

_PLANES = {"yz": (1.0, 0.0, 0.0), "xz": (0.0, 1.0, 0.0), "xy": (0.0, 0.0, 1.0)}
_PLANES |= {name[::-1]: normal for name, normal in _PLANES.items()}
_AXES = {"x": (1.0, 0.0, 0.0), "y": (0.0, 1.0, 0.0), "z": (0.0, 0.0, 1.0)}


@dataclass(frozen=True)
class SymmetricLink:
    """Makes the mass of a link symmetric about one or more planes, or about an axis.

    Parameters
    ----------
    link : str
    plane : str, (3,), or a list of these, optional
        ``"xy"``, ``"xz"`` or ``"yz"``, or the normal of the plane in the link frame.
    axis : str or (3,), optional
        ``"x"``, ``"y"`` or ``"z"``, or its direction in the link frame.
    order : int, optional
        Order of the symmetry about the axis: 2 for a link that looks the same after half a turn. Orders from 3 on and
        bodies of revolution (the default) restrict the moments equally.
    through : (3,)
        A point on all the planes and the axis, in metres, in the link frame; its origin by default.

    Raises
    ------
    InputError
        If neither plane nor axis is given, or one is invalid.

    Notes
    -----
    A symmetry T does not change the pseudo-inertia, T P Tᵀ = P, which is linear in the ten parameters: for the plane yz
    through the origin Lxy = Lxz = lx = 0; for the axis z also Lyz = ly = 0 and Lxx = Lyy. Only independent equations
    are given.

    Examples
    --------
    >>> SymmetricLink("forearm", plane="xz")
    SymmetricLink('forearm', plane='xz')
    """

    link: str
    plane: Any = None
    axis: Any = None
    order: int | None = None
    through: Sequence[float] = (0.0, 0.0, 0.0)

    def __post_init__(self) -> None:
        where = f"SymmetricLink of link {self.link!r}"
        object.__setattr__(self, "through", read_vector(self.through, f"through of {where}", "m"))
        if self.plane is None and self.axis is None:
            raise InputError(f"{where} needs a plane or an axis; give for example plane='xz' or axis='z'.")
        if self.plane is not None:
            object.__setattr__(self, "plane", _several(self.plane, where))
        if self.axis is not None:
            object.__setattr__(self, "axis", _direction(self.axis, _AXES, f"axis of {where}"))
        if self.order is not None:
            if self.axis is None:
                raise InputError(f"{where} has an order without an axis; give an axis, or leave the order out.")
            read_whole(self.order, f"order of {where}", 2)

    def __repr__(self) -> str:
        return call_text(self, self.link)

    def symmetries(self) -> list[tuple[str, Matrix]]:
        """The isometries (4, 4) that leave the link as it is, each with its name."""
        found = []
        planes = () if self.plane is None else self.plane if _is_list(self.plane) else (self.plane,)
        for plane in planes:
            normal = _unit_vector(plane, _PLANES)
            found.append((f"symmetric about {_shown(plane, 'plane')}", _reflection(normal, self.through)))
        if self.axis is not None:
            name = f"symmetric about {_shown(self.axis, 'axis')}"
            found.append((name, _turn(_unit_vector(self.axis, _AXES), self.through, half=self.order == 2)))
        return found

    def blocks(self, model: ModelLike) -> tuple[AffineBlock, ...]:
        """Return no block: the condition is an equation."""
        return ()

    def equalities(self, model: ModelLike) -> tuple[Equality, ...]:
        """The equations that the symmetries impose on the ten parameters."""
        link = LinkParameters.of(model, self.link, "SymmetricLink")
        symmetries = self.symmetries()
        rows = independent_rows(np.vstack([transformation(matrix) - np.eye(10) for _, matrix in symmetries]))
        what = f"{link.title} {' and '.join(name for name, _ in symmetries)}"
        return tuple(equation(what, model, link.indices, row) for row in rows)


@dataclass(frozen=True)
class EqualLinks:
    """Makes two links equal or mirror images, such as those of a left and a right limb.

    Parameters
    ----------
    first, second : str
        Names of the links.
    mirror : str or (3,), optional
        Plane through the origin of the link frames, ``"xy"``, ``"xz"`` or ``"yz"``, or its normal, if the second body
        is the mirror image of the first one drawn in its frame.
    placement : (4, 4), or mapping with xyz and rpy, optional
        Needed if the link frames lie differently in the two bodies: the point r in the frame of the first link is at
        placement (r, 1) in that of the second (m and rad). It is applied after the mirror.
    terms : bool or sequence of str
        Whether the parameters of the terms of the two joints, such as friction and rotor inertia, are equal too; or the
        symbols of those that are, such as ``["Fvj", "Fcj"]``. Offsets are rarely equal, since they also come from
        sensors.

    Raises
    ------
    InputError
        If a value is invalid, or both links are the same.

    Notes
    -----
    P₂ = T P₁ Tᵀ with the pseudo-inertias P and the isometry T: ten linear equations.

    Examples
    --------
    >>> EqualLinks("left_forearm", "right_forearm", mirror="xz", terms=True)
    EqualLinks('left_forearm', 'right_forearm', mirror='xz', terms=True)
    """

    first: str
    second: str
    mirror: Any = None
    placement: Any = None
    terms: bool | Sequence[str] = False

    def __post_init__(self) -> None:
        where = f"EqualLinks of {self.first!r} and {self.second!r}"
        if self.first == self.second:
            raise InputError(f"{where} names one link twice; name two links.")
        if self.mirror is not None:
            object.__setattr__(self, "mirror", _direction(self.mirror, _PLANES, f"mirror of {where}"))
        if self.placement is not None:
            object.__setattr__(self, "placement", read_placement(self.placement, f"placement of {where}"))
        if not isinstance(self.terms, bool):
            symbols = (self.terms,) if isinstance(self.terms, str) else self.terms
            if not isinstance(symbols, Sequence) or not all(isinstance(symbol, str) for symbol in symbols):
                raise InputError(f"terms of {where} must be true, false or a list of symbols, got {self.terms!r}.")
            object.__setattr__(self, "terms", tuple(dict.fromkeys(symbols)))

    def __repr__(self) -> str:
        return call_text(self, self.first, self.second)

    def blocks(self, model: ModelLike) -> tuple[AffineBlock, ...]:
        """Return no block: the condition is an equation."""
        return ()

    def equalities(self, model: ModelLike) -> tuple[Equality, ...]:
        """Ten equations for the bodies, and one for each parameter of the terms."""
        first = LinkParameters.of(model, self.first, "EqualLinks")
        second = LinkParameters.of(model, self.second, "EqualLinks")
        isometry = np.eye(4)
        if self.mirror is not None:
            isometry = _reflection(_unit_vector(self.mirror, _PLANES), (0.0, 0.0, 0.0))
        if self.placement is not None:
            isometry = np.asarray(self.placement) @ isometry
        rows = np.hstack([-transformation(isometry), np.eye(10)])
        what = f"{second.title} {'mirrors' if self.mirror is not None else 'equals'} {first.title}"
        places = np.concatenate([first.indices, second.indices])
        found = [equation(what, model, places, row) for row in rows]
        found += [equation(what, model, pair, (-1.0, 1.0)) for pair in self._terms(first, second)]
        return tuple(found)

    def _terms(self, first: LinkParameters, second: LinkParameters) -> list[tuple[int, int]]:
        if self.terms is False:
            return []
        symbols = tuple(first.terms) if self.terms is True else tuple(self.terms)
        for symbol in (*symbols, *(second.terms if self.terms is True else ())):
            for link in (first, second):
                if symbol not in link.terms:
                    known = ", ".join(link.terms) or "none"
                    raise InputError(
                        f"EqualLinks asks for equal {symbol!r}, which the joint of {link.title} does not have (it has "
                        f"{known}); list the symbols that both have as terms."
                    )
        return [(first.terms[symbol], second.terms[symbol]) for symbol in symbols]


def _is_list(value: Any) -> bool:
    """Return whether a value lists several planes rather than one."""
    return not isinstance(value, str) and not all(map(is_real, value))


def _several(value: Any, where: str) -> Any:
    """One plane, or a tuple of planes, with names kept and normals as tuples."""
    if isinstance(value, np.ndarray):
        value = value.tolist()
    if isinstance(value, Sequence) and not isinstance(value, str) and len(value) and _is_list(value):
        return tuple(_direction(plane, _PLANES, f"plane of {where}") for plane in value)
    return _direction(value, _PLANES, f"plane of {where}")


def _direction(value: Any, names: Mapping[str, tuple[float, float, float]], what: str) -> Any:
    if isinstance(value, str):
        if value not in names:
            raise InputError(f"{what} must be {', '.join(names)} or three numbers, got {value!r}.")
        return value
    vector = read_vector(value, what, "")
    if not any(vector):
        raise InputError(f"{what} must not be zero; give a direction, got {vector}.")
    return vector


def _unit_vector(value: Any, names: Mapping[str, tuple[float, float, float]]) -> Matrix:
    """Return the vector with length 1, with exact zeros and ones along the axes of the frame."""
    return axis_frame(names[value] if isinstance(value, str) else value)[:3, 2]


def _shown(value: Any, what: str) -> str:
    if isinstance(value, str):
        return f"{what} {value}"
    numbers = ", ".join(f"{x:g}" for x in value)
    return f"plane with normal ({numbers})" if what == "plane" else f"axis ({numbers})"


def _about(linear: Matrix, through: Sequence[float]) -> Matrix:
    """The isometry with this linear part that leaves a point where it is."""
    point = np.asarray(through, dtype=float)
    found = np.eye(4)
    found[:3, :3] = linear
    found[:3, 3] = point - linear @ point
    return found + 0.0


def _reflection(normal: Matrix, through: Sequence[float]) -> Matrix:
    return _about(np.eye(3) - 2.0 * np.outer(normal, normal), through)


def _turn(axis: Matrix, through: Sequence[float], half: bool) -> Matrix:
    """Half a turn, or a quarter turn, which changes all moments except those that no turn changes."""
    if half:
        return _about(2.0 * np.outer(axis, axis) - np.eye(3), through)
    x, y, z = axis
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return _about(np.outer(axis, axis) + cross, through)
