"""Reduction of samples to triangular factors: of single joints, of weighted rows, or of rows whitened across joints."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from steelyard.dynamics.threads import one_thread
from steelyard.errors import InputError
from steelyard.recording import Samples

from .batch_means import BATCH_LENGTHS, BatchMeans, BatchSums
from .factor import Factor, extended
from .repeated_motion import MotionSums
from .time_blocks import TimeBlocks

if TYPE_CHECKING:
    from steelyard.dynamics import Model

    from .neighbors import NeighborCombinations, RegressorSource

__all__ = [
    "BLOCK",
    "CHUNK",
    "FEWEST_EXACT",
    "JointReduction",
    "MarginalWhitening",
    "WhitenedReduction",
    "as_covariance",
    "empty_factors",
    "empty_whole",
    "errors_of",
    "joint_rows",
    "narrowed",
    "narrowing",
    "reduce_by_joint",
    "require_joints",
    "residuals",
    "residuals_of_rows",
    "rows_of_entries",
]

Array = NDArray[np.float64]

BLOCK = 2048
"""Samples that are factored at a time: their regressor stays in the processor's cache."""

CHUNK = 24576
"""Samples that are handed over at a time: so many that what each call costs by itself hardly counts. Half of the pieces
in which long logs are processed, so that these are cut, and never joined."""

FEWEST_EXACT = 8192
"""Samples of a log from which on neighbouring rows are combined, a multiple of 1024: so many tell how much of columns
and noise may be lost. *Measured*, logs of 37 500 to a million rows: a sixth less processor time."""

EXACT = 2**17
"""The same of samples that are at hand, two minutes at 1 kHz: what is made of them is exact up to there."""

WHOLE_BLOCK = 1024
"""Samples that are factored at a time where the rows of all joints stand side by side."""


def require_joints(model: Model, samples: Samples) -> None:
    """Raise InputError unless the samples have as many joints as the model."""
    joints = np.shape(samples.q)[1]
    if joints != model.dof:
        raise InputError(
            f"The samples have {joints} joints, but {model.robot.name} has {model.dof}: "
            "check which columns of the log were read."
        )


def empty_factors(model: Model) -> tuple[Factor, ...]:
    """The factors of no data, one for each joint."""
    return tuple(
        Factor(k, columns, np.zeros((len(columns) + 1, len(columns) + 1)), 0)
        for k, columns in enumerate(model.base_columns.joints)
    )


def empty_whole(model: Model) -> Factor:
    """The factor of no data over all joints and all base parameters."""
    width = model.base_parameters().count
    return Factor(None, np.arange(width), np.zeros((width + 1, width + 1)), 0)


def joint_rows(model: Model, samples: Samples, block: int = BLOCK) -> Iterator[tuple[slice, list[Array]]]:
    """For some samples at a time, the rows ``[W omega]`` of each joint, (samples, c + 1), also where masked."""
    for part, entries in _entries(model, samples, block):
        yield part, rows_of_entries(model, entries, samples.torque[part])


def _entries(model: Model, samples: Samples, block: int) -> Iterator[tuple[slice, Array]]:
    """For some samples at a time, the entries of the base regressor, (samples, C)."""
    for start in range(0, samples.count, block):
        part = slice(start, min(start + block, samples.count))
        yield part, samples.entries_for(model, part)


def rows_of_entries(model: Model, entries: Array, torque: Array) -> list[Array]:
    """The rows ``[W omega]`` of each joint, (samples, c + 1), by the entries of the base regressor and the torques."""
    return [np.column_stack([w, torque[:, k]]) for k, w in enumerate(model.base_columns.by_joint(entries))]


def residuals_of_rows(model: Model, rows: Sequence[Array], base: Array) -> Array:
    """``omega - W beta`` of the rows of each joint, (samples, N)."""
    joints = model.base_columns.joints
    return np.column_stack([own[:, -1] - own[:, :-1] @ base[c] for own, c in zip(rows, joints, strict=True)])


def narrowing(wider: Model, model: Model) -> Array:
    """Return the matrix (n_b, n_c) that turns the base regressor into that of the same robot with fewer terms."""
    whole = wider.base_parameters()
    places = {str(name): index for index, name in enumerate(whole.parameter_names)}
    # A column of the regressor is the base regressor times the column of its parameter in K.
    return np.asarray(whole.K[:, [places[str(name)] for name in model.base_parameters().names]])


def narrowed(samples: Samples, wider: Model, model: Model) -> Samples:
    """Return samples that have the regressor of a model with that of the same robot with fewer terms; others as is."""
    if samples.regressor is None or samples.regressor_model is not wider:
        return samples
    change, by_joint = narrowing(wider, model), wider.base_columns.by_joint(samples.regressor)
    places = zip(by_joint, wider.base_columns.joints, model.base_columns.joints, strict=True)
    regressor = np.hstack([rows @ change[np.ix_(given, kept)] for rows, given, kept in places])
    return replace(samples, regressor=regressor, regressor_model=model)


