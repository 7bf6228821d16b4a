"""Criteria of the information matrix by which motions are judged, their gradients, and the expected uncertainty."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from steelyard.dynamics import Model
from steelyard.errors import InputError
from steelyard.files import listed, shown
from steelyard.regression.factor import eigenvectors
from steelyard.robot import INERTIA_SYMBOLS

__all__ = [
    "CRITERIA",
    "TORQUE_NOISE",
    "Criterion",
    "Identifiability",
    "Spectrum",
    "Subset",
    "identifiability",
    "make_subset",
]

Array = NDArray[np.float64]
CRITERIA = ("condition", "d", "a", "friction")
_SQUARED = 1e-10
"""Where the least eigenvalue of an information matrix is a smaller part of the largest one, a factor is used instead.

The information matrix is a square, whose eigenvalues below 1e-16 of the largest one are rounding errors: from a start
with a condition number of 1e8 the criterion had no gradient, and the search did not progress. A factor resolves
condition numbers up to 1e15. It costs several times as much, which is not needed for well-conditioned motions."""
_FLOOR = 1e-30
"""Eigenvalues are at least this part of the largest one: the square of what a factor can resolve."""


@dataclass(frozen=True, eq=False)
class Spectrum:
    """The eigenvalues and eigenvectors of an information matrix.

    Attributes
    ----------
    values : ndarray
        (n_b,), ascending and positive: at least 1e-30 of the largest one.
    vectors : ndarray
        (n_b, n_b), one eigenvector in each column.
    """

    values: Array
    vectors: Array

    @classmethod
    def of(cls, information: Array, factor: Callable[[], Array] | None = None) -> Spectrum:
        """Return the spectrum of an information matrix.

        Parameters
        ----------
        information : ndarray
            (n_b, n_b).
        factor : callable, optional
            Returns a matrix F (rows, n_b) with ``F'F = information`` that was not computed from the information matrix.
            It is called where the eigenvalues of the information matrix are not accurate enough.
        """
        values, vectors = eigenvectors(information)
        if factor is not None and values[0] < _SQUARED * values[-1]:
            _, roots, rows = np.linalg.svd(factor(), full_matrices=False)
            values, vectors = roots[::-1] ** 2, rows[::-1].T
        return cls(_positive(values), vectors)

    def root(self, directions: Array) -> Array:
        """Return a factor (n_b, r) of the information of directions (n_b, r)."""
        return np.asarray(np.sqrt(self.values)[:, None] * (self.vectors.T @ directions))

    def inverse_root(self, directions: Array) -> Array:
        """Return a factor (n_b, r) of the covariance of directions (n_b, r)."""
        return np.asarray((self.vectors.T @ directions) / np.sqrt(self.values)[:, None])


@dataclass(frozen=True, eq=False)
class Subset:
    """The parameters that an experiment is to identify.

    Attributes
    ----------
    names : tuple of str
        Expressions of base parameters, or names of standard parameters where the nuisance parameters are known.
    directions : ndarray
        (n_b, r). Where the nuisance parameters are unknown: the unit vectors of the base parameters in the subset.
        Where they are known: the derivatives of the base parameters by the r parameters in the subset.
    nuisance_known : bool
        Whether all parameters outside the subset are known.
    """

    names: tuple[str, ...]
    directions: Array
    nuisance_known: bool


def make_subset(model: Model, subset: str | Sequence[str] | None, nuisance: str = "unknown") -> Subset:
    """Choose the parameters that an experiment is to identify.

    Parameters
    ----------
    subset : str or sequence of str, optional
        Names of parameters, of links (their ten parameters) or of joints (all the parameters of the joint's terms and
        of the link that it moves), or ``"payload"`` for the last link; None for all.
    nuisance : {"unknown", "known"}
        ``"unknown"``: the subset consists of the base parameters that contain any of the named parameters. All other
        base parameters, the nuisance parameters, are estimated from the same data, so that the information about the
        subset is the Schur complement of the information matrix (Pukelsheim 2006, section 3.11). ``"known"``: all other
        parameters are known already, as when a payload is mounted on a robot that was identified before; the subset
        consists of the named parameters that are independent of each other.

    Raises
    ------
    InputError
        If a name is unknown, or the parameters have no effect on the torques.
    """
    base = model.base_parameters()
    if nuisance not in ("unknown", "known"):
        raise InputError(f"nuisance must be 'unknown' or 'known', got {nuisance!r}.")
    if subset is None:
        return Subset(base.expressions, np.eye(base.count), True)
    names = [subset] if isinstance(subset, str) else list(subset)
    if not names:
        raise InputError("subset must name at least one parameter, link or joint; leave it out for all parameters.")
    columns = sorted({column for name in names for column in _columns(model, name)})
    effects = base.K[:, columns]
    present = np.flatnonzero(np.abs(effects).max(axis=0, initial=0.0) > 0.0)
    if not len(present):
        raise InputError(
            f"The subset {listed(names)} has no effect on the torques, so that no motion shows it; choose others."
        )
    if nuisance == "unknown":
        rows = np.flatnonzero(np.abs(effects).max(axis=1) > 0.0)
        return Subset(tuple(base.expressions[r] for r in rows), np.eye(base.count)[:, rows], False)
    kept: list[int] = []
    for k in present.tolist():  # the leftmost independent ones, as for base parameters
        if np.linalg.matrix_rank(effects[:, [*kept, k]], tol=1e-9) > len(kept):
            kept.append(k)
    return Subset(tuple(model.parameter_names[columns[k]] for k in kept), effects[:, kept], True)


def _columns(model: Model, name: str) -> list[int]:
    """Return the indices of the parameters that an entry of a subset stands for."""
    robot, names = model.robot, model.parameter_names
    if name in names:
        return [names.index(name)]
    if name in robot.link_names:
        return [int(c) for c in model.link_columns[robot.link_names.index(name)]]
    if name == "payload":
        return [int(c) for c in model.link_columns[-1]]
    if name in robot.joint_names:
        index = robot.driving_joints[robot.joint_names.index(name)]
        symbols = [*INERTIA_SYMBOLS, *(p.symbol for term in robot.terms for p in term.parameters)]
        return [names.index(f"{symbol}{index + 1}") for symbol in symbols]
    raise InputError(
        f"subset: {shown(name)} is no parameter, link or joint of {robot.name}; it has the joints "
        f"{listed(robot.joint_names)}, the links {listed(robot.link_names)}, and parameters such as {names[0]}."
    )


@dataclass(frozen=True, eq=False)
class Criterion:
    """A criterion of the quality of a motion, and its gradient by the information matrix.

    Attributes
    ----------
    kind : {"condition", "d", "a", "friction"}
        The condition number of the (weighted) regressor of the subset, the determinant of its information matrix (to be
        maximised) or the trace of the inverse of this matrix. ``"friction"`` is the determinant of the information
        about laws of friction, which are the subset.
    subset : Subset
        The parameters that count.
    """

    kind: Literal["condition", "d", "a", "friction"]
    subset: Subset

    def __post_init__(self) -> None:
        if self.kind not in CRITERIA:
            raise InputError(f"criterion must be one of {', '.join(CRITERIA)}, got {self.kind!r}.")

    def evaluate(self, spectrum: Spectrum, sharpness: float = 8.0) -> tuple[float, Array]:
        """Return a smooth objective to be minimised, and its gradient by the information matrix, symmetric.

        Parameters
        ----------
        spectrum : Spectrum
            Spectrum of the information matrix.
        sharpness : float
            Exponent of the norms that replace the extreme eigenvalues in the condition number. These norms are smooth
            where eigenvalues cross. The objective is an upper bound of twice the logarithm of the condition number,
            which becomes tighter with a larger exponent.

        Returns
        -------
        value : float
        gradient : ndarray
            (n_b, n_b).
        """
        values, vectors = self._seen(spectrum)
        if self.subset.nuisance_known:
            value, slopes = self._spectral(values, sharpness, 1.0)
            return value, (vectors * slopes) @ vectors.T
        value, slopes = self._spectral(values, sharpness, -1.0)  # of the covariance
        turned = (spectrum.vectors / np.sqrt(spectrum.values)) @ (
            spectrum.inverse_root(self.subset.directions) @ vectors
        )
        return value, -(turned * slopes) @ turned.T

    def figure(self, spectrum: Spectrum) -> float:
        """Return the criterion: the condition number, log-determinant, or trace of the inverse, without smoothing."""
        values, _ = self._seen(spectrum)
        if not self.subset.nuisance_known:
            values = 1.0 / values
        if self.kind == "condition":
            return float(np.sqrt(values.max() / values.min()))
        return float((1.0 / values).sum()) if self.kind == "a" else float(np.log(values).sum())

    def loss(self, figure: float) -> float:
        """Return the criterion with the sign with which less is better."""
        return -figure if self.kind in ("d", "friction") else figure

    def _seen(self, spectrum: Spectrum) -> tuple[Array, Array]:
        """Return eigenvalues (r,), ascending, and eigenvectors of the information of the subset, or of its covariance.

        Where the nuisance parameters are known, these are eigenvalues of the information, with the eigenvectors mapped
        to the base parameters, (n_b, r). Otherwise they are those of the covariance, with eigenvectors (r, r).
        """
        directions, known = self.subset.directions, self.subset.nuisance_known
        if known and directions.shape[0] == directions.shape[1]:  # the identity
            return spectrum.values, spectrum.vectors
        root = spectrum.root(directions) if known else spectrum.inverse_root(directions)
        _, roots, rows = np.linalg.svd(root, full_matrices=False)
        values, vectors = _positive(roots[::-1] ** 2), rows[::-1].T
        return values, directions @ vectors if known else vectors

    def _spectral(self, values: Array, sharpness: float, power: float) -> tuple[float, Array]:
        """Return objective and derivatives by the eigenvalues of the information, or of its inverse (power -1)."""
        count = len(values)
        if self.kind in ("d", "friction"):
            return -power * float(np.log(values).mean()), -power / (count * values)
        if self.kind == "a":
            terms = values**-power
            total = terms.sum()
            return float(np.log(total)), -power * terms / (values * total)
        least, largest = values[0], values[-1]
        low, high = (least / values) ** sharpness, (values / largest) ** sharpness
        value = np.log(largest / least) + (np.log(low.sum()) + np.log(high.sum())) / sharpness
        return float(value), (high / high.sum() - low / low.sum()) / values


def _positive(values: Array) -> Array:
    return np.maximum(values, _FLOOR * max(float(values[-1]), 1e-300))


TORQUE_NOISE = 0.01
"""Standard deviation of the white torque noise that is assumed, relative to the torques.

