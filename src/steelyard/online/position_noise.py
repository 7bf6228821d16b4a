"""What the noise of encoders does to an estimate: rows with noisy accelerations make inertias too small."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from steelyard.dynamics import Model
from steelyard.recording import Samples
from steelyard.regression import Information
from steelyard.regression.parameter_covariance import inverse_root_of

__all__ = ["noise_bias", "noise_of_steps"]

Array = NDArray[np.float64]

ROWS = 500
"""Rows at most over which what noise adds to the regression is averaged; they are evenly spread."""

BANDWIDTH = 2.0
"""Frequencies up to which the steps of an encoder make noise, in its counts a second: a joint that turns slowly makes
it where the filter lets it pass, and not up to half of the rate."""


def noise_of_steps(steps: Array, speeds: Array, rate: float) -> Array:
    """Return the standard deviation (N,) of white noise that has, at low frequencies, the density of encoders' steps.

    Parameters
    ----------
    steps, speeds : ndarray
        (N,) of one count, rad or m, and the root mean square velocity of the joint, per s.
    rate : float
        Hz.

    Examples
    --------
    A step of 1 mrad at 1 rad/s is white; at 0.025 rad/s its noise lies within a tenth of the frequencies.

    >>> noise_of_steps(np.array([1e-3, 1e-3]), np.array([1.0, 0.025]), 1000.0).round(6).tolist()
    [0.000289, 0.000913]
    """
    counts = speeds / np.where(steps > 0.0, steps, 1.0)
    spread = np.minimum(0.5 * rate, np.maximum(BANDWIDTH * counts, 1.0))
    return np.asarray(steps * np.sqrt(0.5 * rate / spread / 12.0))


def noise_bias(
    model: Model, information: Information, weights: Array, base: Array, stretches: Sequence[Samples], noise: Array
) -> Array:
    """Return by how much least squares are off, to first order, because the accelerations of the rows have noise.

    Rows ``W + E`` in the place of ``W`` add the mean of ``EᵀE`` to ``WᵀW`` and nothing to ``Wᵀω`` (errors in variables;
    W. A. Fuller, *Measurement Error Models*, 1987, section 1.1.1), so that the parameters are off by ``-(WᵀW)⁻¹ EᵀE
    β``. Rows are linear in the accelerations: ``E`` are the columns of one acceleration times its noise. That of
    positions and of velocities, which a filter leaves a hundred times smaller beside the motion, is left out.

    Parameters
    ----------
    model : Model
    information : Information
    weights : ndarray
        (N,), of the joints.
    base : ndarray
        (n_b,), least squares.
    stretches : sequence of Samples
        Of which the rows of the information are like.
    noise : ndarray
        (N,), standard deviation of the noise of accelerations, per s².

    Returns
    -------
    ndarray
        (n_b,); zero for what the data do not determine.
    """
    columns, sums = model.base_columns, np.zeros(information.base_count)
    used = np.vstack([one.used_rows for one in stretches])
    rows = np.arange(0, len(used), max(1, -(-len(used) // ROWS)))
    q, used = np.vstack([one.q for one in stretches])[rows], used[rows]
    still = np.zeros_like(q)
    at_rest = columns.by_joint(columns.entries(q, still, still))
    for moved in np.flatnonzero(noise).tolist():
        one = still.copy()
        one[:, moved] = noise[moved]
        parts = zip(columns.by_joint(columns.entries(q, still, one)), at_rest, columns.joints, strict=True)
        for k, (with_it, without, places) in enumerate(parts):
            shown = (with_it - without)[used[:, k]]
            if len(shown):
                mean = shown.T @ (shown @ base[places]) / len(shown)
                sums[places] += weights[k] ** 2 * information.factors[k].count * mean
    inverse, _, unknown = inverse_root_of(information, weights)
    return np.where(unknown, 0.0, -inverse @ (inverse.T @ sums))