class JointReduction:
    """Reduces the rows of each joint by themselves, samples by samples.

    From `EXACT` samples on neighbouring rows are combined, see `neighbors.py`.

    Parameters
    ----------
    sums : BatchSums, optional
        Receives the rows, too.
    blocks : TimeBlocks, optional
        Keeps stretches of the rows apart.
    exact : int, optional
        In the place of `EXACT`, a multiple of 1024.
    motion : MotionSums, optional
        Receives the rows, or their sums, too.
    """

    def __init__(
        self,
        model: Model,
        sums: BatchSums | None = None,
        blocks: TimeBlocks | None = None,
        exact: int | None = None,
        motion: MotionSums | None = None,
    ) -> None:
        self.model = model
        self.sums, self.motion = sums, motion
        self.blocks = TimeBlocks(empty_factors(model), 1) if blocks is None else blocks
        self._widths = [len(own) for own in model.base_columns.joints]
        self._exact = EXACT if exact is None else exact
        self._squares, self._seen = np.zeros(sum(self._widths)), 0
        self._neighbors: NeighborCombinations | None = None

    def add(self, samples: Samples, scales: Array | None = None) -> None:
        """Add samples, perhaps with factors (S, N) of their rows, the square roots of weights.

        With sums each call but the last must bring a multiple of 1024 samples, and from `exact` samples on always.
        """
        if scales is None and self._seen < self._exact < self._seen + samples.count:
            exact = self._exact - self._seen
            self.add(samples.rows(0, exact))
            samples = samples.rows(exact, samples.count)
        if self._seen >= self._exact and scales is None:
            whole = samples.count - samples.count % BATCH_LENGTHS[-1]
            if whole:
                self._add_combined(samples if whole == samples.count else samples.rows(0, whole))
            if whole == samples.count:
                return
            samples = samples.rows(whole, samples.count)
        for part, entries in _entries(self.model, samples, BLOCK):
            rows = rows_of_entries(self.model, entries, samples.torque[part])
            if scales is not None:
                rows = [own * scales[part, k, None] for k, own in enumerate(rows)]
            mask = None if samples.mask is None else samples.mask[part]
            if self.sums is not None:
                self.sums.add(rows, mask)
            self.blocks.add(rows, mask)
            if self.motion is not None:
                self.motion.add(None if samples.t is None else samples.t[part], samples.q[part], rows, mask)
            self._squares += np.einsum("sc,sc->c", entries, entries)
            self._seen += len(entries)

    def _add_combined(self, samples: Samples) -> None:
        if self._neighbors is None:
            from .neighbors import NeighborCombinations

            self._neighbors = NeighborCombinations(self._widths, self._squares / self._seen)
        with one_thread():
            combined = self._neighbors.combined(self._source(samples), samples.torque, samples.mask)
        self.blocks.add_combined([one.rows for one in combined], [one.count for one in combined], samples.count)
        if self.sums is not None:
            self.sums.add_combined([one.sums for one in combined])
        if self.motion is not None:
            counts = [one.count for one in combined]
            self.motion.add_combined(samples.t, samples.q, [one.sums for one in combined], counts)

    def _source(self, samples: Samples) -> RegressorSource:
        """Return what computes the base regressor of some samples; each of its arrays is used up before the next."""
        from .neighbors import RegressorSource, SmoothMotion

        model, columns = self.model, self.model.base_columns
        regressor = samples.regressor if samples.regressor_model is model else None
        if regressor is not None:
            return RegressorSource(lambda part: regressor[part])
        # What no filter has made smooth may change anywhere between a few rows.
        few = not model.robot.channels and 4 * len(columns.uneven) <= len(self._squares)
        motion = q, dq, ddq = [np.ascontiguousarray(one, np.float64) for one in (samples.q, samples.dq, samples.ddq)]
        smooth = SmoothMotion(q, dq, ddq, columns) if few and samples.cutoff is not None else None

        def entries(part: slice) -> Array:
            q, dq, ddq = (one[part] for one in motion)
            return columns.entries(q, dq, ddq, samples.channels_for(model, part))

        return RegressorSource(entries, smooth)

    def factors(self) -> tuple[Factor, ...]:
        """One for each joint."""
        return self.blocks.factors()


def reduce_by_joint(model: Model, samples: Samples, scales: Array | None = None) -> tuple[Factor, ...]:
    """Reduce the rows of each joint of some samples by themselves; see `JointReduction`."""
    require_joints(model, samples)
    reduction = JointReduction(model)
    reduction.add(samples, scales)
    return reduction.factors()


