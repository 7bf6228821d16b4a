"""Covariance of the noise across the joints, from the residuals of a first fit."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from steelyard.display import joint_label
from steelyard.errors import InputError
from steelyard.recording import Samples

from .estimate import Estimate
from .factor import eigenvectors
from .reduction import require_joints, residuals

if TYPE_CHECKING:
    from steelyard.dynamics import Model

__all__ = ["definite", "residual_covariance"]

LEAST_EIGENVALUE = 1e-6
"""Least eigenvalue of the correlation matrix; it keeps the covariance positive definite where the residuals of two
joints are proportional."""


def residual_covariance(
    model: Model, samples: Samples | Iterable[Samples], estimate: Estimate | ArrayLike
) -> NDArray[np.float64]:
    """Estimate the covariance of the noise of all joints from what an estimate does not explain.

    Parameters
    ----------
    model : Model
    samples : Samples or iterable of Samples
        Those of the first fit; several where the log came in chunks.
    estimate : Estimate or array_like
        The first fit, or its base parameters (n_b,).

    Returns
    -------
    ndarray
        (N, N), positive definite, (N·m)² or N². Each element is the sum over the samples in which both joints are used,
        divided by their number less n_b (thesis eq. 4.32); the correlations are then moved to the nearest with
        eigenvalues of at least 1e-6.

    Raises
    ------
    InputError
        If the base parameters do not fit the model, or two joints are never used together.

    See Also
    --------
    Information.from_samples : Takes the covariance for generalised least squares.

    Examples
    --------
    >>> import steelyard as sy
    >>> model = sy.Model(sy.Robot.from_dh([(0, 1.0, 0, "q"), (0, 1.0, 0, "q")], gravity=(0, -9.81, 0)))
    >>> random = np.random.default_rng(1)
    >>> q, dq, ddq = random.normal(size=(3, 20000, 2))
    >>> noise = random.multivariate_normal([0, 0], [[4.0, 1.5], [1.5, 1.0]], size=20000)
    >>> torque = model.inverse_dynamics(q, dq, ddq, np.ones(20)) + noise
    >>> samples = sy.Samples(q=q, dq=dq, ddq=ddq, torque=torque)
    >>> first = sy.least_squares(sy.Information.from_samples(model, samples))
    >>> residual_covariance(model, samples, first).round(1).tolist()
    [[4.0, 1.5], [1.5, 1.0]]
    """
    base = np.asarray(estimate.base if isinstance(estimate, Estimate) else estimate, dtype=np.float64)
    count = model.base_parameters().count
    if base.shape != (count,) or not np.all(np.isfinite(base)):
        raise InputError(
            f"residual_covariance needs the model's {count} base parameters, all finite, got an array of shape "
            f"{base.shape}."
        )
    joints = model.dof
    sums, counts = np.zeros((joints, joints)), np.zeros((joints, joints))
    for chunk in [samples] if isinstance(samples, Samples) else samples:
        require_joints(model, chunk)
        chunk = chunk.with_presliding(model)
        used_rows = chunk.used_rows
        for part, errors in residuals(model, chunk, base):
            used = used_rows[part].astype(np.float64)
            sums += (errors * used).T @ (errors * used)
            counts += used.T @ used
    if np.any(counts == 0.0):
        first, second = np.argwhere(counts == 0.0)[0]
        one, other = (joint_label(int(joint), model.robot.joint_names) for joint in (first, second))
        what = f"{one} is never used" if one == other else f"{one} and {other} are never used in the same sample"
        raise InputError(f"the covariance cannot be estimated: {what}; mask fewer rows.")
    matrix = sums / np.maximum(counts - count, 0.5 * counts)
    return definite(matrix)


def definite(matrix: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the covariance with the same variances, and correlations whose eigenvalues are not too small."""
    sizes = np.sqrt(np.maximum(np.diagonal(matrix), 1e-18 * max(float(np.diagonal(matrix).max()), 1e-300)))
    correlation = matrix / np.outer(sizes, sizes)
    values, vectors = eigenvectors(correlation)
    if values[0] < LEAST_EIGENVALUE:
        correlation = (vectors * np.maximum(values, LEAST_EIGENVALUE)) @ vectors.T
        correlation /= np.sqrt(np.outer(np.diagonal(correlation), np.diagonal(correlation)))
    found = correlation * np.outer(sizes, sizes)
    return np.asarray(0.5 * (found + found.T))
