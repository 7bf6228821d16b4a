"""The covariance of base parameters, with the correlation of the residuals in time; the one source of uncertainties."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from steelyard.display import html_table
from steelyard.errors import InputError

from .batch_means import BATCH_LENGTHS
from .factor import RANK, Factor, Reduced, column_lengths, eigenvectors, solve
from .information import Information

__all__ = ["ParameterCovariance", "ResidualCorrelation", "inverse_root", "inverse_root_of"]

Array = NDArray[np.float64]

FEWEST_BATCHES = 12
"""Batches of a joint without which their variance is not trusted: that of 12 has a relative standard error of 40 %."""

FEWEST_DEGREES = 5.0
"""The fewest degrees of freedom of Student's distribution; with fewer, intervals say nothing."""

NORMAL = 1.959963984540054
"""The 0.975 quantile of the normal distribution."""


@dataclass(frozen=True, eq=False)
class ResidualCorrelation:
    """The correlation in time of the residuals of each joint.

    Attributes
    ----------
    joint_names : tuple of str
    variance : ndarray
        (N,) of single residuals, (N·m)² or N².
    long_run_variance : ndarray
        (N,): variance of the sum of many residuals over their number. That of single residuals times ``1 + 2 (rho_1 +
        rho_2 + ...)``, with the autocorrelations rho of neighbours, and of what returns with the motion.
    batch_length : ndarray of int
        (N,) samples in the batches from which it was estimated.
    count : ndarray of int
        (N,) rows.
    settled : ndarray of bool
        (N,) false where the log is too short to show how far the correlation reaches; the intervals are too narrow
        then.
    degrees_of_freedom : ndarray
        (N,) of the long-run variance: the number of batches less what the parameters took out of them; infinite where
        there are no rows. Covariances are raised by the square of Student's over the normal quantile of 95 %, so that
        normal intervals are as wide as few batches ask for.
    returns : ndarray
        (N,): the part of the long-run variance that is due to what returns with each period of the motion, as a factor.
        The batches of so many periods tell as much as those of one.
    """

    joint_names: tuple[str, ...]
    variance: Array
    long_run_variance: Array
    batch_length: NDArray[np.intp]
    count: NDArray[np.intp]
    settled: NDArray[np.bool_]
    degrees_of_freedom: Array
    returns: Array

    @property
    def inflation(self) -> Array:
        """(N,): to how many rows one independent row corresponds; the long-run variance over the variance."""
        with np.errstate(divide="ignore", invalid="ignore"):
            return np.where(self.variance > 0.0, self.long_run_variance / self.variance, 1.0)

    @property
    def effective_count(self) -> Array:
        """(N,): number of independent rows that would tell as much."""
        return np.asarray(self.count / np.maximum(self.inflation, 1e-12))

    @property
    def widening(self) -> Array:
        """(N,): by which covariances are raised, so that normal intervals have the width of Student's."""
        from scipy.special import stdtrit

        return np.asarray((stdtrit(self.independent_degrees, 0.975) / NORMAL) ** 2)

    @property
    def independent_degrees(self) -> Array:
        """(N,): degrees of freedom of the long-run variance, where periods of a motion are not independent."""
        return np.asarray(np.maximum(self.degrees_of_freedom / self.returns, FEWEST_DEGREES))

    def __repr__(self) -> str:
        least, most = float(np.min(self.inflation)), float(np.max(self.inflation))
        return f"ResidualCorrelation(one row in {least:.3g} to {most:.3g} is independent)"

    def _repr_html_(self) -> str:
        rows = [
            (name, count, f"{effective:.0f}", batch, "yes" if ok else "no")
            for name, count, effective, batch, ok in zip(
                self.joint_names, self.count, self.effective_count, self.batch_length, self.settled, strict=True
            )
        ]
        return html_table(repr(self), ("joint", "rows", "independent", "batch", "settled"), rows)


