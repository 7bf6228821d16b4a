"""What makes a motion good: criteria of the information matrix, their gradients, and what noise leaves uncertain."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from steelyard.dynamics import Model
from steelyard.errors import InputError
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
CRITERIA = ("condition", "d", "a")
_SQUARED = 1e-10
"""Where the least eigenvalue of an information is a smaller part of the largest one, it is taken from a factor.

The information is a square, whose eigenvalues below 1e-16 of the largest one are rounding errors: from a start with a
condition number of 1e8 the criterion had no gradient, and the search went nowhere. A factor gives condition numbers up
to 1e15, for some times the cost, which well-conditioned motions need not pay."""
_FLOOR = 1e-30


@dataclass(frozen=True, eq=False)
class Spectrum:
    """An information matrix by its eigenvalues and eigenvectors.

    Attributes
    ----------
    values : ndarray
        (n_b,), ascending, all positive: at least 1e-30 of the largest.
    vectors : ndarray
        (n_b, n_b), in columns.
    """

    values: Array
    vectors: Array

    @classmethod
    def of(cls, information: Array, factor: Callable[[], Array] | None = None) -> Spectrum:
        """Return the spectrum of an information.

        Parameters
        ----------
        information : ndarray
            (n_b, n_b).
        factor : callable, optional
            Returns a matrix F (rows, n_b) with ``F'F = information`` that was not made from the information. It is
            asked for where the eigenvalues of the square are not accurate enough.
        """
        values, vectors = np.linalg.eigh(information)
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
    """What of the base parameters counts.

    Attributes
    ----------
    names : tuple of str
        In words: base parameters, or standard ones where the nuisance parameters are known.
    directions : ndarray
        (n_b, r): where the nuisance parameters are unknown, the unit vectors of the base parameters that count; where
        they are known, how the r parameters that count change the base parameters.
    nuisance_known : bool
    """

    names: tuple[str, ...]
    directions: Array
    nuisance_known: bool


def make_subset(model: Model, subset: str | Sequence[str] | None, nuisance: str = "unknown") -> Subset:
    """Choose which parameters an experiment is to show.

    Parameters
    ----------
    model : Model
    subset : str or sequence of str, optional
        Names of parameters, of links (their ten parameters) or of joints (all the parameters of the joint's terms and
        of the link that it moves), or ``"payload"`` for the last link; None for all.
    nuisance : {"unknown", "known"}
        ``"unknown"``: the base parameters that contain any of them count, and what the motion shows of them is what
        remains when all the others, the nuisance parameters, are estimated too: the Schur complement of the information
        matrix (Pukelsheim 2006, section 3.11). ``"known"``: all the other parameters are known already, as when a
        payload is put on a robot that was identified before; what counts are those of the subset that are independent
        of each other.

    Returns
    -------
    Subset

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
            f"The subset {', '.join(names)} has no effect on the torques, so that no motion shows it; choose others."
        )
    if nuisance == "unknown":
        rows = np.flatnonzero(np.abs(effects).max(axis=1) > 0.0)
        return Subset(tuple(base.expressions[r] for r in rows), np.eye(base.count)[:, rows], False)
    kept: list[int] = []
    for k in present.tolist():  # the left-most independent ones, as for base parameters
        if np.linalg.matrix_rank(effects[:, [*kept, k]], tol=1e-9) > len(kept):
            kept.append(k)
    return Subset(tuple(model.parameter_names[columns[k]] for k in kept), effects[:, kept], True)


def _columns(model: Model, name: str) -> list[int]:
    """Return the indices of the parameters that a name of a subset means."""
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
        f"subset: {name!r} is no parameter, link or joint of {robot.name}; it has the joints "
        f"{', '.join(robot.joint_names)}, the links {', '.join(robot.link_names)}, and parameters such as {names[0]}."
    )


