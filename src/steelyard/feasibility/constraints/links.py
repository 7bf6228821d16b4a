"""The parameters of single links, and blocks and equations in these parameters."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import numpy.typing as npt
import scipy.linalg as linalg

from steelyard import lmi
from steelyard.errors import InputError
from steelyard.files import suggestion
from steelyard.lmi import AffineBlock
from steelyard.robot import INERTIA_SYMBOLS

from .constraint import Equality, ModelLike

__all__ = ["LinkParameters", "equation", "independent_rows", "link_index", "scalar_block"]

Vector = npt.NDArray[np.float64]
Matrix = npt.NDArray[np.float64]

_NEGLIGIBLE = 1e-12
"""Numbers below this part of the largest one are rounding errors."""

_LEAST_PIVOT = 0.1
"""Smallest pivot relative to the largest remaining element. With 1e-12, the equations of a symmetry axis that is 0.1
degrees off a plane of the frame lost five digits."""


def link_index(model: ModelLike, link: str, where: str) -> int:
    """Index of a link by name.

    Raises
    ------
    InputError
        If there is no such link; the message suggests the closest name.
    """
    names = list(model.robot.link_names)
    if link in names:
        return names.index(link)
    raise InputError(f"{where} names the link {link!r}, which the robot does not have; {suggestion(str(link), names)}")


@dataclass(frozen=True)
class LinkParameters:
    """The places of the inertial parameters of a link in a model.

    Attributes
    ----------
    model : Model
    index : int
    """

    model: ModelLike
    index: int

    @classmethod
    def of(cls, model: ModelLike, link: str, where: str) -> LinkParameters:
        """The parameters of a link by name; `where` begins the message if there is no such link."""
        return cls(model, link_index(model, link, where))

    @property
    def title(self) -> str:
        """Number and name of the link, such as ``"link 3 (forearm)"``."""
        return f"link {self.index + 1} ({list(self.model.robot.link_names)[self.index]})"

    @cached_property
    def indices(self) -> npt.NDArray[np.intp]:
        """Indices of Lxx Lxy Lxz Lyy Lyz Lzz lx ly lz m, (10,)."""
        names = list(self.model.parameter_names)
        return np.array([names.index(f"{symbol}{self.index + 1}") for symbol in INERTIA_SYMBOLS], dtype=np.intp)

    @property
    def mass(self) -> int:
        """Index of the mass."""
        return int(self.indices[9])

    @cached_property
    def terms(self) -> dict[str, int]:
        """Indices of the parameters of the terms at the link's joint, by symbol; they stand after the mass."""
        names = list(self.model.parameter_names)
        after = f"{INERTIA_SYMBOLS[0]}{self.index + 2}"
        stop = names.index(after) if after in names else len(names)
        number = str(self.index + 1)
        return {names[i].removesuffix(number): i for i in range(self.mass + 1, stop)}

    def row_block(self, name: str, unit: str, row: npt.ArrayLike) -> AffineBlock:
        """The 1 x 1 block row · (the ten parameters)."""
        return scalar_block(name, unit, self.indices, row, 0.0)


def scalar_block(
    name: str, unit: str, indices: Sequence[int] | npt.NDArray[np.intp], row: npt.ArrayLike, constant: float
) -> AffineBlock:
    """The 1 x 1 block row · δ[indices] + constant; zeros of the row are left out."""
    values = np.asarray(row, dtype=float)
    used = np.flatnonzero(values)
    return AffineBlock(
        name,
        np.array([[float(constant)]]),
        np.asarray(indices, dtype=np.intp)[used],
        values[used].reshape(-1, 1, 1),
        kind="constraint",
        unit=unit,
    )


def equation(
    what: str, model: ModelLike, indices: Sequence[int] | npt.NDArray[np.intp], row: npt.ArrayLike, value: float = 0.0
) -> Equality:
    """The equation row · δ[indices] = value; its name begins with `what`, and contains the equation."""
    values = np.asarray(row, dtype=float)
    used = np.flatnonzero(values)
    places = np.asarray(indices, dtype=np.intp)[used]
    names = list(model.parameter_names)
    text = lmi.LinearExpression({names[i]: float(f"{v:.6g}") for i, v in zip(places, values[used], strict=True)})
    return Equality(f"{what}: {text} = {value:g}", places, values[used], float(value))


def independent_rows(matrix: Matrix) -> Matrix:
    """Independent rows with the same null space, each with a 1 where all others have 0, by Gauss and Jordan.

    The pivot is in the left-most column that has an element not much smaller than the largest one, since small pivots
    would increase rounding errors.

    Parameters
    ----------
    matrix : (rows, c)

    Returns
    -------
    (rank, c)

    Examples
    --------
    >>> independent_rows(np.array([[0.0, -2.0, 0.0], [0.0, 4.0, 0.0], [1.0, 1.0, 1.0]])).tolist()
    [[1.0, 0.0, 1.0], [0.0, 1.0, 0.0]]
    """
    _, triangle, order = linalg.qr(np.asarray(matrix, dtype=float).T, mode="economic", pivoting=True)
    sizes = np.abs(np.diag(triangle))
    rank = int(np.sum(sizes > _NEGLIGIBLE * sizes.max(initial=0.0)))
    rows = np.array(matrix, dtype=float)[np.sort(order[:rank])]
    pivots: list[int] = []
    for row in range(rank):
        largest = np.abs(rows[row:]).max(axis=0)
        column = int(np.argmax(largest >= _LEAST_PIVOT * largest.max()))
        place = row + int(np.argmax(np.abs(rows[row:, column])))
        rows[[row, place]] = rows[[place, row]]
        rows[row] /= rows[row, column]
        others = np.arange(rank) != row
        rows[others] -= np.outer(rows[others, column], rows[row])
        rows[others, column] = 0.0
        pivots.append(column)
    found = rows[np.argsort(pivots)]
    found[np.abs(found) <= _NEGLIGIBLE * np.abs(found).max(axis=1, initial=0.0, keepdims=True)] = 0.0
    return np.asarray(found + 0.0)
