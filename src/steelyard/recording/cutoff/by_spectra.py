"""Choosing the cutoff by the spectra of the positions, so that the expected error of the accelerations is least."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from steelyard.errors import InputError

from ..filters.zero_phase import edge_rows, low_pass, motion_frequency
from ..measurements import Measurements
from .evidence import Curve, CutoffChoice, Plot

__all__ = ["ResidualAnalysis", "Spectra", "choose_cutoff", "motion_spectra", "noise_share", "residual_analysis"]

Array = NDArray[np.float64]
CANDIDATES = 96
"""Cutoffs that are compared; a parabola through the best and its neighbours refines the choice."""
TRIED = 24
"""Cutoffs of the residual analysis, each of which filters the whole excerpt."""
MOST_ROWS = 100_000
"""Rows in the middle of a log by which the cutoff is chosen."""
FEWEST = 64
"""Rows without which no spectrum is estimated."""
MOTION_SHARE = 0.99
"""Share of the power of a joint's positions below the frequency from which the end of the motion is searched."""
HIGHEST = 0.4
"""Fraction of the sample rate; what lies above it is taken for the work of filters in the drive."""
FLOOR = 0.25
"""Fraction of the sample rate above which positions are taken to hold noise alone."""
STILL = 1e-290  # density of positions that do not change, which is 1e-300 here
STRAIGHT = 0.5
"""The line is laid through the residuals at the cutoffs above this fraction of the highest."""


@dataclass(frozen=True, eq=False)
class Spectra:
    """Power spectra of positions, and where noise takes over, as `motion_spectra` finds them.

    Attributes
    ----------
    frequencies : ndarray
        (F,) Hz, without 0.
    density : ndarray
        (F, N) one-sided power spectral density of the positions, rad²/Hz or m²/Hz.
    crossover : ndarray
        (N,) Hz: above it the spectrum of the acceleration rises again, since noise dominates. NaN for joints at rest.
    noise : ndarray
        (N,) density of the noise just above the crossover.
    """

    frequencies: Array
    density: Array
    crossover: Array
    noise: Array

    @property
    def acceleration(self) -> Array:
        """(F, N) density of the second derivative, ``(2 pi f)^4`` times that of the positions."""
        return np.asarray((2.0 * np.pi * self.frequencies[:, None]) ** 4 * self.density)

    @property
    def moving(self) -> NDArray[np.bool_]:
        """(N,) whether a joint moves."""
        return np.isfinite(self.crossover)


def motion_spectra(q: ArrayLike, rate: float, source: str = "recording") -> Spectra:
    """Estimate the spectra of positions (S, N) by Welch's method, and where noise takes over.

    Motion is resolved by the whole log as one segment, less its linear trend, under a Blackman window, whose side lobes
    fall fast enough to see noise 14 powers of ten below it. The crossover is the minimum of the spectrum of the
    acceleration, smoothed over a sixth of an octave, above the frequencies of the motion (below which lie 99 % of the
    power of the positions) and below 0.4 times the rate. The noise comes from the median of the spectrum up to three
    times the crossover.

    Raises
    ------
    InputError
        For fewer than 64 rows, or where no joint moves.

    References
    ----------
    P. D. Welch, IEEE Trans. Audio and Electroacoustics 15, 1967.
    """
    values = np.asarray(q, dtype=np.float64)
    count, joints = values.shape
    if count < FEWEST:
        raise InputError(
            f"{source} has {count} rows, too few to choose a cutoff by; state `cutoff` in [processing], in Hz."
        )
    f, density = _density(values, rate)
    crossover, noise = np.full(joints, np.nan), np.zeros(joints)
    for j in range(joints):
        if values[:, j].std() < 1e-9:
            continue
        share = np.cumsum(density[:, j]) / density[:, j].sum()
        begin = int(np.argmax(share >= MOTION_SHARE))
        end = int(np.searchsorted(f, HIGHEST * rate))
        smooth = _smoothed(f, np.log((2.0 * np.pi * f) ** 4 * density[:, j]))
        if end - begin < 4:
            continue
        lowest = begin + int(np.argmin(smooth[begin:end]))
        crossover[j] = f[lowest]
        above = (f >= f[lowest]) & (f <= max(min(3.0 * f[lowest], HIGHEST * rate), f[lowest] + 4.0 * f[0]))
        # The median of an exponential distribution, which a periodogram follows, is ln 2 times its mean; single lines
        # of resonances do not move it.
        noise[j] = float(np.median(density[above, j]) / np.log(2.0))
    if not np.isfinite(crossover).any():
        raise InputError(
            f"{source} shows too little motion in its {count} rows to choose a cutoff by; "
            "state `cutoff` in [processing], in Hz."
        )
    return Spectra(f, density, crossover, noise)


