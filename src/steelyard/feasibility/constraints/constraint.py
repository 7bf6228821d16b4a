"""The interface of constraints, which give blocks and equations for a model, and how several are combined.

The parameters of single links, and blocks and equations in these parameters, are at hand for those who write one.
"""

from __future__ import annotations

import contextlib
from collections.abc import Iterable, Sequence
from dataclasses import MISSING, dataclass, fields, replace
from typing import Any, Protocol

import numpy as np
import numpy.typing as npt
import scipy.linalg as linalg

from steelyard import dynamics, lmi
from steelyard.errors import InputError, faults_told
from steelyard.files import shown, suggestion
from steelyard.lmi import AffineBlock
from steelyard.once import cached_property
from steelyard.robot import INERTIA_SYMBOLS

__all__ = [
    "Constraint",
    "Equality",
    "LinkParameters",
    "ModelLike",
    "blocks_of",
    "call_text",
    "distinct_blocks",
    "equalities_of",
    "equation",
    "independent_equalities",
    "independent_rows",
    "link_index",
    "scalar_block",
    "solved_for_some",
]

Vector = npt.NDArray[np.float64]
Matrix = npt.NDArray[np.float64]

_DEPENDENT = 1e-9
"""An equation counts as a combination of others if the rest that is orthogonal to them is less than this part of it."""

_ROUNDING = 1e-14
"""Relative rounding error of an equation as it is given."""


class ModelLike(Protocol):
    """The part of a model that feasibility uses; `Model` has it, and classes of your own may have it too."""

    @property
    def robot(self) -> Any:
        """The robot, with `link_names`, and `parameters` of the description, (n,), NaN where unknown."""

    @property
    def parameter_names(self) -> Sequence[str]:
        """Names of the standard parameters, (n,)."""

    def base_parameters(self) -> dynamics.BaseParameters:
        """The base parameters β = K δ, with K = [1 K_d] Pᵀ (thesis 2.41, 3.9)."""

    def conditions(self, consistency: str) -> tuple[AffineBlock, ...]:
        """The conditions of links and terms under ``"inertia"`` or ``"full"`` consistency."""


@dataclass(frozen=True, eq=False)
class Equality:
    """A linear equation coefficients · δ[indices] = value.

    Attributes
    ----------
    name : str
        The equation in words, e.g. ``"total mass = 27 kg"``.
    indices : (c,)
        Indices of its parameters.
    coefficients : (c,)
    value : float
    """

    name: str
    indices: npt.NDArray[np.intp]
    coefficients: npt.NDArray[np.float64]
    value: float

    def __repr__(self) -> str:
        plural = "" if len(self.indices) == 1 else "s"
        return f"Equality({self.name!r}, of {len(self.indices)} parameter{plural})"


def call_text(constraint: Any, *given: object) -> str:
    """Return the call that makes a constraint: with these arguments, and by name what is not as it is by default."""
    values = [(one.name, getattr(constraint, one.name), one.default) for one in fields(constraint)]
    named = (f"{name}={value!r}" for name, value, default in values if default is not MISSING and value != default)
    return f"{type(constraint).__name__}({', '.join([*map(repr, given), *named])})"


class Constraint(Protocol):
    """An object that gives blocks and equations for a model; you may add classes of your own.

    Examples
    --------
    >>> class Heavy:
    ...     def blocks(self, model):
    ...         mass = list(model.parameter_names).index("m1")
    ...         return (AffineBlock("link 1 >= 2 kg", -2 * np.eye(1), np.array([mass]), np.ones((1, 1, 1))),)
    ...
    ...     def equalities(self, model):
    ...         return ()
    >>> from steelyard.dynamics import Model
    >>> from steelyard.feasibility import FeasibleSet
    >>> from steelyard.robot import Robot
    >>> FeasibleSet(Model(Robot.from_dh([("0", 0.0, 0.0, "q")])), constraints=[Heavy()]).blocks[-1].name
    'link 1 >= 2 kg'
    """

    def blocks(self, model: ModelLike) -> tuple[AffineBlock, ...]:
        """Matrices that must be positive semidefinite."""

    def equalities(self, model: ModelLike) -> tuple[Equality, ...]:
        """Equations that must hold."""