Torques from motor currents are seldom more accurate. A tenth of this noise would shift the limit of the condition
number by a factor of ten, while motions that do not excite the parameters miss it by factors of hundreds."""


@dataclass(frozen=True)
class Identifiability:
    """The expected uncertainty of the parameters with torque noise of one per cent.

    Attributes
    ----------
    uncertainty : float
        Standard deviation of the least certain combination of the parameters in the subset, relative to the 2-norm of
        all base parameters. Above 1 the motion cannot identify this combination: its error would be larger than all
        base parameters together.
    unidentifiable : tuple of str
        Where the uncertainty is above 1, the parameters that cause it, the least certain first.
    """

    uncertainty: float
    unidentifiable: tuple[str, ...]


def identifiability(spectrum: Spectrum, subset: Subset, rows: float) -> Identifiability:
    """Predict the uncertainty of the parameters of a subset.

    Base parameters with a 2-norm of 1 cause torques whose norm over all rows is at most the largest singular value of
    the regressor. The noise is taken to be one per cent of the root mean square of these torques, and the inverse of
    the information matrix gives the standard deviations of the parameters.

    Parameters
    ----------
    spectrum : Spectrum
        Spectrum of the information matrix.
    rows : float
        Number of rows of the regressor: samples times joints.

    Examples
    --------
    The information about one parameter is 1e12 times smaller than that about the other one:

    >>> subset = Subset(("m1", "m2"), np.eye(2), True)
    >>> found = identifiability(Spectrum.of(np.diag([1e6, 1e-6])), subset, rows=100)
    >>> round(found.uncertainty), found.unidentifiable
    (1000, ('m2',))
    """
    noise = TORQUE_NOISE * np.sqrt(spectrum.values[-1] / rows)
    root = spectrum.inverse_root(subset.directions)
    if subset.nuisance_known:
        # The covariance of the subset is the inverse of a block of the information, not a block of the inverse.
        own = spectrum.root(subset.directions)
        _, sizes, vectors = np.linalg.svd(own, full_matrices=False)
        root = vectors / np.maximum(sizes, np.finfo(float).tiny)[:, None]
    _, sizes, vectors = np.linalg.svd(root, full_matrices=False)
    uncertainty = float(noise * sizes[0])
    if uncertainty <= 1.0:
        return Identifiability(uncertainty, ())
    deviations = noise * np.linalg.norm(root, axis=0)
    order = np.argsort(-deviations, kind="stable")
    # Where no single parameter exceeds the limit, but a combination does, the least certain parameter is named.
    limit = min(1.0, float(deviations[order[0]]))
    return Identifiability(uncertainty, tuple(subset.names[k] for k in order if deviations[k] >= limit))
