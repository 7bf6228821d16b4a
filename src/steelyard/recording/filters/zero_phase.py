"""Zero-phase filters, derivatives and decimation (thesis, section 4.3.3)."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from math import ceil, log, pi, tan
from typing import TYPE_CHECKING

import numpy as np

from steelyard.errors import InputError

if TYPE_CHECKING:
    from numpy.typing import NDArray

__all__ = [
    "decimate",
    "decimation_padding",
    "decimation_settling",
    "filter_padding",
    "filter_settling",
    "first_derivative",
    "low_pass",
    "motion_frequency",
]

POWER_SHARE = 0.999
"""Share of the power of the positions that lies below the dynamic frequency."""
DECAYED = 1e-17
"""What is left of a filter's transient, as a fraction, where it no longer counts."""
SETTLED = 1e-3
"""What is left of one pass's transient where rows at the end of a log are good enough for a regression; of both passes
together a hundredth at worst. A log that is cut off in motion is extended by its point reflection, whose acceleration
jumps by twice its value. On simulated arms (`benchmarks/defaults.py`, at 6 Hz) nothing trimmed leaves errors of 2 to
5 %, 1e-1 of 0.1 to 0.3 %, 1e-2, 1e-3 and 1e-4 of 0.03 to 0.07 %."""


def low_pass(values: NDArray[np.float64], rate: float, cutoff: float, order: int, source: str) -> NDArray[np.float64]:
    """Filter the columns with a Butterworth filter forwards and backwards.

    The amplitude at frequency f is multiplied by 1 / (1 + (tan(pi f / rate) / tan(pi cutoff / rate))^(2 order)), 1/2
    at the cutoff, and the phase is unchanged. At both ends the signal is extended by its point reflection.

    Parameters
    ----------
    values
        (S, M).
    rate, cutoff
        In Hz. (The design takes cutoff / (rate / 2), the fraction of the Nyquist frequency.)
    order
        Of the filter that is applied twice.

    Raises
    ------
    InputError
        For a cutoff at or above half the rate, or too few rows.
    """
    if not 0.0 < cutoff < rate / 2.0:
        raise InputError(
            f"{source} is sampled at {rate:.6g} Hz, so a cutoff of {cutoff:.6g} Hz is not below half "
            "of it; lower the cutoff, or correct `time_unit` or `rate` in [log] if that is not the log's rate."
        )
    need = edge_rows(order) + 1
    if values.shape[0] < need:
        raise InputError(
            f"{source} has {values.shape[0]} rows but the filter of order {order} needs {need}; "
            "use a longer log or a lower order."
        )
    sections, steady = _sections(order, cutoff / (rate / 2.0))
    return _filtered_both_ways(sections, steady, values, edge_rows(order))


def _poles(order: int, cutoff: float) -> tuple[NDArray[np.complex128], float]:
    """Return the poles of a Butterworth filter, those in the upper half-plane first, and its gain.

    `cutoff` is the fraction of the Nyquist frequency. Steps and their order are those of `scipy.signal.butter`, so that
    the filter is the same to the last bit; to import that takes as long as to identify a robot from 40 000 rows, since
    all of scipy.stats comes with it.
    """
    analog = -np.exp(1j * pi * np.arange(-order + 1, order, 2) / (2 * order))
    warped = 4.0 * tan(pi * cutoff / 2.0)
    analog = warped * analog
    gain = warped**order * float(np.real(1.0 / np.prod(4.0 - analog)))
    return (4.0 + analog) / (4.0 - analog), gain