@dataclass(frozen=True, eq=False)
class ParameterCovariance:
    """The covariance of estimated base parameters, from which standard errors, intervals and confidence regions follow.

    The covariance of thesis eq. 4.27 takes each row for an independent one. Rows follow each other every millisecond,
    friction, cables and gears err for longer, and a filter on the torques spreads each error over its own memory: the
    intervals are then too narrow, often several times. Where an Information holds `batch_means`, `of` corrects for it.

    Attributes
    ----------
    root : ndarray
        (n_b, r): the covariance is ``root root'`` in what the data determines.
    unidentifiable : ndarray
        (n_b, n_b - r): combinations that the data does not determine.
    unknown : ndarray of bool
        (n_b,): the base parameters that take part in such a combination.
    correlation : ResidualCorrelation or None
        Of the residuals, in time; None where it is not known, and each row was taken for an independent one.
    filtered_torque : bool
        Whether torques were filtered and the dynamics were not. The estimate is then off by more than noise explains,
        and no interval holds: *measured* on a simulated arm of three joints, friction parameters by up to 17 standard
        errors, so that 95 % intervals cover 38 to 94 % of the truth.

    Examples
    --------
    Noise that lasts for 20 samples, on the simplest robot:

    >>> import steelyard as sy
    >>> from scipy.signal import lfilter
    >>> model = sy.Model(sy.Robot.from_dh([(0, 1.0, 0, "q")], gravity=(0, -9.81, 0)))
    >>> t = np.arange(40000)[:, None] / 1000
    >>> q, dq, ddq = np.sin(t), np.cos(t), -np.sin(t)
    >>> noise = lfilter([1.0], [1.0, -0.9], np.random.default_rng(1).normal(size=t.shape), axis=0)
    >>> torque = model.inverse_dynamics(q, dq, ddq, np.ones(10)) + noise
    >>> info = sy.Information.from_samples(model, sy.Samples(q=q, dq=dq, ddq=ddq, torque=torque))
    >>> covariance = ParameterCovariance.of(info)
    >>> bool(15 < covariance.correlation.inflation[0] < 25)  # (1 + 0.9) / (1 - 0.9) = 19
    True
    >>> bool(np.allclose(covariance.standard_error, sy.least_squares(info).standard_error))
    True
    """

    root: Array = field(repr=False)
    unidentifiable: Array = field(repr=False)
    unknown: NDArray[np.bool_] = field(repr=False)
    correlation: ResidualCorrelation | None = None
    filtered_torque: bool = False

    @property
    def matrix(self) -> Array:
        """(n_b, n_b); for `unknown` parameters infinite on the diagonal, and zero beside it."""
        matrix = self.root @ self.root.T
        matrix[self.unknown, :] = matrix[:, self.unknown] = 0.0
        matrix[self.unknown, self.unknown] = np.inf
        return np.asarray(matrix)

    @property
    def standard_error(self) -> Array:
        """(n_b,), infinite for `unknown` parameters."""
        return np.where(self.unknown, np.inf, column_lengths(self.root.T))

    @property
    def degrees_of_freedom(self) -> float:
        """Those of the joint whose noise is known least; infinite where the correlation of residuals is not known."""
        return np.inf if self.correlation is None else float(np.min(self.correlation.independent_degrees))

    @property
    def noise_degrees(self) -> float:
        """Degrees of freedom of the noise of all joints together, by which the size of this covariance is known."""
        return np.inf if self.correlation is None else float(np.sum(self.correlation.independent_degrees))

    @property
    def error_correlation(self) -> Array:
        """(n_b (n_b - 1) / 2,) of the errors with one another, the lower triangle row by row; zero where unknown."""
        sizes = self.standard_error
        rows = self.root / np.where(sizes > 0.0, sizes, 1.0)[:, None]
        return np.asarray(np.clip((rows @ rows.T)[np.tril_indices(len(rows), -1)], -1.0, 1.0))

    def in_deviations(self) -> Array:
        """Return the map (r, n_b) of a change of β to standard deviations; its squared norm is the squared distance."""
        both = np.hstack([self.root, self.unidentifiable])
        if both.shape[0] != both.shape[1]:
            return np.asarray(np.linalg.pinv(both)[: self.root.shape[1]])
        # What the noise of a joint at rest shows has deviations that are larger by more than rounding leaves of others.
        rows = column_lengths(both.T)
        rows[rows == 0.0] = 1.0
        columns = column_lengths(both / rows[:, None])
        columns[columns == 0.0] = 1.0
        inverse = np.linalg.pinv(both / rows[:, None] / columns) / rows
        return np.asarray((inverse / columns[:, None])[: self.root.shape[1]])

    def with_error(self, change: ArrayLike) -> ParameterCovariance:
        """Return the covariance with one more error, of which one standard deviation is a change of β.

        Parameters
        ----------
        change : array_like
            (n_b,). What of it the data does not determine is unbounded already, and left out.

        Examples
        --------
        >>> ParameterCovariance.of_matrix([[9.0, 0.0], [0.0, 1.0]], 2).with_error([4.0, 0.0]).standard_error.tolist()
        [5.0, 1.0]
        """
        part = np.linalg.lstsq(self.root, np.asarray(change, dtype=np.float64), rcond=None)[0]
        square = float(part @ part)
        if not square > 0.0:
            return self
        # I + p p' is the square of I + f p p', so that the root keeps its shape.
        factor = 1.0 / (np.sqrt(1.0 + square) + 1.0)
        return replace(self, root=self.root + factor * np.outer(self.root @ part, part))

    def with_errors(self, changes: ArrayLike) -> ParameterCovariance:
        """Return the covariance with more errors, of each of which one standard deviation is a change of β.

        Parameters
        ----------
        changes : array_like
            (n_b, k). What of them the data does not determine is unbounded already, and left out.

        Examples
        --------
        >>> two = ParameterCovariance.of_matrix([[9.0, 0.0], [0.0, 1.0]], 2)
        >>> two.with_errors([[4.0, 0.0], [0.0, 0.0]]).standard_error.round(12).tolist()
        [5.0, 1.0]
        """
        parts = np.linalg.lstsq(self.root, np.asarray(changes, dtype=np.float64), rcond=None)[0]
        if not parts.any():
            return self
        values, vectors = eigenvectors(np.eye(len(parts)) + parts @ parts.T)
        # None is below 1, but beside one of 1e16 rounding makes it negative.
        return replace(self, root=self.root @ (vectors * np.sqrt(np.maximum(values, 1.0))) @ vectors.T)

    def with_independent_errors(self, sizes: ArrayLike) -> ParameterCovariance:
        """Return the covariance where each base parameter has one more error of its own.

        Parameters
        ----------
        sizes : array_like
            (n_b,), their standard deviations. What of them the data does not determine is left out.

        Examples
        --------
        >>> two = ParameterCovariance.of_matrix([[9.0, 0.0], [0.0, 1.0]], 2).with_independent_errors([4.0, 0.0])
        >>> two.standard_error.round(12).tolist()
        [5.0, 1.0]
        """
        diagonal = np.diag(np.asarray(sizes, dtype=np.float64))
        return self.with_errors(diagonal[:, diagonal.any(axis=0)])

    def with_forgotten(self, info: Information, squared: Sequence[Array], weights: Array) -> ParameterCovariance:
        """Return the covariance where rows count by what is left of them, V: ``A⁻¹ (sum_k u_k w_k⁴ W_k'V² W_k) A⁻¹``.

        ``A = sum_k w_k² W_k'V W_k`` and long-run variances u_k. With V in place of its square, which is right where
        nothing is forgotten, intervals are wider by the root of two where the motion goes on alike, and by more where
        older rows showed other parameters.

        Parameters
        ----------
        info : Information
            Of the rows as they count, from which this covariance was made.
        squared : sequence of ndarray
            Triangles of the rows as they count by V², one for each factor of `info`.
        weights : ndarray
            (N,), the w_k.
        """
        assert self.correlation is not None
        inverse, _, _ = inverse_root_of(info, weights)
        sizes = np.sqrt(self.correlation.widening * self.correlation.long_run_variance) * weights**2
        rows = [
            size * triangle[:, :-1] @ inverse[factor.columns]
            for size, triangle, factor in zip(sizes, squared, info.factors, strict=True)
        ]
        upper = np.asarray(np.linalg.qr(np.vstack(rows), mode="r"))
        return replace(self, root=inverse @ upper.T)

    @classmethod
    def of(
        cls, info: Information, base: ArrayLike | None = None, weights: str | ArrayLike | None = "joint"
    ) -> ParameterCovariance:
        """Return the covariance of an estimate from the data itself.

        The residuals are summed over batches of samples (the method of batch means). Where a batch is long against the
        correlation, the variance of its sum over the number of its samples is the long-run variance, which takes the
        place of the variance in the sandwich ``A⁻¹ (sum_k u_k w_k² W_k'W_k) A⁻¹`` with ``A = sum_k w_k W_k'W_k w_k``.
        What the fitted parameters took out of the sums is given back: their expected squares are linear in the long-run
        variances of all joints, and the equations are solved. The length of the batches L is the least with
        ``L³ >= 2 S u² / sigma⁴``, S samples, where what correlation beyond the batch costs and what the small number of
        batches costs are about even (Lee et al.). The variance of few batches is itself uncertain; each is raised, so
        that intervals have the width of Student's. Without `batch_means` every u_k is the residual variance of the
        weighted rows, which is thesis eq. 4.27.

        It tells nothing of torques that were filtered, or decimated, where the dynamics were not: these bias estimates.
        Where both were, filtered noise is noise that lasts.
        It holds where the motion changes little within the correlation of the noise, and for noise that is independent
        between joints. What returns with each period of a motion counts where the Information tells it (`returning`).

        Parameters
        ----------
        info : Information
        base : array_like, optional
            (n_b,), at which the residuals are taken; those of least squares where absent.
        weights : "joint", None or array_like
            With which `base` was estimated, see :func:`least_squares`.

        Raises
        ------
        InputError
            If the base parameters or the weights do not fit the Information.

        References
        ----------
        H. Flyvbjerg and H. G. Petersen, Error estimates on averages of correlated data, J. Chem. Phys. 91, 1989.
        R. M. Lee et al., Strategies for improving the efficiency of quantum Monte Carlo calculations,
        Phys. Rev. E 83, 2011.
        """
        used = info.joint_weights(weights)
        problem = info.reduced(used)
        beta = solve(problem) if base is None else np.asarray(base, dtype=np.float64)
        if beta.shape != (info.base_count,):
            raise InputError(
                f"base must have shape ({info.base_count},), one number a base parameter, got {beta.shape}."
            )
        key = ("covariance", used.tobytes(), beta.tobytes())
        return info.remembered(key, lambda: cls._of(info, problem, beta, used))

    @classmethod
    def _of(cls, info: Information, problem: Reduced, beta: Array, used: Array) -> ParameterCovariance:
        inverse, unidentifiable, unknown = inverse_root_of(info, used)
        unknown = unknown | info.unidentifiable_mask
        if not info.batch_means:
            root = np.sqrt(_residual_variance(problem, beta)) * inverse
            return cls(root, unidentifiable, unknown, None, info.filtered_torque)
        middle, correlation = _long_run(info, beta, used, inverse)
        values, vectors = eigenvectors(middle)
        root = inverse @ (vectors * np.sqrt(np.maximum(values, 0.0)))
        return cls(root, unidentifiable, unknown, correlation, info.filtered_torque)

    @classmethod
    def of_reduced(cls, problem: Reduced, base: ArrayLike | None = None) -> ParameterCovariance:
        """Return the covariance of a reduced regression, taking each row for an independent one (thesis eq. 4.27).

        Parameters
        ----------
        problem : Reduced
        base : array_like, optional
            (n_b,), at which the residual is taken; that of least squares where absent.
        """
        beta = solve(problem) if base is None else np.asarray(base, dtype=np.float64)
        inverse, unidentifiable, unknown = inverse_root(problem.R)
        return cls(np.sqrt(_residual_variance(problem, beta)) * inverse, unidentifiable, unknown)

    @classmethod
    def of_matrix(cls, matrix: ArrayLike, count: int) -> ParameterCovariance:
        """Build from a covariance matrix.

        Parameters
        ----------
        matrix : array_like
            (n_b, n_b), symmetric, positive semidefinite.
        count : int
            The number n_b of base parameters.

        Raises
        ------
        InputError
            If it is not a covariance matrix of so many base parameters.
        """
        given = np.asarray(matrix, dtype=np.float64)
        if given.shape != (count, count) or not np.all(np.isfinite(given)):
            raise InputError(
                f"covariance must be a matrix of {count} x {count} finite numbers, one row for each base parameter, "
                f"got an array of shape {given.shape}; use info= where some base parameters are not determined."
            )
        size = np.sqrt(np.abs(np.diagonal(given)))
        scale = np.where(size > 0, size, 1.0)
        scaled = given / np.outer(scale, scale)
        if not np.allclose(scaled, scaled.T, rtol=0.0, atol=1e-8):
            raise InputError("covariance must be symmetric; give the covariance matrix of the base parameters.")
        values, vectors = eigenvectors(0.5 * (scaled + scaled.T))
        if values[0] < -1e-9 * max(values[-1], 1.0):
            raise InputError(
                f"covariance must be positive semidefinite, but its smallest eigenvalue (unit variances) is "
                f"{values[0]:.3g}; give the covariance matrix of the base parameters."
            )
        kept = values > 1e-14 * max(values[-1], 0.0)
        root = scale[:, None] * vectors[:, kept] * np.sqrt(values[kept])
        return cls(root, np.zeros((count, 0)), np.zeros(count, dtype=bool))