def _density(values: Array, rate: float) -> tuple[Array, Array]:
    """Return frequencies (F,) without 0, and the one-sided density (F, N) of positions less their linear trend."""
    ramp = np.linspace(-1.0, 1.0, len(values))[:, None]
    centred = values - values.mean(axis=0)
    centred = centred - ramp * (ramp * centred).sum(axis=0) / (ramp**2).sum()
    # As `scipy.signal.welch` has it of one segment, under Blackman's window; its import takes half a second.
    count = len(values)
    turn = 2.0 * np.pi * np.arange(count) / count
    window = 0.42 - 0.5 * np.cos(turn) + 0.08 * np.cos(2.0 * turn)
    spectrum = np.fft.rfft((centred - centred.mean(axis=0)) * window[:, None], axis=0)
    density = np.abs(spectrum) ** 2 / (rate * (window**2).sum())
    density[1 : (count + 1) // 2] *= 2.0  # of both signs of the frequency, which 0 and half of the rate do not have
    return np.asarray(np.fft.rfftfreq(count, 1.0 / rate)[1:], dtype=np.float64), np.maximum(density[1:], 1e-300)


def _gain(f: Array, cutoffs: Array, rate: float, order: int) -> Array:
    """Return the response (C, F) of a Butterworth filter that is applied forwards and backwards."""
    ratio = np.tan(np.pi * np.minimum(f / rate, 0.4999)) / np.tan(np.pi * cutoffs / rate)[:, None]
    return np.asarray(1.0 / (1.0 + ratio ** (2 * order)))


def _smoothed(f: Array, values: Array) -> Array:
    """Return the running mean over a sixth of an octave around each frequency."""
    low = np.searchsorted(f, f * 2.0 ** (-1.0 / 12.0))
    high = np.maximum(np.searchsorted(f, f * 2.0 ** (1.0 / 12.0), side="right"), low + 1)
    sums = np.concatenate([[0.0], np.cumsum(values)])
    return np.asarray((sums[high] - sums[low]) / (high - low))


def noise_share(q: ArrayLike, rate: float, cutoffs: ArrayLike, order: int = 3) -> Array:
    """Estimate which part of the accelerations' power is noise of the positions (S, N), for cutoffs (C,) in Hz.

    The noise, of which the steps of an encoder are the least, has the density that is found from a quarter to 0.4 of
    the sample rate, where no joint moves. Regressors with such noise make inertias too small by about this part.

    Returns
    -------
    (C, N)
        NaN for joints whose positions do not change.
    """
    f, density = _density(np.asarray(q, dtype=np.float64), rate)
    top = (f >= FLOOR * rate) & (f <= HIGHEST * rate)
    floor = np.median(density[top], axis=0) / np.log(2.0) if top.any() else np.zeros(density.shape[1])
    weights = (2.0 * np.pi * f) ** 4 * _gain(f, np.asarray(cutoffs, dtype=np.float64), rate, order) ** 2
    power = weights @ density
    left = weights.sum(axis=1)[:, None] * floor
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.where(density.max(axis=0) > STILL, left / power, np.nan)


@dataclass(frozen=True, eq=False)
class ResidualAnalysis:
    """The result of `residual_analysis`: what filters of different cutoffs take away from positions.

    Attributes
    ----------
    cutoffs : ndarray
        (C,) Hz, that were tried.
    residuals : ndarray
        (C, N) root mean square of what the filter took away, rad or m.
    noise : ndarray
        (N,) where the straight line through the residuals at high cutoffs meets 0 Hz.
    chosen : ndarray
        (N,) Hz: the lowest cutoff whose residual is that noise.
    """

    cutoffs: Array
    residuals: Array
    noise: Array
    chosen: Array


def residual_analysis(
    q: ArrayLike, rate: float, cutoffs: ArrayLike, order: int = 3, source: str = ""
) -> ResidualAnalysis:
    """Filter positions (S, N) with each cutoff (C,) in Hz and see what is left over (Winter 2009, section 2.2.4.5).

    At high cutoffs the filter takes away noise alone, in nearly linear relation to the cutoff. The line, drawn on to
    0 Hz, tells the noise on the whole, and the cutoff that takes away as much is the one at which distortion and
    remaining noise are about even, in the position; accelerations ask for less noise.

    References
    ----------
    D. A. Winter, Biomechanics and Motor Control of Human Movement, 4th ed., Wiley, 2009.
    """
    values, tried = np.asarray(q, dtype=np.float64), np.asarray(cutoffs, dtype=np.float64)
    residuals = np.array(
        [np.sqrt(np.mean((values - low_pass(values, rate, float(f), order, source)) ** 2, axis=0)) for f in tried]
    )
    high = tried >= STRAIGHT * tried[-1]
    noise = np.maximum(np.polyfit(tried[high], residuals[high], 1)[1], 0.0)
    chosen = np.array([_crossing(tried, residuals[:, j], noise[j]) for j in range(values.shape[1])])
    return ResidualAnalysis(tried, residuals, noise, chosen)


def _crossing(cutoffs: Array, residuals: Array, level: float) -> float:
    """Return the lowest cutoff at which the residual has fallen to the level, interpolated in the logarithm."""
    below = np.flatnonzero(residuals <= level)
    if not len(below):
        return float(cutoffs[-1])
    k = int(below[0])
    if k == 0 or residuals[k - 1] <= residuals[k]:
        return float(cutoffs[k])
    part = (residuals[k - 1] - level) / (residuals[k - 1] - residuals[k])
    return float(cutoffs[k - 1] * (cutoffs[k] / cutoffs[k - 1]) ** part)


def choose_cutoff(recording: Measurements, order: int = 3) -> CutoffChoice:
    """Choose the cutoff of the position filter from the data.

    The spectrum of each joint's acceleration falls beyond the motion and rises again where noise dominates. Motion
    below that crossover counts as signal, everything above it as noise, whose density is taken to go on below it
    unchanged. For each candidate the mean squared error of the acceleration is then expected to be ``∫ (1 - G)²
    signal + ∫ G² noise``, with the response G of the filter. It is taken relative to the acceleration's own mean
    square, averaged over the moving joints (all joints share one filter, so that their signals stay alike), and made
    least.

    Parameters
    ----------
    recording : Recording
        Evenly sampled. Of more than 100 000 rows the middle ones are taken.
    order : int
        Of the Butterworth filter that is applied twice.

    Raises
    ------
    InputError
        Where no joint moves, or there are too few rows.

    Examples
    --------
    >>> from steelyard.recording import Recording
    >>> t = np.arange(20000) / 1000
    >>> q = np.sin(2 * np.pi * 0.5 * t) + 1e-4 * np.random.default_rng(1).normal(size=t.size)
    >>> choice = choose_cutoff(Recording(t=t, q=q[:, None], torque=np.cos(t)[:, None], source="sine"))
    >>> bool(1.0 < choice.cutoff < 4.0)
    True
    """
    rate, source = recording.rate, recording.source
    q = recording.q
    if len(q) > MOST_ROWS:
        begin = (len(q) - MOST_ROWS) // 2
        q = q[begin : begin + MOST_ROWS]
    if len(q) <= edge_rows(order):
        raise InputError(
            f"{source} has {len(q)} rows, too few to choose a cutoff by; state `cutoff` in [processing], in Hz."
        )
    spectra = motion_spectra(q, rate, source)
    candidates = np.geomspace(max(2.0 * rate / len(q), 1e-4 * rate), HIGHEST * rate, CANDIDATES)
    distortion, noise = _expected(spectra, candidates, rate, order)
    named = (("distortion", distortion), ("noise", noise), ("both", distortion + noise))
    total = (distortion + noise)[:, spectra.moving].mean(axis=1)
    best = int(np.argmin(total))
    cutoff = float(candidates[best])
    if 0 < best < CANDIDATES - 1:
        # The vertex of the parabola through the least value and its neighbours, in the logarithms.
        y = np.log(total[best - 1 : best + 2])
        bend = y[0] - 2.0 * y[1] + y[2]
        if bend > 0.0:
            cutoff *= (candidates[best + 1] / candidates[best]) ** float(0.5 * (y[0] - y[2]) / bend)
    moving, names = spectra.moving, recording.column_labels
    opinion = residual_analysis(q, rate, np.geomspace(candidates[0], 0.45 * rate, TRIED), order, source).chosen
    rule = min(10.0 * motion_frequency(q, rate), 0.2 * rate)
    joint_errors = np.where(moving, np.sqrt(distortion + noise), np.nan)
    error = np.asarray(np.sqrt(total))
    least = float(np.interp(cutoff, candidates, error))
    crossover = spectra.crossover[moving]
    own = np.where(moving, candidates[np.argmin(distortion + noise, axis=0)], np.nan)
    columns = zip(spectra.crossover, own, opinion, strict=True)
    cells = [[f"{value:.3g}" if np.isfinite(value) else "–" for value in values] for values in columns]
    shown = [Curve(names[j], spectra.frequencies, spectra.acceleration[:, j]) for j in map(int, np.flatnonzero(moving))]
    parts = [Curve(name, candidates, np.sqrt(part[:, moving].mean(axis=1))) for name, part in named]
    return CutoffChoice(
        cutoff=cutoff,
        order=order,
        source=source,
        joint_names=names,
        candidates=candidates,
        joint_errors=joint_errors,
        error=error,
        rule=rule,
        reason=(
            f"Positions were filtered at {cutoff:.4g} Hz, chosen from the data: noise exceeds the motion above "
            f"{crossover.min():.3g} to {crossover.max():.3g} Hz, and the expected error of the accelerations is least, "
            f"{100.0 * least:.2g} %; residual analysis says {np.median(opinion[moving]):.3g} Hz, ten times the "
            f"motion's frequency is {rule:.3g} Hz"
        ),
        explanation=(
            "The cutoff of the position filter was chosen from the data. Left, the spectrum of each joint's "
            "acceleration: it falls beyond the motion and rises again where noise dominates. Right, what each cutoff "
            "is expected to cost: what it takes from the motion, and the noise that it leaves. The dotted line is the "
            "choice."
        ),
        titles=("Joint", "Noise dominates from, Hz", "Best cutoff of this joint, Hz", "Residual analysis, Hz"),
        table=[(name, *row) for name, row in zip(names, cells, strict=True)],
        plots=(
            Plot(shown, "frequency, Hz", "spectrum of the acceleration, (rad/s²)²/Hz"),
            Plot(parts, "cutoff, Hz", "expected error of the acceleration, relative", decades=7),
        ),
    )


def _expected(spectra: Spectra, candidates: Array, rate: float, order: int) -> tuple[Array, Array]:
    """Return the relative mean squares of distortion and of noise, (C, N) each."""
    f = spectra.frequencies
    gain = _gain(f, candidates, rate, order)
    distortion, left = np.zeros((2, len(candidates), spectra.density.shape[1]))
    for j in np.flatnonzero(spectra.moving):
        density, level = spectra.density[:, j], spectra.noise[j]
        below = f < spectra.crossover[j]
        fourth = (2.0 * np.pi * f) ** 4
        signal = np.where(below, np.maximum(density - level, 0.0), 0.0) * fourth
        disturbance = np.where(below, np.minimum(level, density), density) * fourth
        power = max(float(signal.sum()), 1e-300)
        distortion[:, j] = (1.0 - gain) ** 2 @ signal / power
        left[:, j] = gain**2 @ disturbance / power
    return distortion, left