@lru_cache(maxsize=8)
def _sections(order: int, cutoff: float) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the second-order sections of a filter, (s, 6), and their states under a constant 1, (s, 2).

    Poles near the unit circle, whose transients are the largest, come last; the first section has the gain.
    """
    poles, gain = _poles(order, cutoff)
    poles = poles[: (order + 1) // 2]
    poles = poles[np.argsort(-np.abs(1.0 - np.abs(poles)), kind="stable")]
    sections, steady = np.zeros((len(poles), 6)), np.empty((len(poles), 2))
    # All zeros lie at -1, but for one at 0 that an odd order has beside a pole there; a pole takes the nearest ones.
    left = order % 2
    for k in reversed(range(len(poles))):
        pole, product = poles[k], (poles[k] * poles[k].conj()).real
        sections[k, 3:] = [1.0, -2.0 * pole.real, product] if pole.imag else [1.0, -pole.real, 0.0]
        at_zero = left and (k == 0 or abs(pole) < abs(pole + 1.0))
        sections[k, :3] = [1.0, 1.0, 0.0] if at_zero else [1.0, 2.0, 1.0]
        left -= at_zero
    sections[0, :3] *= gain
    level = 1.0
    for section, state in zip(sections, steady, strict=True):
        before, after = section[:3], section[3:]
        steps = np.array([[1.0 + after[1], -1.0], [after[2], 1.0]])
        state[:] = level * np.linalg.solve(steps, before[1:] - after[1:] * before[0])
        level *= before.sum() / after.sum()
    return sections, steady


def _filtered_both_ways(
    sections: NDArray[np.float64], steady: NDArray[np.float64], values: NDArray[np.float64], edge: int
) -> NDArray[np.float64]:
    """Return what `scipy.signal.sosfiltfilt` returns, from a compiled function that takes all columns at once."""
    from steelyard.graph.column_filter import filter_columns

    count, width = values.shape
    table = np.empty((count + 2 * edge, width))
    table[edge:-edge] = values
    table[:edge] = 2.0 * values[0] - values[edge:0:-1]
    table[-edge:] = 2.0 * values[-1] - values[-2 : -edge - 2 : -1]
    filter_columns(sections, steady[:, :, None] * table[0], table)
    filter_columns(sections, steady[:, :, None] * table[-1], table, backwards=True)
    return table[edge:-edge]


def edge_rows(order: int) -> int:
    """Rows by which scipy.signal.sosfiltfilt extends the signal at each end for a filter of this order."""
    return 3 * (order + 1)


def first_derivative(values: NDArray[np.float64], rate: float) -> NDArray[np.float64]:
    """Differentiate the columns by central differences of fourth order; two rows at each end by those of second order.

    Of fourth order, since those of second order take (w h)^2 / 3 off accelerations: of a simulated arm that moves at
    0.7 Hz an inertia was 14 standard errors wrong at 50 Hz, and no interval counted it.
    """
    from steelyard.graph.column_passes import central_differences

    step = 1.0 / rate
    derived = np.empty_like(values, order="C")
    central_differences(values, step, derived[2:-2])
    derived[1] = (values[2] - values[0]) / (2.0 * step)
    derived[-2] = (values[-1] - values[-3]) / (2.0 * step)
    derived[0] = (-1.5 * values[0] + 2.0 * values[1] - 0.5 * values[2]) / step
    derived[-1] = (0.5 * values[-3] - 2.0 * values[-2] + 1.5 * values[-1]) / step
    return derived


def decimate(values: NDArray[np.float64], factors: Sequence[int], source: str) -> NDArray[np.float64]:
    """Keep every factor-th row after an eighth-order Chebyshev filter forwards and backwards, factor after factor."""
    if not factors:
        return values  # so that nothing of SciPy's is imported
    from scipy.signal import decimate as keep_every

    for factor in factors:
        need = edge_rows(8) + 1
        if values.shape[0] < need:
            raise InputError(
                f"{source} is left with {values.shape[0]} rows but decimation by {factor} needs {need}; "
                "lower `decimate` in [processing] or use a longer log."
            )
        values = np.ascontiguousarray(keep_every(values, factor, axis=0, zero_phase=True))
    return values


def filter_padding(rate: float, cutoff: float, order: int) -> int:
    """Rows after which what lies beyond them no longer shows in the output of `low_pass`."""
    return _decay(_poles(order, cutoff / (rate / 2.0))[0]) + edge_rows(order)


def filter_settling(rate: float, cutoff: float, order: int) -> float:
    """Time in s after which the end of a log hardly shows in the output of `low_pass`: a thousandth is left."""
    return _decay(_poles(order, cutoff / (rate / 2.0))[0], SETTLED) / rate


def decimation_settling(factors: Sequence[int], rate: float) -> float:
    """Time in s after which the end of a log hardly shows in the output of `decimate`."""
    return _decimation_rows(factors, SETTLED, edges=False) / rate


def decimation_padding(factors: Sequence[int]) -> int:
    """Rows (before decimation) after which what lies beyond them no longer shows in the output of `decimate`."""
    return _decimation_rows(factors, DECAYED, edges=True)


def _decimation_rows(factors: Sequence[int], level: float, edges: bool) -> int:
    if not factors:
        return 0
    from scipy.signal import cheby1

    total, step = 0, 1
    for factor in factors:
        _, poles, _ = cheby1(8, 0.05, 0.8 / factor, output="zpk")
        total += step * (_decay(poles, level) + edges * edge_rows(8))
        step *= factor
    return total


def _decay(poles: NDArray[np.complex128], level: float = DECAYED) -> int:
    return ceil(log(level) / log(float(np.abs(poles).max())))


def motion_frequency(q: NDArray[np.float64], rate: float, share: float = POWER_SHARE) -> float:
    """The motion's dynamic frequency in Hz: below it lies 99.9 % of the power of the positions, all joints together.

    Taken from the periodogram of the positions less their mean and trend, under a Hann window. Power of the positions,
    not of the velocities: differentiation would raise the encoder's noise above the motion. 0 where no joint moves.
    Another share of the power than 0.999 may be asked for.
    """
    count = q.shape[0]
    if count < 16:
        return 0.0
    time = np.linspace(-1.0, 1.0, count)[:, None]
    centred = q - q.mean(axis=0)
    centred = centred - time * (time * centred).sum(axis=0) / (time**2).sum()
    # Padded to a length that factors well: primes would make the transform many times slower.
    padded = 1 << (count - 1).bit_length()
    spectrum = np.fft.rfft(centred * np.hanning(count)[:, None], n=padded, axis=0)
    power = (np.abs(spectrum) ** 2).sum(axis=1)
    # The mean of a motionless joint is only exact to rounding, which must not count as motion.
    if centred.std() < 1e-9:
        return 0.0
    below = np.cumsum(power) / power.sum()
    return float(np.fft.rfftfreq(padded, 1.0 / rate)[np.argmax(below >= share)])