def as_covariance(covariance: ArrayLike, joints: int) -> Array:
    """Check and convert a covariance of the noise of all joints.

    Raises
    ------
    InputError
        If it is not a symmetric positive definite (N, N) matrix.
    """
    matrix = np.asarray(covariance, dtype=np.float64)
    if matrix.shape != (joints, joints):
        raise InputError(
            f"covariance must be of shape ({joints}, {joints}), one row for each joint, got {matrix.shape}."
        )
    if not np.all(np.isfinite(matrix)) or not np.allclose(matrix, matrix.T, rtol=1e-9, atol=0.0):
        raise InputError("covariance must be finite and symmetric; residual_covariance estimates one from residuals.")
    matrix = 0.5 * (matrix + matrix.T)
    diagonal = np.diagonal(matrix)
    worst = int(np.argmin(diagonal))
    if diagonal[worst] <= 0.0:
        raise InputError(f"covariance has the variance {diagonal[worst]:g} for joint {worst + 1}; it must be positive.")
    sizes = np.sqrt(diagonal)
    least = float(np.linalg.eigvalsh(matrix / np.outer(sizes, sizes))[0])
    if least <= 1e-12:
        raise InputError(
            f"covariance is not positive definite: its correlation matrix has an eigenvalue of {least:.3g}; "
            "residual_covariance estimates one that is."
        )
    return matrix


class MarginalWhitening:
    """Whitens the rows of a sample across its joints, by the marginal covariance of those that are used."""

    def __init__(self, covariance: Array) -> None:
        self.covariance = covariance
        self._inverses: dict[bytes, Array] = {}

    def whitened(self, rows: Array, used: NDArray[np.bool_]) -> Iterator[tuple[tuple[Any, ...], Array]]:
        """Yield for the samples that use the same joints, of rows (n, N, c), their place and what they are whitened."""
        patterns, which = np.unique(used, axis=0, return_inverse=True)
        for index, pattern in enumerate(patterns):
            if not pattern.any():
                continue
            key = pattern.tobytes()
            if key not in self._inverses:
                marginal = self.covariance[np.ix_(pattern, pattern)]
                self._inverses[key] = np.linalg.inv(np.linalg.cholesky(marginal))
            at = np.ix_(which.ravel() == index, pattern)
            yield at, np.matmul(self._inverses[key], rows[at])


class WhitenedReduction:
    """Reduces the rows of all joints together, each sample's N rows times the covariance's inverse Cholesky factor.

    A sample of which only some joints are used has the covariance of those (marginal of a normal distribution).

    Parameters
    ----------
    covariance : ndarray
        (N, N).
    with_batches : bool
        Whether sums of neighbouring rows are reduced, too.
    """

    def __init__(self, model: Model, covariance: Array, with_batches: bool = False) -> None:
        self.model, self.empty = model, empty_whole(model)
        self.triangle, self.count = self.empty.triangle, 0
        self.sums = BatchSums((self.empty,)) if with_batches else None
        self._whitening = MarginalWhitening(covariance)

    def add(self, samples: Samples) -> None:
        """Add samples; with batches each call but the last must bring a multiple of 1024."""
        columns, width = self.model.base_columns.joints, len(self.empty.columns)
        used_rows = samples.used_rows
        with one_thread():
            for part, rows_of_joints in joint_rows(self.model, samples, WHOLE_BLOCK):
                rows = np.zeros((part.stop - part.start, len(columns), width + 1))
                for k, values in enumerate(rows_of_joints):
                    rows[:, k, columns[k]] = values[:, :-1]
                    rows[:, k, width] = values[:, -1]
                pieces, whitened = [], np.zeros_like(rows)
                for at, white in self._whitening.whitened(rows, used_rows[part]):
                    self.count += white.shape[0] * white.shape[1]
                    pieces.append(white.reshape(-1, width + 1))
                    whitened[at] = white
                self.triangle = extended(self.triangle, *pieces)
                if self.sums is not None:
                    self.sums.add([whitened])

    def factor(self) -> Factor:
        """Over all joints and all base parameters."""
        return Factor(None, self.empty.columns, self.triangle, self.count)

    def batch_means(self) -> BatchMeans:
        """Return the batch means of the sums; none where they were not asked for."""
        return self.sums.factors() if self.sums is not None else ()


def residuals(model: Model, samples: Samples, base: Array) -> Iterator[tuple[slice, Array]]:
    """For some samples at a time, ``omega - W beta`` of all joints, (samples, N), also where masked.

    Of several base parameters (n_b, k) beside each other, (samples, N, k).
    """
    columns = model.base_columns
    with one_thread():
        for part, entries in _entries(model, samples, BLOCK):
            predicted = [w @ base[c] for w, c in zip(columns.by_joint(entries), columns.joints, strict=True)]
            torque = samples.torque[part]
            yield part, (torque if base.ndim == 1 else torque[..., None]) - np.stack(predicted, axis=1)


def errors_of(model: Model, samples: Samples, base: Array) -> Array:
    """Return what base parameters leave of the torques of samples, (S, N); NaN where a row is not used."""
    errors = np.concatenate([part for _, part in residuals(model, samples, base)])
    return errors if samples.mask is None else np.where(samples.mask, errors, np.nan)