def inverse_root_of(info: Information, weights: Array) -> tuple[Array, Array, NDArray[np.bool_]]:
    """Return `inverse_root` of the regression with weights of the joints (N,), which the Information remembers."""

    def found() -> tuple[Array, Array, NDArray[np.bool_]]:
        return inverse_root(info.reduced(weights).R)

    return info.remembered(("inverse root", weights.tobytes()), found)


def inverse_root(R: Array) -> tuple[Array, Array, NDArray[np.bool_]]:
    """A square root of (R'R)⁻¹ in what R shows, (n_b, r), what it does not show, (n_b, n_b - r), and of which unknowns.

    Columns are scaled to length one; less than `RANK` of what is shown best counts as not shown.
    """
    lengths = column_lengths(R)
    scale = np.where(lengths > 0.0, lengths, 1.0)
    _, values, rows = np.linalg.svd(R / scale)
    rank = int(np.sum(values > RANK * values.max(initial=0.0)))
    unknown = column_lengths(rows[rank:]) > 1e-6
    return (rows[:rank].T / values[:rank]) / scale[:, None], rows[rank:].T / scale[:, None], unknown


def _residual_variance(problem: Reduced, base: Array) -> float:
    """Return the variance of the weighted residuals at some base parameters, taking each row for an independent one."""
    difference = problem.R @ base - problem.rho
    return (float(difference @ difference) + problem.residual2) / max(problem.count - len(base), 1)


