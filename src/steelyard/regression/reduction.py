"""From samples to triangular factors: rows of single joints, weighted rows, and rows whitened across the joints."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from steelyard.dynamics.threads import one_thread
from steelyard.errors import InputError
from steelyard.recording import Samples

from .batch_means import BatchMeans, BatchSums
from .factor import Factor, extended
from .time_blocks import TimeBlocks

if TYPE_CHECKING:
    from steelyard.dynamics import Model

__all__ = [
    "BLOCK",
    "JointReduction",
    "WhitenedReduction",
    "as_covariance",
    "empty_factors",
    "empty_whole",
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
    columns = model.base_columns
    filtered = samples.regressor if samples.regressor_model is model else None
    for start in range(0, samples.count, block):
        part = slice(start, min(start + block, samples.count))
        if filtered is None:
            entries = columns.entries(samples.q[part], samples.dq[part], samples.ddq[part])
        else:
            entries = filtered[part]
        yield part, rows_of_entries(model, entries, samples.torque[part])


def rows_of_entries(model: Model, entries: Array, torque: Array) -> list[Array]:
    """The rows ``[W omega]`` of each joint, (samples, c + 1), by the entries of the base regressor and the torques."""
    return [np.column_stack([w, torque[:, k]]) for k, w in enumerate(model.base_columns.by_joint(entries))]


def residuals_of_rows(model: Model, rows: Sequence[Array], base: Array) -> Array:
    """``omega - W beta`` of the rows of each joint, (samples, N)."""
    joints = model.base_columns.joints
    return np.column_stack([own[:, -1] - own[:, :-1] @ base[c] for own, c in zip(rows, joints, strict=True)])


def narrowing(wider: Model, model: Model) -> Array:
    """What the base regressor of a model is times to be that of the same robot with fewer terms, (n_b, n_c)."""
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

    Parameters
    ----------
    model : Model
    sums : BatchSums, optional
        Receives the rows, too.
    blocks : TimeBlocks, optional
        Keeps stretches of the rows apart.
    """

    def __init__(self, model: Model, sums: BatchSums | None = None, blocks: TimeBlocks | None = None) -> None:
        self.model = model
        self.sums = sums
        self.blocks = TimeBlocks(empty_factors(model), 1) if blocks is None else blocks

    def add(self, samples: Samples, scales: Array | None = None) -> None:
        """Add samples, perhaps with factors (S, N) of their rows, the square roots of weights.

        With sums each call but the last must bring a multiple of 1024 samples.
        """
        for part, rows_of_joints in joint_rows(self.model, samples):
            rows = rows_of_joints
            if scales is not None:
                rows = [own * scales[part, k, None] for k, own in enumerate(rows)]
            mask = None if samples.mask is None else samples.mask[part]
            if self.sums is not None:
                self.sums.add(rows if mask is None else [own * mask[:, k, None] for k, own in enumerate(rows)])
            self.blocks.add(rows, mask)

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


class WhitenedReduction:
    """Reduces the rows of all joints together, each sample's N rows times the covariance's inverse Cholesky factor.

    A sample of which only some joints are used has the covariance of those (marginal of a normal distribution).

    Parameters
    ----------
    model : Model
    covariance : ndarray
        (N, N).
    with_batches : bool
        Whether sums of neighbouring rows are reduced, too.
    """

    def __init__(self, model: Model, covariance: Array, with_batches: bool = False) -> None:
        self.model, self.covariance, self.empty = model, covariance, empty_whole(model)
        self.triangle, self.count = self.empty.triangle, 0
        self.sums = BatchSums((self.empty,)) if with_batches else None
        self.inverses: dict[bytes, Array] = {}

    def add(self, samples: Samples) -> None:
        """Add samples; with batches each call but the last must bring a multiple of 1024."""
        columns, width = self.model.base_columns.joints, len(self.empty.columns)
        with one_thread():
            for part, rows_of_joints in joint_rows(self.model, samples, WHOLE_BLOCK):
                size = part.stop - part.start
                rows = np.zeros((size, len(columns), width + 1))
                for k, values in enumerate(rows_of_joints):
                    rows[:, k, columns[k]] = values[:, :-1]
                    rows[:, k, width] = values[:, -1]
                used = np.ones((size, len(columns)), dtype=bool) if samples.mask is None else samples.mask[part]
                patterns, which = np.unique(used, axis=0, return_inverse=True)
                pieces, whitened = [], np.zeros_like(rows)
                for index, pattern in enumerate(patterns):
                    if not pattern.any():
                        continue
                    key = pattern.tobytes()
                    if key not in self.inverses:
                        marginal = self.covariance[np.ix_(pattern, pattern)]
                        self.inverses[key] = np.linalg.inv(np.linalg.cholesky(marginal))
                    chosen = rows[which.ravel() == index][:, pattern]
                    white = np.matmul(self.inverses[key], chosen)
                    self.count += white.shape[0] * white.shape[1]
                    pieces.append(white.reshape(-1, width + 1))
                    whitened[np.ix_(which.ravel() == index, pattern)] = white
                self.triangle = extended(self.triangle, *pieces)
                if self.sums is not None:
                    self.sums.add([whitened])

    def factor(self) -> Factor:
        """Over all joints and all base parameters."""
        return Factor(None, self.empty.columns, self.triangle, self.count)

    def batch_means(self) -> BatchMeans:
        """Those of the sums; none where they were not asked for."""
        return self.sums.factors() if self.sums is not None else ()


def residuals(model: Model, samples: Samples, base: Array) -> Iterator[tuple[slice, Array]]:
    """For some samples at a time, ``omega - W beta`` of all joints, (samples, N), also where masked."""
    with one_thread():
        for part, rows in joint_rows(model, samples):
            yield part, residuals_of_rows(model, rows, base)
