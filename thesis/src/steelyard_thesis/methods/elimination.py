"""Least squares over fewer and fewer base parameters, from one reduced regression."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from scipy.linalg import solve_triangular

from steelyard.regression import column_lengths, triangular
from steelyard.regression.factor import unidentifiable_columns

from .method import Problem

__all__ = ["Elimination"]

Vector = npt.NDArray[np.float64]
Matrix = npt.NDArray[np.float64]
Indices = npt.NDArray[np.intp]


class Elimination:
    """Backward elimination: the least squares solution while base parameters are taken out (held at zero).

    The inverse T of the triangular factor is carried along. To take out a parameter, a reflection H turns its row of T
    into a multiple of the last unit vector; the rest of T H is the inverse of the triangular factor without its column,
    and the last element of H ρ joins the residual. That takes 4 k² operations for k parameters, where a new
    factorisation takes 4 k³ / 3, and being orthogonal it loses no digits.

    Base parameters that the data does not determine have no least squares solution and are taken out first.

    Parameters
    ----------
    problem : Problem

    Attributes
    ----------
    removed : list of int
        What was taken out, in this order.
    kept : (k,)
        Base parameters that are left.
    squared_residual : float

    Examples
    --------
    >>> import steelyard as sy
    >>> model = sy.Model(sy.Robot.from_dh([(0, 0, 0, "q")], gravity=(0, -9.81, 0)))
    >>> information = sy.Information.from_factor(
    ...     10 * np.eye(3), [-0.1, 5.0, 0.0], 0.02, 100, model.base_parameters().names
    ... )
    >>> elimination = Elimination(Problem.of(information, sy.FeasibleSet(model)))
    >>> elimination.remove(0)
    >>> elimination.base.tolist(), round(elimination.squared_residual, 6)
    ([0.0, 0.5, 0.0], 0.03)
    """

    def __init__(self, problem: Problem) -> None:
        self.row_count = problem.information.count
        self._size = len(problem.rho)
        rows = np.column_stack([problem.R, problem.rho])
        kept = np.arange(self._size)
        self.removed: list[int] = []
        self.squared_residual = problem.residual2
        unidentifiable = unidentifiable_columns(rows[:, :-1])
        while unidentifiable.any():
            lengths = np.where(unidentifiable, column_lengths(rows[:, :-1]), np.inf)
            weakest = int(np.argmin(lengths))
            self.removed.append(int(kept[weakest]))
            kept = np.delete(kept, weakest)
            triangle = triangular(np.delete(rows, weakest, axis=1))
            self.squared_residual += float(triangle[-1, -1] ** 2)
            rows = triangle[:-1]
            unidentifiable = unidentifiable_columns(rows[:, :-1])
        lengths = column_lengths(rows[:, :-1])
        self.kept: Indices = kept
        self._inverse: Matrix = solve_triangular(rows[:, :-1] / lengths, np.eye(len(kept))) / lengths[:, None]
        self._target: Vector = rows[:, -1].copy()

    @property
    def base(self) -> Vector:
        """Base parameters of least squared residual, zero where taken out, (n_b,)."""
        found = np.zeros(self._size)
        found[self.kept] = self._inverse @ self._target
        return found

    @property
    def relative_standard_deviation(self) -> Vector:
        """Standard deviation over size of the parameters left (thesis eq. 4.27 to 4.29), (k,); 0.05 means 5 %."""
        variance = self.squared_residual / max(self.row_count - len(self.kept), 1)
        deviation = np.sqrt(variance * np.einsum("ij,ij->i", self._inverse, self._inverse))
        size = np.abs(self._inverse @ self._target)
        with np.errstate(divide="ignore", invalid="ignore"):
            return np.asarray(np.where(size > 0.0, deviation / size, np.inf))

    def remove(self, position: int) -> None:
        """Take out the parameter at a position of `kept`."""
        row = self._inverse[position]
        mirror = row.copy()
        mirror[-1] += np.copysign(np.linalg.norm(row), row[-1])
        factor = 2.0 / float(mirror @ mirror)
        reflected = self._inverse - np.outer(self._inverse @ mirror, factor * mirror)
        target = self._target - factor * float(mirror @ self._target) * mirror
        self.squared_residual += float(target[-1] ** 2)
        self._inverse = np.delete(reflected[:, :-1], position, axis=0)
        self._target = target[:-1]
        self.removed.append(int(self.kept[position]))
        self.kept = np.delete(self.kept, position)

    def remove_weakest(self) -> int:
        """Take out the parameter of the largest relative standard deviation and return its index."""
        position = int(np.argmax(self.relative_standard_deviation))
        self.remove(position)
        return self.removed[-1]