def _long_run(info: Information, beta: Array, used: Array, inverse: Array) -> tuple[Array, ResidualCorrelation]:
    """Return the middle of the sandwich in the coordinates of `inverse`, (r, r), and the correlation it comes from."""
    factors = info.factors

    def seen(factor: Factor, weight: float) -> Array:
        """Return what the rows of a factor contribute to A, in the coordinates in which A is one: (r, r)."""
        rows = weight * factor.triangle[:, :-1] @ inverse[factor.columns]
        return np.asarray(rows.T @ rows)

    shares = [seen(f, w) for f, w in zip(factors, used, strict=True)]
    counts = np.array([f.count for f in factors])
    freedom = np.maximum(counts - np.array([np.trace(s) for s in shares]), 0.5 * counts)
    squares = np.array([f.residual2(beta) for f in factors]) * used**2
    variance = squares / np.maximum(freedom, 1.0)
    levels = [_Level(level, beta, used, seen) for level in info.batch_means]
    chosen, settled, freedom = _choose(levels, shares, variance, counts)
    own = [levels[c].share(k) for k, c in enumerate(chosen)]
    matrix = np.array([[float(np.sum(share * one)) for share in shares] for one in own])
    matrix = matrix.reshape(len(factors), len(factors))
    matrix += np.diag([count - 2.0 * np.trace(one) for count, one in zip(counts, own, strict=True)])
    target = np.array([levels[c].squares[k] for k, c in enumerate(chosen)])
    returns = info.returns
    long_run = _positive(matrix, target, counts) * returns
    names = info.joint_names if len(info.joint_names) == len(factors) else ("all",) * len(factors)
    lengths = np.array([BATCH_LENGTHS[c] for c in chosen])
    correlation = ResidualCorrelation(
        names, variance / used**2, long_run / used**2, lengths, counts, settled, freedom, returns
    )
    widened = correlation.widening * long_run
    return np.asarray(np.sum([u * share for u, share in zip(widened, shares, strict=True)], axis=0)), correlation