@dataclass(frozen=True, eq=False)
class Criterion:
    """A number that falls as a motion shows the parameters better, and its gradient by the information matrix.

    Attributes
    ----------
    kind : {"condition", "d", "a"}
        The condition number of the (weighted) regressor of the subset, the determinant of its information (largest is
        best) or the trace of its inverse.
    subset : Subset
    """

    kind: Literal["condition", "d", "a"]
    subset: Subset

    def __post_init__(self) -> None:
        if self.kind not in CRITERIA:
            raise InputError(f"criterion must be one of {', '.join(CRITERIA)}, got {self.kind!r}.")

    def evaluate(self, spectrum: Spectrum, sharpness: float = 8.0) -> tuple[float, Array]:
        """Return a smooth objective to be made small, and its gradient by the information matrix, symmetric.

        Parameters
        ----------
        spectrum : Spectrum
            Of the information.
        sharpness : float
            The extreme eigenvalues of the condition number are replaced by norms of this exponent of all of them,
            which are smooth where eigenvalues cross: twice the logarithm of the condition number from above, and the
            nearer the larger the exponent.

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
        """Return the criterion itself: condition number, logarithm of the determinant, or trace of the inverse."""
        values, _ = self._seen(spectrum)
        if not self.subset.nuisance_known:
            values = 1.0 / values
        if self.kind == "condition":
            return float(np.sqrt(values.max() / values.min()))
        return float(np.log(values).sum()) if self.kind == "d" else float((1.0 / values).sum())

    def _seen(self, spectrum: Spectrum) -> tuple[Array, Array]:
        """Return eigenvalues (r,), ascending, and vectors of the information of the subset, or of its covariance.

        The vectors of the information are those by which it changes with the whole information, (n_b, r); those of the
        covariance are (r, r).
        """
        directions, known = self.subset.directions, self.subset.nuisance_known
        if known and directions.shape[0] == directions.shape[1]:  # the identity
            return spectrum.values, spectrum.vectors
        root = spectrum.root(directions) if known else spectrum.inverse_root(directions)
        _, roots, rows = np.linalg.svd(root, full_matrices=False)
        values, vectors = _positive(roots[::-1] ** 2), rows[::-1].T
        return values, directions @ vectors if known else vectors

    def _spectral(self, values: Array, sharpness: float, power: float) -> tuple[float, Array]:
        """Return the objective and its derivatives by eigenvalues of the information, or of its inverse (power -1)."""
        count = len(values)
        if self.kind == "d":
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


# Whether a motion shows what it is asked to show, in spite of noise.

TORQUE_NOISE = 0.01
"""Of the torques, white. Torques from motor currents are seldom better; ten times less would shift the verdict by a
factor of ten in the condition number, while motions that show nothing miss it by factors of hundreds."""


@dataclass(frozen=True)
class Identifiability:
    """What torque noise of one percent leaves of the parameters that a motion is to show.

    Attributes
    ----------
    uncertainty : float
        Standard deviation of the least certain combination of the base parameters that count, in units of the size
        (2-norm) of all base parameters. Above 1 the motion cannot identify it: the noise alone weighs more than the
        robot.
    unshown : tuple of str
        In that case the parameters that are at fault, the least certain first.
    """

    uncertainty: float
    unshown: tuple[str, ...]


def identifiability(spectrum: Spectrum, subset: Subset, rows: float) -> Identifiability:
    """Predict how certain the parameters of a subset will be.

    Parameters beta of size 1 cause torques of at most the largest singular value of the regressor, over all its rows;
    one percent of their root mean square is the noise, and the inverse information makes deviations of it.

    Parameters
    ----------
    spectrum : Spectrum
        Of the information.
    subset : Subset
    rows : float
        How many rows the regressor has, samples times joints.

    Returns
    -------
    Identifiability

    Examples
    --------
    One parameter is shown a million times worse than the other one:

    >>> subset = Subset(("m1", "m2"), np.eye(2), True)
    >>> found = identifiability(Spectrum.of(np.diag([1e6, 1e-6])), subset, rows=100)
    >>> round(found.uncertainty), found.unshown
    (1000, ('m2',))
    """
    noise = TORQUE_NOISE * np.sqrt(spectrum.values[-1] / rows)
    root = spectrum.inverse_root(subset.directions)
    if subset.nuisance_known:
        # The covariance of what remains is the inverse of a part, not a part of the inverse.
        own = spectrum.root(subset.directions)
        _, sizes, vectors = np.linalg.svd(own, full_matrices=False)
        root = vectors / np.maximum(sizes, np.finfo(float).tiny)[:, None]
    _, sizes, vectors = np.linalg.svd(root, full_matrices=False)
    uncertainty = float(noise * sizes[0])
    if uncertainty <= 1.0:
        return Identifiability(uncertainty, ())
    deviations = noise * np.linalg.norm(root, axis=0)
    order = np.argsort(-deviations, kind="stable")
    # Where no parameter passes alone, but several do together, the worst direction has a largest part.
    limit = min(1.0, float(deviations[order[0]]))
    return Identifiability(uncertainty, tuple(subset.names[k] for k in order if deviations[k] >= limit))
