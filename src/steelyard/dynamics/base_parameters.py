"""Base parameters: the combinations of parameters that the torques depend on (thesis section 2.5.1)."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

__all__ = ["BaseParameters", "base_parameters_of"]

Matrix = NDArray[np.float64]
_CLEAR_GAP = 100.0
_SURE_DIGITS, _COINCIDENCE = 6, 500.0  # decimals this short are met at once; others may be met by chance, 2 in this


@dataclass(frozen=True, eq=False)
class BaseParameters:
    """The map from the n standard parameters to the n_b base parameters, ``beta = K delta`` (thesis eq. 2.53).

    Attributes
    ----------
    parameter_names : tuple of str
        The n standard parameters.
    independent : ndarray of int
        Indices of the n_b left-most independent columns of the regressor.
    dependent : ndarray of int
        Indices of the others, of which some have no effect at all.
    Kd : ndarray
        (n_b, n_d): ``H_d = H_b Kd`` (thesis eq. 2.47).
    gap : float
        How clearly the rank shows: the smallest relative distance of an independent column from those left of it,
        over the largest one of a dependent column (or rounding, if that is larger). Above 100 is clear.

    Examples
    --------
    >>> import steelyard as sy
    >>> robot = sy.Robot.from_dh([(0, 1.0, 0, "q"), (0, 1.0, 0, "q")], gravity=(0, -9.81, 0))
    >>> base = sy.Model(robot).base_parameters()
    >>> base.expressions[:2]
    ('Lzz1 - m1 - m2', 'lx1 + m1 + m2')
    """

    parameter_names: tuple[str, ...]
    independent: NDArray[np.intp]
    dependent: NDArray[np.intp]
    Kd: Matrix
    gap: float

    def __repr__(self) -> str:
        return f"BaseParameters({self.count} of {len(self.parameter_names)}, gap {self.gap:.1e})"

    def _repr_html_(self) -> str:
        rows = "".join(f"<tr><td>{i + 1}</td><td>{text}</td></tr>" for i, text in enumerate(self.expressions))
        return f"<table><caption>{self.count} base parameters</caption>{rows}</table>"

    @property
    def count(self) -> int:
        """Number n_b of base parameters."""
        return len(self.independent)

    @property
    def names(self) -> tuple[str, ...]:
        """The independent parameter that leads each combination."""
        return tuple(self.parameter_names[i] for i in self.independent)

    @cached_property
    def K(self) -> Matrix:
        """Map from standard to base parameters, (n_b, n)."""
        matrix = np.zeros((self.count, len(self.parameter_names)))
        matrix[np.arange(self.count), self.independent] = 1.0
        matrix[:, self.dependent] = self.Kd
        return matrix

    @cached_property
    def Pb(self) -> Matrix:
        """Columns of the permutation that pick the independent parameters, (n, n_b) (thesis eq. 2.48)."""
        return np.eye(len(self.parameter_names))[:, self.independent]

    @cached_property
    def Pd(self) -> Matrix:
        """Columns of the permutation that pick the dependent parameters, (n, n_d) (thesis eq. 2.48)."""
        return np.eye(len(self.parameter_names))[:, self.dependent]

    def values(self, parameters: ArrayLike) -> Matrix:
        """Return the base parameters (n_b,) of standard parameters (n,)."""
        return np.asarray(self.K @ np.asarray(parameters, dtype=np.float64))

    @cached_property
    def expressions(self) -> tuple[str, ...]:
        """Each combination in words, such as ``"Lyy1 + Iam1 + Lzz2"``."""
        return tuple(self._expression(row) for row in range(self.count))

    def _expression(self, row: int) -> str:
        text = str(self.parameter_names[self.independent[row]])
        for column in np.flatnonzero(self.Kd[row]):
            coefficient = float(self.Kd[row, column])
            size = f"{abs(coefficient):.8g}*" if abs(coefficient) != 1.0 else ""
            text += f" {'-' if coefficient < 0 else '+'} {size}{self.parameter_names[self.dependent[column]]}"
        return text


def base_parameters_of(regressor: Matrix, parameter_names: tuple[str, ...]) -> BaseParameters:
    """Find the left-most independent columns of a regressor, and the others in terms of them.

    Each column is independent or not by its distance from the span of those left of it, relative to its own length or
    to that of a typical column, whichever is longer: what the motion hardly shows does not count. Where to draw the
    line is decided by a gap between these distances, looked for from 1e-4 down, and the gap is reported.

    Parameters
    ----------
    regressor : ndarray
        (rows, n), many random motions stacked; rows well above n.
    parameter_names : tuple of str

    Returns
    -------
    BaseParameters
    """
    lengths = np.linalg.norm(regressor, axis=0)
    present = np.flatnonzero(lengths > 0.0)
    typical = float(np.median(lengths[present])) if len(present) else 1.0
    scale = np.maximum(lengths[present], typical)
    factor: Matrix = np.zeros((0, 0))
    if len(present):
        factor = np.asarray(np.linalg.qr(regressor[:, present] / scale, mode="r"))
    best: tuple[float, float, NDArray[np.intp]] = (0.0, 0.0, np.zeros(0, dtype=np.intp))
    for exponent in range(4, 13):
        distances = _distances(factor, 10.0**-exponent)
        chosen = distances > 10.0**-exponent
        dropped = max(float(distances[~chosen].max(initial=0.0)), 1e-15)
        gap = float(distances[chosen].min(initial=1.0)) / dropped
        if gap > best[0]:
            best = (gap, dropped, np.flatnonzero(chosen))
        if gap > _CLEAR_GAP:
            break
    gap, dropped, kept = best
    independent = present[kept]
    dependent = np.setdiff1d(np.arange(len(parameter_names)), independent)
    combinations = np.zeros((len(independent), len(dependent)))
    rest = np.setdiff1d(np.arange(len(present)), kept)
    if len(rest) and len(kept):
        solved = np.linalg.lstsq(factor[:, kept], factor[:, rest], rcond=None)[0]
        solved[np.abs(solved) < 10.0 * dropped] = 0.0
        solved = solved / scale[kept][:, None] * scale[rest][None, :]
        combinations[:, np.searchsorted(dependent, present[rest])] = _rounded(solved)
    return BaseParameters(parameter_names, independent, dependent, combinations, gap)


def _distances(factor: Matrix, threshold: float) -> Matrix:
    """Distance of each column from the span of the independent ones left of it, by Gram-Schmidt done twice."""
    rows, count = factor.shape
    basis = np.zeros((rows, min(rows, count)))
    size = 0
    distances = np.zeros(count)
    for j in range(count):
        column = factor[:, j].copy()
        for _ in range(2):
            column -= basis[:, :size] @ (basis[:, :size].T @ column)
        distances[j] = np.linalg.norm(column)
        if distances[j] > threshold and size < basis.shape[1]:
            basis[:, size] = column / distances[j]
            size += 1
    return distances


def _rounded(values: Matrix) -> Matrix:
    """Round to the shortest decimal within the noise of the computation, where that is no coincidence.

    Lengths are decimals of a few digits, and so are their squares and products. A number without end is left as it is:
    it is near some decimal of ten digits or more, too.
    """
    result = values.copy()
    open_ = np.ones(values.shape, dtype=bool)
    size = np.maximum(1.0, np.abs(values))
    for digits in range(11):
        noise = (2e-12 if digits <= _SURE_DIGITS else 1e-13) * size
        short = np.round(values, digits)
        close = open_ & (np.abs(short - values) <= noise) & (_COINCIDENCE * noise <= 10.0**-digits)
        result[close] = short[close]
        open_ &= ~close
    return result + 0.0