def blocks_of(constraint: Constraint, model: ModelLike) -> tuple[AffineBlock, ...]:
    """The blocks of a constraint, which may be of a class of another package.

    Raises
    ------
    InputError
        If they are no blocks in the parameters of the model.
    """
    with _told(constraint):
        blocks = tuple(constraint.blocks(model))
        for block in blocks:
            if not isinstance(block, AffineBlock):
                raise TypeError(f"expected AffineBlock as blocks, got {shown(block)}")
            values = (block.constant, block.coefficients)
            _check_parameters(block.name, block.indices, values, model)
        # What a constraint says is no law of physics, whatever the default of the class is.
        return tuple(b if b.kind == "constraint" else replace(b, kind="constraint") for b in blocks)


def equalities_of(constraint: Constraint, model: ModelLike) -> tuple[Equality, ...]:
    """The equations of a constraint, which may be of a class of another package.

    Raises
    ------
    InputError
        If they are no equations in the parameters of the model.
    """
    with _told(constraint):
        equalities = tuple(constraint.equalities(model))
        for one in equalities:
            if not isinstance(one, Equality):
                raise TypeError(f"expected Equality as equalities, got {shown(one)}")
            if np.shape(one.indices) != np.shape(one.coefficients):
                raise ValueError(f"{one.name!r} has other numbers of indices and of coefficients")
            _check_parameters(one.name, one.indices, (one.coefficients, np.asarray(one.value)), model)
        return equalities


def _told(constraint: Constraint) -> contextlib.AbstractContextManager[None]:
    """Faults of other packages' classes become a sentence; ours are faults of this program."""
    kind = type(constraint)
    if kind.__module__.partition(".")[0] == __package__.partition(".")[0]:
        return contextlib.nullcontext()
    return faults_told(f"The constraint {kind.__name__} cannot be used", "mend its class")


def _check_parameters(name: str, indices: Any, values: Iterable[Any], model: ModelLike) -> None:
    places, count = np.asarray(indices), len(model.parameter_names)
    if places.dtype.kind != "i" or places.ndim != 1 or (places.size and not 0 <= places.min() <= places.max() < count):
        raise ValueError(f"the indices of {name!r} must be whole numbers from 0 to {count - 1}, got {shown(indices)}")
    if not all(np.isfinite(array).all() for array in values):
        raise ValueError(f"{name!r} holds a number that is not finite")


def distinct_blocks(blocks: Iterable[AffineBlock]) -> tuple[AffineBlock, ...]:
    """Leave out blocks that are equal to an earlier one, and number those that share a name.

    Examples
    --------
    >>> one = AffineBlock("mass", np.zeros((1, 1)), np.array([9]), np.ones((1, 1, 1)))
    >>> other = AffineBlock("mass", np.ones((1, 1)), np.array([9]), np.ones((1, 1, 1)))
    >>> [block.name for block in distinct_blocks([one, one, other])]
    ['mass', 'mass (2)']
    """
    found: list[AffineBlock] = []
    seen: set[tuple[bytes, ...]] = set()
    names: set[str] = set()
    for block in blocks:
        order = np.argsort(block.indices, kind="stable")
        parts = (block.constant + 0.0, block.indices[order].astype(np.int64), block.coefficients[order] + 0.0)
        content = tuple(part.tobytes() for part in parts)
        if content in seen:
            continue
        seen.add(content)
        name, number = block.name, 1
        while name in names:
            number += 1
            name = f"{block.name} ({number})"
        names.add(name)
        found.append(block if name == block.name else replace(block, name=name))
    return tuple(found)