class _Level:
    """Weighted sums over batches of one length: their squared residuals, and what they contribute to A."""

    def __init__(
        self, factors: tuple[Factor, ...], beta: Array, weights: Array, seen: Callable[[Factor, float], Array]
    ) -> None:
        self.counts = [f.count for f in factors]
        self.squares = [w**2 * f.residual2(beta) for f, w in zip(factors, weights, strict=True)]
        self._factors, self._weights, self._seen = factors, weights, seen
        self._shares: dict[int, Array] = {}

    def share(self, joint: int) -> Array:
        """What the sums of a joint contribute to A, when it is asked for: most levels are too long for most joints."""
        if joint not in self._shares:
            self._shares[joint] = self._seen(self._factors[joint], self._weights[joint])
        return self._shares[joint]


def _choose(
    levels: list[_Level], shares: list[Array], variance: Array, counts: NDArray[np.intp]
) -> tuple[list[int], NDArray[np.bool_], Array]:
    """Choose the batches of each joint; tell whether they are long enough, and how many of them are left to choose by.

    What is left are the degrees of freedom of their variance: their number less what the parameters took out.
    """
    chosen, settled, freedom = [], [], []
    for k, count in enumerate(counts):
        best, enough, degrees = 0, count == 0 or variance[k] == 0.0, np.inf
        for index, length in enumerate(BATCH_LENGTHS):
            if enough or (index and levels[index].counts[k] < FEWEST_BATCHES):
                break
            best = index
            own = levels[index].share(k)
            free = count - 2.0 * np.trace(own) + np.sum(shares[k] * own)
            degrees = max(levels[index].counts[k] * free / count, FEWEST_DEGREES)
            long_run = levels[index].squares[k] / max(free, 0.1 * count)
            enough = length**3 >= 2.0 * count * (long_run / variance[k]) ** 2
        chosen.append(best)
        settled.append(bool(enough))
        freedom.append(degrees)
    return chosen, np.array(settled, dtype=bool), np.array(freedom)


def _positive(matrix: Array, target: Array, counts: NDArray[np.intp]) -> Array:
    """Solve for the long-run variances; without the correction where that gives no positive solution (few batches)."""
    plain = target / np.maximum(counts, 1)
    try:
        solution = np.linalg.solve(matrix + np.diag(np.where(counts == 0, 1.0, 0.0)), target)
    except np.linalg.LinAlgError:
        return np.asarray(plain)
    return np.asarray(np.where(np.isfinite(solution) & (solution > plain), solution, plain))
