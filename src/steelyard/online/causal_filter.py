"""The zero-phase filter of `Recording.process`, run while samples arrive: exact, and late by a fixed time."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from steelyard.errors import InputError
from steelyard.recording.filters.zero_phase import filter_settling

from .saved_state import Stateful

__all__ = ["CausalMotionFilter", "motion_kernels"]

Array = NDArray[np.float64]

LONGEST = 100_000
"""Samples that a filter may hold back, 100 s at 1 kHz. A cutoff in the wrong unit asks for 1e8, and 50 GB."""

DEGREE = 4
"""Polynomials up to this degree pass unchanged, with their exact derivatives: a cut impulse response alone would make
a constant position an acceleration."""


def motion_kernels(rate: float, cutoff: float, order: int = 3) -> Array:
    """Impulse responses of the forward and backward Butterworth filter, and of its two derivatives.

    Parameters
    ----------
    rate, cutoff : float
        Hz.

    Returns
    -------
    ndarray
        (3, 2 M + 1): for position, velocity and acceleration the factors of the samples from M before to M after. M is
        the number of samples after which a thousandth is left of the response of one pass, as where a log ends.

    Raises
    ------
    InputError
        If the cutoff is not below half the rate, or so near to it or to 0 that the response hardly ends.

    Examples
    --------
    >>> kernels = motion_kernels(1000.0, 10.0)
    >>> kernels.shape
    (3, 441)
    >>> t = np.arange(-220, 221) / 1000
    >>> (kernels @ (1 + 2 * t + 3 * t**2)).round(6).tolist()
    [1.0, 2.0, 6.0]
    """
    if not 0.0 < cutoff < rate / 2.0:
        raise InputError(f"cutoff must be between 0 and half the rate of {rate:g} Hz, got {cutoff:g} Hz.")
    reach = int(np.ceil(filter_settling(rate, cutoff, order) * rate))
    if reach > LONGEST:
        raise InputError(
            f"A filter with a cutoff of {cutoff:g} Hz and the order {order} would hold {reach} samples back at "
            f"{rate:g} Hz, {reach / rate:.4g} s, more than {LONGEST} samples; give a cutoff of some Hz, and `rate` in "
            "Hz."
        )
    # Long enough that the response has died away before it wraps around.
    size = 1 << int(np.ceil(np.log2(16 * reach)))
    frequencies = np.fft.rfftfreq(size, 1.0 / rate)
    with np.errstate(over="ignore"):
        ratio = np.tan(np.pi * np.minimum(frequencies, 0.4999999 * rate) / rate) / np.tan(np.pi * cutoff / rate)
        gain = 1.0 / (1.0 + ratio ** (2 * order))
    offsets = np.arange(-reach, reach + 1)
    kernels = np.empty((3, len(offsets)))
    for derivative in range(3):
        response = np.fft.irfft(gain * (2j * np.pi * frequencies) ** derivative, size)
        # A factor belongs to the sample that far after, so the response in time is turned around.
        kernels[derivative] = response[-offsets]
    return _exact_for_polynomials(kernels, offsets / rate)


def _exact_for_polynomials(kernels: Array, t: Array) -> Array:
    """Change kernels as little as possible, least at their ends, until polynomials come out with their derivatives."""
    scaled = t / np.abs(t).max()
    powers = scaled[None, :] ** np.arange(DEGREE + 1)[:, None]
    wanted = np.zeros((3, DEGREE + 1))
    for derivative, factor in enumerate((1.0, 1.0, 2.0)):
        wanted[derivative, derivative] = factor / np.abs(t).max() ** derivative
    window = powers * (1.0 - scaled**2)
    return np.asarray(kernels + np.linalg.solve(window @ powers.T, (wanted - kernels @ powers.T).T).T @ window)


FOURTH = 70.0
"""Variance of fourth differences of white noise over its own: 1 + 16 + 36 + 16 + 1."""


class CausalMotionFilter(Stateful):
    """Positions in, filtered positions, velocities and accelerations out, late by `delay` samples.

    The filter is that of `Recording.process`: no phase shift, so that motion and torque of the same instant belong
    together when the torque is held back by the same number of samples. A filter without this delay turns phases
    differently at each frequency, and would have to be applied to the torque and to the (nonlinear) dynamics alike.

    Parameters
    ----------
    rate, cutoff : float
        Hz.
    derived : {0, 1}
        How many derivatives are measured: with 1, velocities come with the positions, and only these are derived.

    Attributes
    ----------
    velocity_noise : ndarray
        (S', N): the standard deviation that the noise of all samples so far makes of each velocity that `add` returned
        last, from fourth differences, which no motion shows in.
    """

    _STATE = ("_noise", "_held")

    def __init__(self, rate: float, cutoff: float, order: int, joints: int, derived: int = 0) -> None:
        self.kernels = motion_kernels(rate, cutoff, order)
        self.delay = self.kernels.shape[1] // 2
        self.joints, self.derived = joints, derived
        self.velocity_noise = np.zeros((0, joints))
        self._noise = np.zeros((2, joints))  # sums of squares of fourth differences, and how many
        self.restart()

    def restart(self) -> None:
        """Forget what came before, where samples are missing."""
        self._held = np.zeros((0, self.joints * (1 + self.derived)))

    def add(self, values: Array) -> Array:
        """Add samples (S, N), or (S, 2 N) with velocities; return (S', 3, N), fewer while the filter fills."""
        length = self.kernels.shape[1]
        held = np.vstack([self._held, values])
        differences = np.diff(held[max(len(self._held) - 4, 0) :, -self.joints :], 4, axis=0)
        powers = np.stack([differences**2, np.ones_like(differences)], axis=1)
        noise = self._noise + np.cumsum(powers, axis=0)
        self._noise = noise[-1] if len(noise) else self._noise
        count = len(held) - length + 1
        if count <= 0:
            self._held, self.velocity_noise = held, np.zeros((0, self.joints))
            return np.zeros((0, 3, self.joints))
        white = float(np.linalg.norm(self.kernels[1 - self.derived]))
        self.velocity_noise = white * np.sqrt(noise[-count:, 0] / (FOURTH * noise[-count:, 1]))
        self._held = held[count:]
        out = self.kernels @ np.lib.stride_tricks.sliding_window_view(held, length, axis=0).swapaxes(1, 2)
        if not self.derived:
            return np.asarray(out)
        N = self.joints
        return np.stack([out[:, 0, :N], out[:, 0, N:], out[:, 1, N:]], axis=1)

    @property
    def noise(self) -> Array:
        """Standard deviation (N,) of the noise of what accelerations are derived from, of all samples so far."""
        return np.asarray(np.sqrt(self._noise[0] / (FOURTH * np.maximum(self._noise[1], 1.0))))

    @property
    def acceleration_gain(self) -> float:
        """Standard deviation of an acceleration over that of white noise from which it is derived."""
        return float(np.linalg.norm(self.kernels[2 - self.derived]))