def independent_equalities(equalities: Iterable[Equality], parameter_count: int) -> tuple[Equality, ...]:
    """Leave out equations that follow from earlier ones.

    Raises
    ------
    InputError
        If equations contradict each other; names them.

    Examples
    --------
    >>> def mass(value):
    ...     return Equality(f"mass = {value} kg", np.array([9]), np.ones(1), value)
    >>> independent_equalities([mass(3.0), mass(3.0)], 10)
    (Equality('mass = 3.0 kg', of 1 parameter),)
    >>> independent_equalities([mass(3.0), mass(4.0)], 10)
    Traceback (most recent call last):
    ...
    steelyard.errors.InputError: the constraint 'mass = 4.0 kg' contradicts 'mass = 3.0 kg'; remove or correct one.
    """
    given = list(equalities)
    most = min(len(given), parameter_count)
    # Gram-Schmidt: the rows that are kept are triangle @ basis.
    basis, triangle = np.zeros((most, parameter_count)), np.zeros((most, most))
    kept: list[Equality] = []
    values, errors = np.zeros(most), np.zeros(most)
    for equality in given:
        row = np.zeros(parameter_count)
        np.add.at(row, equality.indices, equality.coefficients)
        length = float(np.linalg.norm(row))
        if length == 0.0:
            if equality.value != 0.0:
                raise InputError(f"the constraint {equality.name!r} cannot hold for any parameters; remove it.")
            continue
        row, value, count = row / length, equality.value / length, len(kept)
        rest, along = row, np.zeros(count)
        for _ in range(2):
            step = basis[:count] @ rest
            along, rest = along + step, rest - step @ basis[:count]
        left = float(np.linalg.norm(rest))
        # The rest of a nearly dependent equation has lost digits, and so have the rests that are computed from it.
        error = _ROUNDING + float(np.abs(along) @ errors[:count])
        if left > max(_DEPENDENT, error):
            errors[count] = error / left
            basis[count], triangle[count, :count], triangle[count, count] = rest / left, along, left
            values[count] = value
            kept.append(equality)
            continue
        weights = np.linalg.solve(triangle[:count, :count].T, along)
        terms = weights * values[:count]
        if abs(value - terms.sum()) > _DEPENDENT * (abs(value) + np.abs(terms).sum()):
            others = [kept[i].name for i in np.flatnonzero(np.abs(weights) > _DEPENDENT)]
            raise InputError(_contradiction(equality.name, others))
    return tuple(kept)


def _contradiction(name: str, others: list[str]) -> str:
    if len(others) == 1:
        return f"the constraint {name!r} contradicts {others[0]!r}; remove or correct one."
    listed = ", ".join(map(repr, others[:6])) + (" and others" if len(others) > 6 else "")
    return f"the constraint {name!r} contradicts these together: {listed}; remove or correct one."


def solved_for_some(matrix: Matrix, values: Vector) -> tuple[npt.NDArray[np.intp], Matrix, Vector]:
    """Solve independent equations E δ = f for the parameters with the largest coefficients.

    Parameters
    ----------
    matrix : (r, n)
        E.
    values : (r,)
        f.

    Returns
    -------
    (r,) int
        Indices of the parameters that are solved for.
    (r, n)
        R, with zeros in their columns: δ[which] = constant - R δ.
    (r,)
        The constant.

    Examples
    --------
    >>> solved_for_some(np.array([[0.0, -2.0, 1.0]]), np.array([4.0]))
    (array([1]), array([[ 0. ,  0. , -0.5]]), array([-2.]))
    """
    both = np.column_stack([matrix, values])
    count, width = matrix.shape
    which = np.zeros(count, dtype=np.intp)
    for row in range(count):
        place = int(np.argmax(np.abs(both[row:, :width]).max(axis=1)))
        both[[row, row + place]] = both[[row + place, row]]
        column = int(np.argmax(np.abs(both[row, :width])))
        which[row] = column
        both[row] /= both[row, column]
        others = np.arange(count) != row
        both[others] -= np.outer(both[others, column], both[row])
        both[others, column] = 0.0
    rest = both[:, :width]
    rest[np.arange(count), which] = 0.0
    rest[np.abs(rest) < 1e-14] = 0.0
    return which, rest + 0.0, both[:, width] + 0.0


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
    what: str, model: ModelLike, indices: Sequence[int] | npt.NDArray[np.intp], row: npt.ArrayLike
) -> Equality:
    """The equation row · δ[indices] = 0; its name begins with `what`, and contains the equation."""
    values = np.asarray(row, dtype=float)
    used = np.flatnonzero(values)
    places = np.asarray(indices, dtype=np.intp)[used]
    names = list(model.parameter_names)
    text = lmi.LinearExpression({names[i]: float(f"{v:.6g}") for i, v in zip(places, values[used], strict=True)})
    return Equality(f"{what}: {text} = 0", places, values[used], 0.0)


def independent_rows(matrix: Matrix) -> Matrix:
    """Independent rows (rank, c) with the null space of a matrix (rows, c), each with a 1 where all others have 0.

    By Gauss and Jordan. The pivot is in the left-most column that has an element not much smaller than the largest one,
    since small pivots would increase rounding errors.

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
