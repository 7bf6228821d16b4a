"""How far estimates may be off because what a model misses returns with each period of a motion."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from steelyard.display import few_digits
from steelyard.recording import Samples
from steelyard.regression import Estimate, Information, ParameterCovariance
from steelyard.regression.factor import eigenvectors
from steelyard.regression.parameter_covariance import inverse_root_of

__all__ = ["RepeatedErrors", "repeated_errors"]

Array = NDArray[np.float64]
AWAY = 0.5
"""Mean square of the difference of positions that lie a lag apart, over that of unrelated ones, beyond which a joint
has moved away, and may come back."""
ALIKE, MOSTLY = 0.05, 0.5
"""Standard deviations of its positions within which each joint must be where it was, and part of the rows of which this
holds: a motion may begin with a ramp."""
LATEST = 0.875
"""Part of a stretch up to which its period is looked for; the rest is compared."""
COARSE = 4096
"""Rows, about, by which the period is looked for before it is told to the row."""
SUMS = 64
"""Sums in a period, of which correlations are taken: what is slower moves parameters, and what is faster averages
out."""
COMPARED = 500
"""Rows, at most about twice as many, of which the median tells the period to the row."""
PARTS = 16
"""Parts whose scatter is the standard error of a correlation."""
SURE = 3.0
"""Standard errors from which a correlation counts."""


@dataclass(frozen=True, eq=False)
class RepeatedErrors:
    """Errors that return with a motion.

    Attributes
    ----------
    period : float
        s, the shortest.
    correlation : ndarray
        (N,) of what is left of each joint's torques, from one period to the next; 0 where it does not surely return.
    changes : ndarray
        (n_b, r) of base parameters, each a standard deviation of one more error.
    """

    period: float
    correlation: Array
    changes: Array

    def sentence(self, joint_names: Sequence[str]) -> str:
        """Say what makes intervals wider."""
        most = int(np.argmax(self.correlation))
        return (
            f"Intervals are wider than noise asks for: the motion repeats every {few_digits(self.period, 3)} s, and "
            f"what is left of the torques returns with it ({joint_names[most]}: a correlation of "
            f"{few_digits(float(self.correlation[most]), 2)}), so that its periods are not independent. Record motions "
            "that do not repeat."
        )


def repeated_errors(
    information: Information, unconstrained: Estimate, stretches: Sequence[tuple[Samples, Array]]
) -> RepeatedErrors | None:
    """Return by how much base parameters may be off beyond what the covariance of rows in batches says.

    Batches are a second or two long, and know nothing of noise that returns after a period: errors of friction that go
    with the position, of gears, and of encoders whose steps a controller answers. If a motion has p periods, and from
    one to the next residuals have the correlation ρ, the variance of a mean is ``1 + (p - 1) ρ`` times as large.

    Parameters
    ----------
    information : Information
        With batch means.
    unconstrained : Estimate
        Its least squares.
    stretches : sequence of (Samples, ndarray)
        Rows of its logs, and what is left of their torques (S, N), NaN where a row is not used.

    Returns
    -------
    RepeatedErrors or None
        None where no motion repeats, or nothing surely returns with it.
    """
    covariance = ParameterCovariance.of(information, unconstrained.base, unconstrained.weights)
    if covariance.correlation is None or not stretches or len(information.factors) != stretches[0][1].shape[1]:
        return None
    raised, correlation = np.zeros((2, len(information.factors)))
    period, total = np.inf, sum(samples.count for samples, _ in stretches)
    # Several logs may hold one motion; where they do not, each may repeat by itself.
    parts = [(total, _returning(stretches))]
    if parts[0][1] is None and len(stretches) > 1:
        parts = [(samples.count, _returning([(samples, left)])) for samples, left in stretches]
    for count, found in parts:
        if found is not None:
            raised += count / total * found[1]
            period, correlation = min(period, found[0]), np.maximum(correlation, found[2])
    if not raised.any():
        return None
    weights = information.joint_weights(unconstrained.weights)
    inverse, _, _ = inverse_root_of(information, weights)
    long_run = covariance.correlation.widening * covariance.correlation.long_run_variance * weights**2
    middle = np.zeros((inverse.shape[1], inverse.shape[1]))
    for factor, weight, own in zip(information.factors, weights, raised * long_run, strict=True):
        rows = weight * factor.triangle[:, :-1] @ inverse[factor.columns]
        middle += own * (rows.T @ rows)
    values, vectors = eigenvectors(middle)
    return RepeatedErrors(period, correlation, inverse @ (vectors * np.sqrt(np.maximum(values, 0.0))))


def _returning(stretches: Sequence[tuple[Samples, Array]]) -> tuple[float, Array, Array] | None:
    """Return the period in s, by how much of itself each variance (N,) is larger, and the correlation of what is left.

    None where the motion, of one stretch after the other, does not repeat.
    """
    steps = np.concatenate([np.zeros(0) if samples.t is None else np.diff(samples.t) for samples, _ in stretches])
    if not len(steps) or np.ptp(steps) > 0.01 * np.median(steps):
        return None
    q, left = (np.concatenate(parts) for parts in zip(*((samples.q, own) for samples, own in stretches), strict=True))
    moved = q[:, np.ptp(q, axis=0) > 0.0]
    lag = _lag(moved)
    if lag is None:
        return None
    alike = np.all(np.abs(moved[lag:] - moved[:-lag]) < ALIKE * np.std(moved, axis=0), axis=1)
    if np.mean(alike) < MOSTLY:
        return None
    count = max(lag // SUMS, 1)
    sums = np.cumsum(np.concatenate([np.zeros((1, left.shape[1])), np.nan_to_num(left)]), axis=0)
    sums = sums[count:] - sums[:-count]
    first, second = sums[:-lag], sums[lag:]
    alike = alike[: len(first), np.newaxis]
    cuts = np.linspace(0, len(first), PARTS, endpoint=False).astype(int)
    product = np.add.reduceat(alike * first * second, cuts)
    square = np.add.reduceat(alike * 0.5 * (first**2 + second**2), cuts)
    whole = np.maximum(square.sum(axis=0), 1e-300)
    found = product.sum(axis=0) / whole
    error = np.sqrt(np.sum((product - found * square) ** 2, axis=0)) / whole
    found = np.where(found > SURE * error, found, 0.0)
    later = np.arange(lag, len(q), lag) / len(q)
    return lag * float(np.mean(steps)), 2.0 * np.mean(alike) * found * np.sum(1.0 - later), found


def _lag(q: Array) -> int | None:
    """The rows (S, N) after which positions first return; None where they do not."""
    if not q.size:
        return None
    x = (q - q.mean(axis=0)) / np.std(q, axis=0)
    count, every = len(x), max(len(x) // COARSE, 1)
    few = x[::every]
    size = 1 << (2 * len(few)).bit_length()
    products = np.fft.irfft(np.sum(np.abs(np.fft.rfft(few, size, axis=0)) ** 2, axis=1), size)[: len(few)]
    squares = np.concatenate([[0.0], np.cumsum(np.sum(few**2, axis=1))])
    both = squares[:0:-1] + squares[-1] - squares[:-1]  # of the rows before, and of those after a lag
    apart = 1.0 - 2.0 * products / np.maximum(both, 1e-300)
    apart = apart[: int(LATEST * len(few))]
    away = np.flatnonzero(apart > AWAY)
    if not len(away):
        return None
    after = apart[away[0] :]
    near = np.flatnonzero(after < 2.0 * max(float(after.min()), 1e-3))
    # The first group of lags that are as near as the nearest, and the nearest of these for most rows: ramps are none.
    group = near[: 1 + int(np.flatnonzero(np.append(np.diff(near) > 1, True))[0])]

    def nearest(lag: int, reach: int, step: int) -> int:
        lags = np.arange(max(lag - reach, 1), min(lag + reach, count - 1) + 1, step)
        rows = np.arange(0, count - lags[-1], max((count - lags[-1]) // COMPARED, 1))
        return int(lags[np.argmin([np.median(np.sum((x[rows + k] - x[rows]) ** 2, axis=1)) for k in lags])])

    lag = every * int(away[0] + group[np.argmin(after[group])])
    return nearest(nearest(lag, lag // SUMS, every), every, 1)
